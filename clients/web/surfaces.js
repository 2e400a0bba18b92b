// The list of surfaces: colour, isovalue and opacity of each.
// @ts-check

import { make, page } from './elements.js';
import { changeSurface } from './histogram.js';
import { change, shown } from './page-view.js';
import { PALETTE, fromHex, percent, toHex } from './values.js';

let surfacesDrawn = '';
export function drawSurfaces() {
  const { surfaces = [] } = shown.state;
  // Controls under the pointer must not be replaced.
  const form = JSON.stringify([surfaces.length]);
  if (form !== surfacesDrawn) {
    surfacesDrawn = form;
    page.surfaces.replaceChildren(...surfaces.map((/** @type {any} */ _, /** @type {number} */ i) => {
      /** @param {string} hex @param {number} [alpha] */
      const paint = (hex, alpha) => {
        const now = shown.state.surfaces[i].color ?? fromHex(PALETTE[0]);
        return { color: { ...fromHex(hex), alpha: alpha ?? now.alpha } };
      };
      return make('li', {},
        make('input', { type: 'color', title: 'Colour', 'aria-label': `Colour of surface ${i + 1}`,
          oninput: (/** @type {any} */ event) => changeSurface(i, paint(event.target.value), true) }),
        make('input', { type: 'number', step: 'any', title: 'Isovalue', 'aria-label': `Isovalue of surface ${i + 1}`,
          onchange: (/** @type {any} */ event) => Number.isFinite(event.target.valueAsNumber) && changeSurface(i, { isovalue: event.target.valueAsNumber }) }),
        make('input', { type: 'range', min: '0.05', max: '1', step: '0.05', title: 'Opacity', 'aria-label': `Opacity of surface ${i + 1}`,
          oninput: (/** @type {any} */ event) => changeSurface(i, paint(toHex(shown.state.surfaces[i].color ?? fromHex(PALETTE[0])), event.target.valueAsNumber), true) }),
        make('span', { className: 'figure', 'aria-hidden': 'true' }),
        make('button', { className: 'remove', title: 'Remove this surface', 'aria-label': `Remove surface ${i + 1}`,
          onclick: () => change({ surfaces: shown.state.surfaces.filter((/** @type {any} */ __, /** @type {number} */ k) => k !== i) }) }, '✕'));
    }));
  }
  surfaces.forEach((/** @type {any} */ surface, /** @type {number} */ i) => {
    const [color, isovalue, opacity] = page.surfaces.children[i].querySelectorAll('input');
    const paint = surface.color ?? fromHex(PALETTE[0]);
    color.value = toHex(paint);
    if (document.activeElement !== isovalue) {
      isovalue.value = String(surface.isovalue ?? 0);
    }
    opacity.value = String(paint.alpha ?? 0);
    opacity.setAttribute('aria-valuetext', percent(paint.alpha ?? 0));
    /** @type {HTMLElement} */ (page.surfaces.children[i].querySelector('.figure')).textContent = percent(paint.alpha ?? 0);
    /** @type {HTMLButtonElement} */ (page.surfaces.children[i].querySelector('.remove')).disabled = surfaces.length === 1;
  });
}
