// Picked points: at most two, pins in the picture, their figures and their distance.
// @ts-check

import { make, page } from './elements.js';
import { boxOfDataset } from './isoscope-view.js';
import { pickLabel } from './labels.js';
import { announcer, say } from './messages.js';
import { client, shown, unit } from './page-view.js';
import { hasAllFields, valuesOf } from './series.js';
import { format, formatAt } from './values.js';

/** @typedef {import('./isoscope-view.js').FrameRequest} FrameRequest */
/** @typedef {import('./isoscope-view.js').Vec3} Vec3 */
/** @typedef {{position: Vec3, isovalue: number, point: any}} Pick */

/** @type {Pick[]} */
let picks = [];

/** @param {import('./series.js').SeriesControls} series */
export function listenToPoints(series) {
  shown.addEventListener('click', async (event) => {
    const { x, y, width, height } = /** @type {CustomEvent} */ (event).detail;
    /** @type {FrameRequest} */
    const frame = { ...series.pinned(shown.getState()), viewport: { widthPx: width, heightPx: height } };
    try {
      const request = { frame, pixels: [{ x, y }], ...(hasAllFields(shown.dataset, frame.selection) ? { withFieldValues: true } : {}) };
      const response = await client.post(`v1/datasets/${encodeURIComponent(frame.dataset ?? '')}/pick`, request);
      const point = (await response.json()).points?.[0];
      if (!point?.isHit) {
        picks = [];
      } else {
        const { position = {} } = point;
        picks = [...picks.slice(-1), { position: [position.x ?? 0, position.y ?? 0, position.z ?? 0],
          isovalue: frame.surfaces?.[point.surfaceIndex ?? 0]?.isovalue ?? 0, point }];
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

/**
 * "left lung (3)".
 * @param {any} point
 */
const textOfLabel = ({ label, labelName }) => labelName ? `${labelName} (${label})` : String(label);

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
  drawPoints();
}

function drawPoints() {
  shown.setPins(picks.map((pick, i) => ({ position: pick.position, label: 'AB'[i] })));
  page.points.hidden = picks.length === 0;
  const rows = picks.flatMap((pick, i) => {
    const { normal, gradient, blockId, shardIndex } = pick.point;
    const steepness = gradient ? Math.hypot(gradient.x ?? 0, gradient.y ?? 0, gradient.z ?? 0) : null;
    return [make('h3', {}, `Point ${'AB'[i]}`, ...(i === 0 ? [make('button', { className: 'small', onclick: clearPoints }, 'Clear')] : [])),
      make('dl', {}, make('dt', {}, 'position'), make('dd', { className: 'position' }, textsOf(pick.position).join(', ')),
        ...(pick.point.label === undefined ? [make('dt', {}, 'value'), make('dd', {}, format(pick.isovalue))]
          : [make('dt', {}, 'label'), make('dd', { className: 'label' }, textOfLabel(pick.point))]),
        ...valuesOf(pick.point, shown.dataset, format).flatMap(({ name, text }) => [make('dt', { className: 'field' }, name), make('dd', {}, text)]),
        ...(normal ? [make('dt', {}, 'normal'), make('dd', {}, ['x', 'y', 'z'].map((axis) => (normal[axis] ?? 0).toFixed(3)).join(', '))] : []),
        ...(steepness !== null ? [make('dt', {}, 'gradient'), make('dd', {}, format(steepness, 4))] : []),
        make('dt', {}, 'block'), make('dd', {}, `${blockId ?? 0}${shardIndex === undefined ? '' : ` of shard ${shardIndex}`}`))];
  });
  const distance = distanceOfPicks();
  if (distance) {
    rows.push(make('div', { className: 'distance' }, make('span', {}, 'A to B'), make('span', {}, distance)));
  }
  page.points.replaceChildren(...rows);
}
