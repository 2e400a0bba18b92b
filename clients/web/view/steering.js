// The camera in the hands of pointer and keyboard.
// @ts-check

import { basisOf, isSameCamera, unproject } from './camera.js';
import { zoomTo } from './moves.js';
import { boxOfDataset } from './named-views.js';
import { gridDepth } from './relief.js';
import { length, sub } from './vectors.js';

/** @typedef {import('./types.js').Vec3} Vec3 */
/** @typedef {import('./types.js').Camera} Camera */

export class Steering {
  #model;
  #picture;
  #on;

  /**
   * @param {import('./model.js').Model} model @param {import('./picture.js').Picture} picture
   * @param {{moved: (time: number) => void, clicked: (detail: {x: number, y: number, width: number, height: number}) => void}} on
   */
  constructor(model, picture, on) {
    this.#model = model;
    this.#picture = picture;
    this.#on = on;
  }

  get camera() {
    return this.#model.camera;
  }

  get aspect() {
    return this.#picture.aspect;
  }

  /** @param {Camera} camera @param {number} time of the event */
  move(camera, time) {
    this.#model.move(camera);
    this.#on.moved(time);
  }

  /**
   * Zooms, unless that goes too near or too far.
   * @param {Camera} camera @param {number} factor @param {Vec3} point that stays @returns {Camera}
   */
  zoomed(camera, factor, point) {
    const zoomed = zoomTo(camera, factor, point);
    const box = boxOfDataset(this.#model.dataset);
    const size = box ? length(sub(box.max, box.min)) : basisOf(camera).distance;
    const reach = zoomed.height > 0 ? zoomed.height : basisOf(zoomed).distance;
    return reach > size * 1e-4 && reach < size * 100 ? zoomed : camera;
  }

  /**
   * Returns the point of the scene under a point of the view; at the target's distance if there is none.
   * @param {Camera} camera @param {number} x @param {number} y of the view, -1 to 1, y up
   */
  pointAt(camera, x, y) {
    const { frame, aspect } = this.#picture;
    if (frame?.grid && isSameCamera(frame.camera, camera)) {
      const i = Math.floor((x * aspect * frame.height / frame.width + 1) / 2 * frame.grid.width);
      const j = Math.floor((1 - y) / 2 * frame.grid.height);
      const depth = gridDepth(frame.grid, i, j);
      if (depth > 0) {
        return unproject(camera, aspect, x, y, depth);
      }
    }
    return unproject(camera, aspect, x, y, basisOf(camera).distance);
  }

  /** @param {number} u @param {number} v from the top left, 0 to 1 */
  click(u, v) {
    const { width, height } = this.#picture;
    this.#on.clicked({ x: Math.min(width - 1, Math.floor(u * width)), y: Math.min(height - 1, Math.floor(v * height)),
      width, height });
  }
}
