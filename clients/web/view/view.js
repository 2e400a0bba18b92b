// What others call: a view in an element of a page.
// @ts-check

import { cameraToJson } from './camera.js';
import { pressKey } from './keyboard.js';
import { Loop } from './loop.js';
import { boxOfDataset, framedAgain, namedCamera } from './named-views.js';
import { Pointer } from './pointer.js';
import { Steering } from './steering.js';
import { levelText, pictureText } from './refinement.js';

/** @typedef {import('./types.js').Vec3} Vec3 */
/** @typedef {import('./types.js').Camera} Camera */
/** @typedef {import('./types.js').FrameRequest} FrameRequest */
/** @typedef {import('./loop.js').Options} Options */

/**
 * A picture that a pointer moves. Events (`detail`): 'frame' {header, isExact, width, height, decodeMs,
 * roundTripMs, latencyMs}; 'state' {state, isMoving} when state or camera changed; 'click' {x, y, width, height} in
 * pixels of the picture, of the pointer, or of the middle when Enter was pressed;
 * 'status' {kind: 'connecting' | 'open' | 'closed' | 'refused', sentence}: after 'refused', for a missing or wrong
 * token, nothing is tried until `setToken`, and a listener that tells it by itself prevents the default, a notice;
 * 'notice' {sentence, isError}; 'dataset'; 'refined' {progress, deferred}, as the members, when a tile is shown or the
 * exact picture is deferred.
 */
export class View extends EventTarget {
  /** @param {HTMLElement} element @param {Options} [options] */
  constructor(element, options = {}) {
    super();
    this.options = options;
    /** What `lookFrom`, `fit` and `reset` frame: older coordinators refuse 'CAMERA_FIT_CELLS'. */
    this.fitKind = 'CAMERA_FIT_SURFACE';
    /** @param {string} type @param {any} detail */
    const emit = (type, detail) => this.dispatchEvent(new CustomEvent(type, { detail, cancelable: true }));
    /** The inside, for the page and for tests. */
    this.loop = new Loop(element, options, emit);
    const { model, picture } = this.loop;
    /** What gets the pointer and the keyboard. */
    const root = this.root = this.loop.elements.root;
    const steering = new Steering(model, picture,
      { moved: (time) => this.loop.change(true, time), clicked: (detail) => emit('click', detail) });
    new Pointer(root, steering, options.wheel !== 'focused');
    const focus = (/** @type {PointerEvent} */ event) => {
      const box = root.getBoundingClientRect();
      const [x, y] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
      this.loop.focus(x >= 0 && x <= 1 && y >= 0 && y <= 1 ? { x, y } : null);
    };
    root.addEventListener('pointermove', focus);
    root.addEventListener('pointerdown', focus);
    root.addEventListener('pointerleave', () => this.loop.focus(null));
    root.addEventListener('keydown', (event) => pressKey(event, steering, this));
    this.loop.start(() => options.state && this.setState(options.state));
  }

  /** The state, without the camera of the pointer: to be read only. @returns {FrameRequest} */
  get state() {
    return this.loop.model.state;
  }

  /** Whether a state was set: nothing is shown before. */
  get hasState() {
    return this.loop.model.isSet;
  }

  get camera() {
    return this.loop.model.camera;
  }

  /** The dataset that is shown; null until the gateway has described it. */
  get dataset() {
    return this.loop.model.dataset;
  }

  set dataset(dataset) {
    this.loop.model.dataset = dataset;
  }

  /** Whether axes, scale bar and box are shown. */
  get decorations() {
    return this.loop.overlay.shown;
  }

  /** Whether a frame of the current state is on the screen. */
  get isCurrent() {
    const { frames, stream } = this.loop;
    return !stream.isDirty && frames.shownPicture === stream.picture;
  }

  /** Whether the exact one is. */
  get isExact() {
    return this.isCurrent && this.loop.picture.frame?.isExact === true;
  }

  /** Whether the picture has other pixels than the screen, which scales it. */
  get isScaled() {
    return this.loop.picture.frame !== null && !this.loop.picture.isWhole;
  }

  /** The level of the picture's samples, which is 0 unless the state chooses one: 0 is exact. */
  get level() {
    return Number(this.loop.picture.frame?.drawnLevel?.level ?? 0);
  }

  /** The level for people: "level 2, 1 sample = 0.9 px"; '' at level 0. */
  get levelText() {
    return levelText(this.loop.picture.frame?.drawnLevel);
  }

  /**
   * The tiles of the exact picture that are shown, of all; null if none come.
   * @returns {import('./refinement.js').Progress | null}
   */
  get progress() {
    return this.isCurrent ? this.loop.refinement.progressOf(this.loop.stream.picture) : null;
  }

  /**
   * What the exact picture would cost, if it is over a limit and not drawn; else null.
   * @returns {import('./refinement.js').Deferred | null}
   */
  get deferred() {
    return this.loop.stream.isDirty ? null : this.loop.refinement.deferredOf(this.loop.stream.picture);
  }

