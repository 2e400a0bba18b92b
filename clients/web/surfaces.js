// The list of surfaces: colour, isovalue and opacity of each. Of a set of labels, its names stand in place of the
// isovalue; a single label of the dataset is in the list of labels (labels.js).
// @ts-check

import { make, page } from './elements.js';
import { changeSurface } from './histogram.js';
import { isNothing, isOfLabels, nameOfLabels } from './label-sets.js';
import { knownLabels, removeSurface } from './labels.js';
import { finiteRangeOf, shown } from './page-view.js';
import { PALETTE, fromHex, percent, toHex } from './values.js';

/**
 * Whether a surface has a row here.
 * @param {any} surface
 */
function isListed(surface) {
  return !isOfLabels(surface) || !isNothing(surface, finiteRangeOf(shown.dataset, shown.state.selection)) &&
    !(surface.labels.length === 1 && knownLabels().some((label) => (label.value ?? 0) === surface.labels[0]));
}

/** @param {number} i the surface's place in the state @param {string} names of its labels; '': it has an isovalue */
function rowOfSurface(i, names) {
  /** @param {string} hex @param {number} [alpha] */
  const paint = (hex, alpha) => {
    const now = shown.state.surfaces[i].color ?? fromHex(PALETTE[0]);
    return { color: { ...fromHex(hex), alpha: alpha ?? now.alpha } };
  };
  return make('li', {},
    make('input', { type: 'color', title: 'Colour', 'aria-label': `Colour of surface ${i + 1}`,
      oninput: (/** @type {any} */ event) => changeSurface(i, paint(event.target.value), true) }),
    names ? make('span', { className: 'name', title: names }, names)
      : make('input', { type: 'number', step: 'any', title: 'Isovalue', 'aria-label': `Isovalue of surface ${i + 1}`,
        onchange: (/** @type {any} */ event) => Number.isFinite(event.target.valueAsNumber) && changeSurface(i, { isovalue: event.target.valueAsNumber }) }),
    make('input', { type: 'range', min: '0.05', max: '1', step: '0.05', title: 'Opacity', 'aria-label': `Opacity of surface ${i + 1}`,
      oninput: (/** @type {any} */ event) => changeSurface(i, paint(toHex(shown.state.surfaces[i].color ?? fromHex(PALETTE[0])), event.target.valueAsNumber), true) }),
    make('span', { className: 'figure', 'aria-hidden': 'true' }),
    make('button', { className: 'remove', title: 'Remove this surface', 'aria-label': `Remove surface ${i + 1}`,
      onclick: () => removeSurface(i) }, '✕'));
}

let surfacesDrawn = '';
export function drawSurfaces() {
  const { surfaces = [] } = shown.state;
  /** @type {{surface: any, i: number, names: string}[]} */
  const rows = surfaces.map((/** @type {any} */ surface, /** @type {number} */ i) => ({ surface, i,
    names: isOfLabels(surface) ? nameOfLabels(shown.dataset, surface.labels) : '' })).filter((/** @type {any} */ row) => isListed(row.surface));
  // Controls under the pointer must not be replaced.
  const form = JSON.stringify(rows.map(({ i, names }) => [i, names]));
  if (form !== surfacesDrawn) {
    surfacesDrawn = form;
    page.surfaces.replaceChildren(...rows.map(({ i, names }) => rowOfSurface(i, names)));
  }
  rows.forEach(({ surface }, at) => {
    const row = page.surfaces.children[at];
    const [color, isovalue] = row.querySelectorAll('input');
    const opacity = /** @type {HTMLInputElement} */ (row.querySelector('input[type=range]'));
    const paint = surface.color ?? fromHex(PALETTE[0]);
    color.value = toHex(paint);
    if (isovalue !== opacity && document.activeElement !== isovalue) {
      isovalue.value = String(surface.isovalue ?? 0);
    }
    opacity.value = String(paint.alpha ?? 0);
    opacity.setAttribute('aria-valuetext', percent(paint.alpha ?? 0));
    /** @type {HTMLElement} */ (row.querySelector('.figure')).textContent = percent(paint.alpha ?? 0);
    /** @type {HTMLButtonElement} */ (row.querySelector('.remove')).disabled = surfaces.length === 1 && knownLabels().length === 0;
  });
}
