// Picked points: at most two, pins in the picture, their figures and their distance. A point of another isovalue or
// step than those that are shown fades.
// @ts-check

import { byId, make, page } from './elements.js';
import { makeMovable } from './floating.js';
import { boxOfDataset } from './isoscope-view.js';
import { pickLabel } from './labels.js';
import { announcer, copy, say } from './messages.js';
import { client, shown, unit } from './page-view.js';
import { csvOf, figuresOf, textOfLabel } from './point-figures.js';
import { hasAllFields, valuesOf } from './series.js';
import { format, formatAt } from './values.js';

/** @typedef {import('./isoscope-view.js').FrameRequest} FrameRequest */
/** @typedef {import('./isoscope-view.js').Vec3} Vec3 */
/** @typedef {import('./point-figures.js').Pick} Pick */

/** @type {Pick[]} */
let picks = [];
/** How often they were cleared: a point that was asked for before is not added. */
let clearCount = 0;
/**
 * The surfaces and the step that are shown, as `of` of picks names them.
 * @type {() => string[]}
 */
let shownNow = () => [];

/**
 * What a point lies on.
 * @param {any} surface @param {number | undefined} label @param {string} step
 */
const nameOf = (surface, label, step) => `${label === undefined ? `isovalue ${surface?.isovalue ?? 0}` : `label ${label}`} at ${step}`;

/** @param {import('./series.js').SeriesControls} series */
export function listenToPoints(series) {
  shownNow = () => (shown.state.surfaces ?? []).flatMap((/** @type {any} */ surface) =>
    (surface.labels ?? [undefined]).map((/** @type {number | undefined} */ label) => nameOf(surface, label, series.stepKey)));
  shown.addEventListener('click', async (event) => {
    const { x, y, width, height } = /** @type {CustomEvent} */ (event).detail;
    /** @type {FrameRequest} */
    const frame = { ...series.pinned(shown.getState()), viewport: { widthPx: width, heightPx: height } };
    const step = series.stepKey;
    const turn = clearCount;
    try {
      const request = { frame, pixels: [{ x, y }], ...(hasAllFields(shown.dataset, frame.selection) ? { withFieldValues: true } : {}) };
      const response = await client.post(`v1/datasets/${encodeURIComponent(frame.dataset ?? '')}/pick`, request);
      const point = (await response.json()).points?.[0];
      if (turn !== clearCount) {
        return;
      }
      if (!point?.isHit) {
        picks = [];
      } else {
        const { position = {} } = point;
        const surface = frame.surfaces?.[point.surfaceIndex ?? 0];
        picks = [...picks.slice(-1), { position: [position.x ?? 0, position.y ?? 0, position.z ?? 0],
          isovalue: surface?.isovalue ?? 0, point, selection: frame.selection, of: nameOf(surface, point.label, step) }];
      }
      if (point?.label !== undefined) {
        pickLabel(point.label);
      }
      drawPoints();
      announcer.say(sentenceOfPicks());
    } catch (error) {
      say(`Nothing picked: ${/** @type {Error} */ (error).message}`, true);
    }
  });
  makeMovable(page.points, byId('points-handle', HTMLElement));
  byId('points-clear', HTMLElement).onclick = clearPoints;
  byId('points-copy', HTMLElement).onclick = () => copy(csvOf(picks, shown.dataset), 'The points are copied as a table (CSV).');
}

/**
 * Coordinates, with the digits that tell places of the volume apart.
 * @param {Vec3} position
 */
const textsOf = (position) => {
  const box = boxOfDataset(shown.dataset);
  const size = box ? Math.max(...box.max.map((value, axis) => value - box.min[axis])) : 0;
  return position.map((value) => size > 0 ? formatAt(value, size) : format(value));
};

/** @returns {string | null} */
function distanceOfPicks() {
  if (picks.length < 2) {
    return null;
  }
  const [a, b] = picks.map((pick) => pick.position);
  return `${format(Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]), 5)}${unit()}`;
}

/** The newest point, for screen readers. */
function sentenceOfPicks() {
  const pick = picks.at(-1);
  const distance = distanceOfPicks();
  const values = pick ? valuesOf(pick.point, shown.dataset, format).map(({ name, text }) => ` ${name}: ${text}.`).join('') : '';
  return !pick ? 'There is no surface at this point.' : `Point ${'AB'[picks.length - 1]}: position ` +
    `${textsOf(pick.position).join('; ')}${unit()}. ${
      pick.point.label === undefined ? `Value ${format(pick.isovalue)}` : `Label ${textOfLabel(pick.point)}`}.${values}` +
    (distance ? ` A to B: ${distance}.` : '');
}

export function clearPoints() {
  picks = [];
  clearCount += 1;
  drawPoints();
}

let pointsDrawn = '';
export function drawPoints() {
  const now = shownNow();
  const points = picks.map((pick, i) => ({ name: 'AB'[i], isStale: !now.includes(pick.of), figures: figuresOf(pick, shown.dataset, textsOf) }));
  const distance = distanceOfPicks();
  const words = JSON.stringify([points, picks.map(({ position }) => position), distance]);
  if (words === pointsDrawn) {
    return;
  }
  pointsDrawn = words;
  shown.setPins(picks.map(({ position }, i) => ({ position, label: points[i].name, isStale: points[i].isStale })));
  page.points.hidden = picks.length === 0;
  byId('points-list', HTMLElement).replaceChildren(...points.map(({ name, isStale, figures }) => make('section', { className: isStale ? 'stale' : '',
    ...(isStale ? { title: 'This point lies on an isovalue or a step that is not shown now.' } : {}) },
  make('h3', {}, `Point ${name}`), make('dl', {}, ...figures.flatMap((one) => [make('dt', { className: one.className }, one.name),
    make('dd', { className: one.className }, one.text)])))),
  ...(distance ? [make('div', { className: 'distance' }, make('span', {}, 'A to B'), make('span', {}, distance))] : []));
}
