// The clip region: a box by sliders with two thumbs, planes, and what its cuts show.
// @ts-check

import { capsOf, drawWindow } from './cap-window.js';
import { afterKey, byId, describeSlider, make, page } from './elements.js';
import { axisNamesOf, basisOf, boxOfDataset, roundLength } from './isoscope-view.js';
import { say } from './messages.js';
import { change, shown, unit } from './page-view.js';
import { digitsAt, format, format12, formatAt } from './values.js';
import { otherSideOf } from './view-state.js';

/** @typedef {import('./isoscope-view.js').Vec3} Vec3 */

/** @param {any} clip @param {boolean} [isMoving] */
function changeClip(clip, isMoving) {
  const isCut = Object.keys(clip).length > 0;
  // Without a cut there is nothing to fill, and the server refuses caps.
  change(isCut ? { clip } : { clip: undefined, caps: undefined }, isMoving);
}

/** A slider with two thumbs, for the clip box along one axis. */
class ClipSlider {
  #axis;
  /** @type {'x' | 'y' | 'z'} */
  #key;
  #between = make('div', { className: 'between' });
  #figures = make('span', { className: 'ends', 'aria-hidden': 'true' });
  /** The thumb that is dragged; -1: none. */
  #dragged = -1;

  /** @param {string} name @param {number} axis */
  constructor(name, axis) {
    this.#axis = axis;
    this.#key = /** @type {'x' | 'y' | 'z'} */ ('xyz'[axis]);
    this.thumbs = ['low', 'high'].map((end) => make('div', { className: 'thumb', tabIndex: 0, role: 'slider', 'data-end': end,
      'data-axis': this.#key, 'aria-orientation': 'horizontal', 'aria-label': `${end === 'low' ? 'Least' : 'Greatest'} ${name}` }));
    this.bar = make('div', { className: 'slider' }, this.#between, ...this.thumbs);
    this.element = make('div', { className: 'double' }, make('span', { 'aria-hidden': 'true' }, name), this.bar, this.#figures);
    this.bar.addEventListener('pointerdown', (event) => this.#grab(event));
    this.bar.addEventListener('pointermove', (event) => this.#dragged >= 0 && this.#set(this.#dragged, this.#valueAt(event)));
    this.bar.addEventListener('pointerup', () => this.#release());
    this.bar.addEventListener('pointercancel', () => this.#release());
    this.thumbs.forEach((thumb, which) => thumb.addEventListener('keydown', (event) => this.#press(which, event)));
  }

  /** The ends of the volume along the axis, and those of the clip box. */
  #range() {
    const whole = boxOfDataset(shown.dataset) ?? { min: [0, 0, 0], max: [1, 1, 1] };
    const box = shown.state.clip?.box;
    const [min, max] = [whole.min[this.#axis], whole.max[this.#axis]];
    return { min, max, low: box ? box.min?.[this.#key] ?? 0 : min, high: box ? box.max?.[this.#key] ?? 0 : max };
  }

  /**
   * Thumbs stay a two-hundredth of the range apart.
   * @param {number} which
   */
  #limits(which) {
    const { min, max, low, high } = this.#range();
    const least = (max - min) / 200;
    return which === 0 ? { min, max: Math.max(min, high - least), now: low } : { min: Math.min(max, low + least), max, now: high };
  }

  /** @param {number} which @param {number} value */
  #set(which, value) {
    const ends = this.#range();
    const whole = /** @type {{min: Vec3, max: Vec3}} */ (boxOfDataset(shown.dataset));
    const clip = structuredClone(shown.state.clip ?? {});
    const toJson = (/** @type {Vec3} */ v) => ({ x: v[0], y: v[1], z: v[2] });
    clip.box ??= { min: toJson(whole.min), max: toJson(whole.max) };
    const step = 10 ** Math.floor(Math.log10((ends.max - ends.min) / 400));
    const rounded = Number((Math.round(value / step) * step).toPrecision(12));
    const { min, max } = this.#limits(which);
    clip.box[which === 0 ? 'min' : 'max'][this.#key] = Math.max(min, Math.min(max, rounded));
    const isWhole = ['x', 'y', 'z'].every((one, i) => (clip.box.min[one] ?? 0) <= whole.min[i] && (clip.box.max[one] ?? 0) >= whole.max[i]);
    if (isWhole) {
      delete clip.box;
    }
    changeClip(clip, true);
  }

  /** @param {PointerEvent} event */
  #valueAt(event) {
    const place = this.bar.getBoundingClientRect();
    const { min, max } = this.#range();
    return min + Math.max(0, Math.min(1, (event.clientX - place.left) / place.width)) * (max - min);
  }

  /** @param {PointerEvent} event */
  #grab(event) {
    if (!boxOfDataset(shown.dataset)) {
      return;
    }
    const value = this.#valueAt(event);
    const { low, high } = this.#range();
    this.#dragged = Math.abs(value - low) < Math.abs(value - high) || value < low ? 0 : 1;
    this.bar.setPointerCapture(event.pointerId);
    this.#set(this.#dragged, value);
  }

  #release() {
    if (this.#dragged >= 0) {
      this.#dragged = -1;
      change({});
    }
  }

  /** @param {number} which @param {KeyboardEvent} event */
  #press(which, event) {
    const { min, max, now } = this.#limits(which);
    const value = boxOfDataset(shown.dataset) ? afterKey(event.key, now, min, max) : null;
    if (value !== null) {
      this.#set(which, value);
      event.preventDefault();
    }
  }

  draw() {
    const { min, max, low, high } = this.#range();
    /** @param {number} value */
    const share = (value) => `${Math.max(0, Math.min(100, 100 * (value - min) / (max - min)))}%`;
    this.thumbs[0].style.left = share(low);
    this.thumbs[1].style.left = share(high);
    this.#between.style.left = share(low);
    this.#between.style.right = share(min + max - high);
    this.thumbs.forEach((thumb, i) => {
      const value = this.#limits(i);
      describeSlider(thumb, { ...value, text: `${formatAt(value.now, max - min)}${unit()}` });
    });
    this.#figures.textContent = `${formatAt(low, max - min)} – ${formatAt(high, max - min)}`;
  }
}

/** @type {ClipSlider[]} */
let clipSliders = [];
let clipSlidersOf = '';

/**
 * The offset of a plane, to a hundred-thousandth of the volume.
 * @param {number} offset
 */
const rounded = (offset) => {
  const box = boxOfDataset(shown.dataset);
  const size = box ? Math.hypot(...box.max.map((value, axis) => value - box.min[axis])) : 0;
  return Number(offset.toPrecision(size > 0 ? Math.min(17, digitsAt(offset, size) + 1) : 6));
};

export function listenToClip() {
  byId('clear-clip', HTMLElement).onclick = () => changeClip({});
  page.caps.onchange = () => change({ caps: capsOf(page.caps.value) });
  byId('add-plane', HTMLElement).onclick = () => {
    const { camera } = shown;
    const planes = shown.state.clip?.halfSpaces ?? [];
    if (!camera || planes.length >= 6) {
      say(camera ? 'A picture has at most 6 clip planes.' : 'Wait for the first picture.', true);
      return;
    }
    const normal = basisOf(camera).forward.map((value) => Math.round(value * 1000) / 1000);
    const box = boxOfDataset(shown.dataset);
    const middle = box ? box.min.map((value, axis) => (value + box.max[axis]) / 2) : camera.target;
    const offset = rounded(normal.reduce((sum, value, axis) => sum + value * middle[axis], 0));
    change({ clip: { ...shown.state.clip, halfSpaces: [...planes, { normal: { x: normal[0], y: normal[1], z: normal[2] }, offset }] } });
  };
}

let planesDrawn = -1;
export function drawClip() {
  const key = JSON.stringify(shown.dataset?.geometry ?? null) + (shown.dataset?.patientFrame ?? '');
  if (key !== clipSlidersOf) {
    clipSlidersOf = key;
    clipSliders = axisNamesOf(shown.dataset).map((name, axis) => new ClipSlider(name, axis));
    page.clip.replaceChildren(...clipSliders.map((slider) => slider.element));
  }
  clipSliders.forEach((slider) => slider.draw());
  const { caps, clip } = shown.state;
  page.caps.value = !caps ? 'open' : caps.colorMap ? 'slice' : 'filled';
  page.caps.disabled = !clip;
  drawWindow();
  const planes = shown.state.clip?.halfSpaces ?? [];
  /** @param {number} i @param {any} part @param {boolean} isMoving */
  const setPlane = (i, part, isMoving) => {
    const halfSpaces = structuredClone(shown.state.clip.halfSpaces);
    Object.assign(halfSpaces[i], part);
    change({ clip: { ...shown.state.clip, halfSpaces } }, isMoving);
  };
  if (planes.length !== planesDrawn) {
    planesDrawn = planes.length;
    page.planes.replaceChildren(...planes.map((/** @type {any} */ _, /** @type {number} */ i) => make('li', {},
      make('span', { className: 'hint' }), make('input', { type: 'range', 'aria-label': `Place of plane ${i + 1}`,
        oninput: (/** @type {any} */ event) => setPlane(i, { offset: rounded(event.target.valueAsNumber) }, true) }),
      make('button', { className: 'small', title: 'Keep the other side', onclick: () => {
        setPlane(i, otherSideOf(shown.state.clip.halfSpaces[i]), false);
      } }, 'Flip'),
      make('button', { className: 'remove', 'aria-label': `Remove plane ${i + 1}`, onclick: () => {
        const halfSpaces = shown.state.clip.halfSpaces.filter((/** @type {any} */ __, /** @type {number} */ k) => k !== i);
        const { halfSpaces: gone, ...rest } = shown.state.clip;
        changeClip(halfSpaces.length > 0 ? { ...rest, halfSpaces } : rest);
      } }, '✕'))));
  }
  const box = boxOfDataset(shown.dataset);
  planes.forEach((/** @type {any} */ plane, /** @type {number} */ i) => {
    const normal = [plane.normal?.x ?? 0, plane.normal?.y ?? 0, plane.normal?.z ?? 0];
    const item = page.planes.children[i];
    const [name, input] = item.children;
    name.textContent = `${normal.map((value) => format(value, 2)).join(', ')}`;
    /** @type {HTMLElement} */ (name).title = `Normal along ${axisNamesOf(shown.dataset).join(', ')}`;
    if (box && input instanceof HTMLInputElement) {
      const ends = normal.map((value, axis) => [value * box.min[axis], value * box.max[axis]]);
      const least = ends.reduce((sum, pair) => sum + Math.min(...pair), 0);
      const greatest = ends.reduce((sum, pair) => sum + Math.max(...pair), 0);
      const step = roundLength((greatest - least || 1) / 400);
      // A range input takes only whole steps from its minimum on.
      input.step = String(step);
      input.min = format12(Math.floor(least / step) * step);
      input.max = format12(Math.ceil(greatest / step) * step);
      input.value = String(plane.offset ?? 0);
      input.setAttribute('aria-valuetext', `${formatAt(plane.offset ?? 0, greatest - least || 1)}${unit()}`);
    }
  });
}
