// The moves of mouse, pen and fingers over a view.
// @ts-check

import { basisOf, unproject } from './camera.js';
import { pan, turn } from './moves.js';
import { add, dot, sub } from './vectors.js';

/** @typedef {import('./types.js').Camera} Camera */
/** @typedef {{x: number, y: number}} Place in CSS pixels of the view */

/** A press that moves less than this is a click, in CSS pixels. */
const CLICK_PX = 4;
/** A press that takes longer is none, in milliseconds. */
const CLICK_MS = 500;

export class Pointer {
  #root;
  #steering;
  #isWheelFree;
  /**
   * Those that are down, by their identifiers.
   * @type {Map<number, Place>}
   */
  #down = new Map();
  /**
   * A press that may become a click.
   * @type {Place & {time: number, button: number} | null}
   */
  #press = null;
  /** The distance of the point that is held. */
  #panDistance = 1;

  /**
   * @param {HTMLElement} root @param {import('./steering.js').Steering} steering
   * @param {boolean} isWheelFree whether the wheel zooms without the focus of the keyboard
   */
  constructor(root, steering, isWheelFree) {
    this.#root = root;
    this.#steering = steering;
    this.#isWheelFree = isWheelFree;
    root.addEventListener('pointerdown', (event) => this.#grab(event));
    root.addEventListener('pointermove', (event) => this.#drag(event));
    root.addEventListener('pointerup', (event) => this.#release(event));
    root.addEventListener('pointercancel', (event) => this.#release(event));
    root.addEventListener('contextmenu', (event) => event.preventDefault());
    root.addEventListener('dblclick', (event) => this.#center(event));
    root.addEventListener('wheel', (event) => this.#zoom(event), { passive: false });
  }

  /** @param {{clientX: number, clientY: number}} event @returns {Place} */
  #placeOf(event) {
    const box = this.#root.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  /** @param {Place} p @returns {[number, number]} in the view, -1 to 1, y up */
  #toView(p) {
    return [2 * p.x / this.#root.clientWidth - 1, 1 - 2 * p.y / this.#root.clientHeight];
  }

  /** @param {Camera} camera @param {{clientX: number, clientY: number}} event */
  #pointUnder(camera, event) {
    return this.#steering.pointAt(camera, ...this.#toView(this.#placeOf(event)));
  }

  /** @param {PointerEvent} event */
  #grab(event) {
    try {
      this.#root.setPointerCapture(event.pointerId);
    } catch {
      // The pointer is released already.
    }
    this.#root.focus({ preventScroll: true });
    const p = this.#placeOf(event);
    this.#down.set(event.pointerId, p);
    this.#press = this.#down.size === 1 ? { ...p, time: event.timeStamp, button: event.button } : null;
    const { camera } = this.#steering;
    if (camera) {
      this.#panDistance = dot(sub(this.#pointUnder(camera, event), camera.eye), basisOf(camera).forward);
    }
    event.preventDefault();
  }

  /** @param {PointerEvent} event */
  #drag(event) {
    const before = this.#down.get(event.pointerId);
    if (!before) {
      return;
    }
    const p = this.#placeOf(event);
    if (this.#press && Math.hypot(p.x - this.#press.x, p.y - this.#press.y) < CLICK_PX) {
      return;
    }
    this.#press = null;
    this.#down.set(event.pointerId, p);
    const steering = this.#steering;
    const { camera } = steering;
    if (!camera) {
      return;
    }
    const halves = 2 / Math.max(1, this.#root.clientHeight);
    const dx = (p.x - before.x) * halves;
    const dy = (before.y - p.y) * halves;
    const others = [...this.#down].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    if (others.length === 1) {
      steering.move(this.#pinched(camera, before, p, others[0], dx, dy), event.timeStamp);
    } else if (event.ctrlKey || event.metaKey) {
      steering.move(steering.zoomed(camera, Math.exp(dy * 1.5), camera.target), event.timeStamp);
    } else if (event.buttons & 6 || event.shiftKey) {
      steering.move(pan(camera, dx, dy, this.#panDistance), event.timeStamp);
    } else {
      steering.move(turn(camera, dx, dy), event.timeStamp);
    }
  }

  /**
   * Both fingers keep their points: their middle pans, their distance zooms, their angle rolls.
   * @param {Camera} camera @param {Place} before @param {Place} p of the finger that moves by (dx, dy) @param {Place} other
   * @param {number} dx @param {number} dy as for pan @returns {Camera}
   */
  #pinched(camera, before, p, other, dx, dy) {
    const old = { x: before.x - other.x, y: before.y - other.y };
    const now = { x: p.x - other.x, y: p.y - other.y };
    const middle = { x: (p.x + other.x) / 2, y: (p.y + other.y) / 2 };
    const factor = Math.hypot(now.x, now.y) / Math.max(1, Math.hypot(old.x, old.y));
    const angle = Math.atan2(old.x * now.y - old.y * now.x, old.x * now.x + old.y * now.y);
    const moved = pan(camera, dx / 2, dy / 2, this.#panDistance);
    const point = unproject(moved, this.#steering.aspect, ...this.#toView(middle), this.#panDistance);
    return turn(this.#steering.zoomed(moved, factor, point), 0, 0, angle);
  }

  /** @param {PointerEvent} event */
  #release(event) {
    if (!this.#down.delete(event.pointerId)) {
      return;
    }
    const press = this.#press;
    if (press && press.button === 0 && event.type === 'pointerup' && event.timeStamp - press.time < CLICK_MS) {
      this.#steering.click(press.x / this.#root.clientWidth, press.y / this.#root.clientHeight);
    }
    this.#press = null;
  }

  /** @param {MouseEvent} event */
  #center(event) {
    const { camera } = this.#steering;
    if (camera) {
      const move = sub(this.#pointUnder(camera, event), camera.target);
      this.#steering.move({ ...camera, eye: add(camera.eye, move), target: add(camera.target, move) }, event.timeStamp);
    }
  }

  /** @param {WheelEvent} event */
  #zoom(event) {
    const tree = /** @type {ShadowRoot} */ (this.#root.getRootNode());
    if (!this.#isWheelFree && tree.activeElement !== this.#root) {
      return;
    }
    event.preventDefault();
    const { camera } = this.#steering;
    if (camera) {
      const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
      const factor = Math.exp(-Math.max(-240, Math.min(240, event.deltaY * lines)) * 0.0016);
      this.#steering.move(this.#steering.zoomed(camera, factor, this.#pointUnder(camera, event)), event.timeStamp);
    }
  }
}
