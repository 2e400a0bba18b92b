// What is shown: the state of a view, its camera and its dataset. No element, no connection.
//
// Either the pointer has the camera, or the server chooses it: then answers from the state number
// `cameraFrom` on have the camera that it chose, and the state has the inputs of the choice.
// @ts-check

import { cameraFromJson, cameraToJson } from './camera.js';

/** @typedef {import('./types.js').Camera} Camera */
/** @typedef {import('./types.js').DatasetJson} DatasetJson */
/** @typedef {import('./types.js').FrameRequest} FrameRequest */

/** The box of blocks is larger than what is seen of the surface: the view fills itself. */
const LOOSE_FIT = 'CAMERA_FIT_SURFACE';
const FITS = [LOOSE_FIT, 'CAMERA_FIT_CELLS'];

export class Model {
  /** @type {FrameRequest} */
  state = {};
  /** Whether a state was set: nothing is shown before. */
  isSet = false;
  /** @type {Camera | null} */
  camera = null;
  /** @type {DatasetJson | null} */
  dataset = null;
  /** The server's camera is taken from answers to this state or a newer one; 0: from none. */
  cameraFrom = 0;
  /** The camera that the last fit gave, as JSON. */
  #fitted = '';

  /** @returns {FrameRequest} a copy of the state, with the camera of the pointer */
  toState() {
    const state = structuredClone(this.state);
    if (this.camera && !this.cameraFrom) {
      state.camera = cameraToJson(this.camera);
    }
    return state;
  }

  /**
   * Replaces the state. Null and undefined are as good as absent.
   * @param {FrameRequest} given @param {number} sequence of the next state that is sent
   * @returns {boolean} false if its camera is none; the server chooses one then
   */
  replace(given, sequence) {
    const { viewport, output, ...state } = structuredClone(given);
    for (const key of Object.keys(state)) {
      if (state[key] === undefined || state[key] === null) {
        delete state[key];
      }
    }
    if ((state.dataset ?? '') !== this.datasetName) {
      this.dataset = null;
    }
    const camera = cameraFromJson(state.camera);
    const isGood = !state.camera || camera !== null;
    if (!isGood) {
      delete state.camera;
    }
    this.state = state;
    this.isSet = true;
    if (camera && !FITS.includes(state.cameraFit)) {
      this.camera = camera;
      this.cameraFrom = 0;
    } else {
      this.cameraFrom = sequence;
    }
    return isGood;
  }

  /** The name in the state; '' is the server's first dataset. @returns {string} */
  get datasetName() {
    return this.state.dataset ?? '';
  }

  /** Red, green and blue, 0 to 1. @returns {number[]} */
  get background() {
    const { red = 0, green = 0, blue = 0 } = this.state.backgroundColor ?? {};
    return [red, green, blue];
  }

  /** @param {Camera} camera of the pointer */
  move(camera) {
    this.camera = camera;
    this.cameraFrom = 0;
    delete this.state.cameraFit;
  }

  /**
   * Takes the camera of an answer, if it is the server's choice.
   * @param {Camera} camera @param {number} sequence of the state that is answered
   * @returns {{isFitted: boolean} | null} whether the server fitted it loosely; null if it is not taken
   */
  takeCamera(camera, sequence) {
    if (this.camera && !(this.cameraFrom && sequence >= this.cameraFrom)) {
      return null;
    }
    const isFitted = this.state.cameraFit === LOOSE_FIT;
    this.takeFitted(camera);
    return { isFitted };
  }

  /** @param {Camera} camera that fits what is shown */
  takeFitted(camera) {
    this.move(camera);
    this.#fitted = JSON.stringify(cameraToJson(camera));
  }

  /** Whether the camera is still the one of the last fit: nobody has moved it. */
  get hasFittedCamera() {
    return this.camera !== null && !this.cameraFrom && JSON.stringify(cameraToJson(this.camera)) === this.#fitted;
  }
}