  /**
   * What an exact picture may cost; null: whatever it takes.
   * @returns {import('./refinement.js').Limits}
   */
  get limits() {
    return this.loop.refinement.limits;
  }

  set limits(limits) {
    if (this.loop.refinement.setLimits(limits) && this.hasState) {
      this.loop.askAgain();
    }
  }

  /** Draws the exact picture of this view, whatever it costs. */
  drawExact() {
    this.loop.refinement.lift();
    this.loop.askAgain();
  }

  /** What the picture is while the view rests: "exact", "exact 12 of 40", or its level; '' until something of it is shown. */
  get pictureText() {
    const { frame } = this.loop.picture;
    return this.isCurrent && frame ? pictureText({ isExact: frame.isExact, drawnLevel: frame.drawnLevel, progress: this.progress }) : '';
  }

  /** What is shown: a RenderIsosurfaceRequest as JSON, with the camera of the pointer. */
  getState() {
    return this.loop.model.toState();
  }

  /**
   * Replaces the state. Without a camera, the server chooses one. `isMoving`: more states follow,
   * as from a slider; quick frames come first.
   * @param {FrameRequest} state @param {{isMoving?: boolean}} [how]
   */
  setState(state, how = {}) {
    const { model, stream } = this.loop;
    if (!model.replace(state, stream.sequence + 1)) {
      this.loop.notices.problem('The camera of this view is no camera: the default one is used.');
    }
    if (!model.dataset) {
      this.loop.describe();
    }
    stream.change(performance.now());
    this.loop.change(how.isMoving ?? false, null);
  }

  /**
   * Changes parts of the state; the camera stays, unless it is given. Null and undefined remove a
   * part.
   * @param {FrameRequest} part @param {{isMoving?: boolean}} [how]
   */
  update(part, how) {
    this.setState({ ...this.getState(), ...part }, how);
  }

  /** Asks for the picture anew, though its request be the same: the dataset is another now. */
  renew() {
    this.loop.stream.renew();
    this.update({});
  }

  /** @param {Camera} camera */
  setCamera(camera) {
    this.loop.model.move(camera);
    this.loop.change(true, performance.now());
  }

  /**
   * Views the surface from a side, as large as it fits: 'front' ... 'inferior'.
   * @param {string} name @returns {boolean} false if the dataset has no such side, or is not known yet
   */
  lookFrom(name) {
    const box = boxOfDataset(this.dataset);
    const camera = box && namedCamera(name, box, this.dataset?.patientFrame);
    if (!camera) {
      return false;
    }
    this.update({ camera: cameraToJson(camera), cameraFit: this.fitKind });
    return true;
  }

  /** Views the surface from the present direction, as large as it fits. */
  fit() {
    const box = boxOfDataset(this.dataset);
    const camera = box && this.camera && framedAgain(this.camera, box);
    if (camera) {
      this.update({ camera: cameraToJson(camera), cameraFit: this.fitKind });
    } else {
      this.reset();
    }
  }

  /** Fits again, in an element of another size, if nobody has moved the camera since the last fit. */
  refit() {
    if (this.loop.model.hasFittedCamera) {
      this.loop.resize();
      this.fit();
    }
  }

  /** Lets the server choose the camera again: the first look. */
  reset() {
    this.update({ camera: undefined, cameraFit: this.fitKind });
  }

  /** @param {{axes?: boolean, scaleBar?: boolean, box?: boolean}} decorations */
  decorate(decorations) {
    Object.assign(this.loop.overlay.shown, decorations);
    this.loop.schedule();
  }

  /**
   * Marks points of the scene.
   * @param {{position: Vec3, label?: string, isStale?: boolean}[]} pins a stale one fades
   */
  setPins(pins) {
    this.loop.overlay.pins = pins;
    this.loop.schedule();
  }

  /** Figures for users and tests: those of Statistics, and what is on the screen. */
  stats() {
    const { statistics, connection, picture, notices } = this.loop;
    return {
      ...statistics.summary(),
      isExact: this.isExact,
      isScaled: this.isScaled,
      level: this.level,
      isConnected: connection.isOpen,
      transport: connection.name,
      renderer: picture.screen.name,
      isInWorker: connection.isInWorker,
      width: picture.frame?.width ?? 0,
      height: picture.frame?.height ?? 0,
      notice: notices.text,
    };
  }

  /**
   * Connects with another token, if there is no connection.
   * @param {string} token
   */
  setToken(token) {
    this.loop.setToken(token);
  }

  /** Ends the connection, frees all pictures and removes the view from its element. */
  destroy() {
    this.loop.end();
  }
}

/**
 * Shows a view in an element, which must have a height.
 * @param {HTMLElement} element @param {Options} [options] @returns {View}
 */
export function mount(element, options) {
  return new View(element, options);
}
