// The window of the samples on cuts: percentiles of the samples inside, or two samples.
// @ts-check

import { abilities } from './abilities.js';
import { make, page } from './elements.js';
import { say } from './messages.js';
import { change, shown } from './page-view.js';
import { CAP_WINDOW } from './view-state.js';

/** Whether the coordinator finds windows; older ones refuse the question. */
const isOffered = () => abilities.features.includes('color_ranges');

/** What cuts show: `page.caps` has a choice for each. */
export const capsOf = (/** @type {string} */ choice) => choice === 'open' ? undefined : choice === 'filled' ? {}
  : { colorMap: 'COLOR_MAP_GREY', ...(isOffered() ? { range: CAP_WINDOW } : {}) };

/**
 * The range that the last picture had on its cuts.
 * @type {any}
 */
let capsRange = null;

/** @param {any} frame of the response */
export function takeCapsColoring(frame) {
  if (frame) {
    capsRange = frame.capsColoring?.caps?.range ?? null;
    drawWindow();
  }
}

/** @param {any} range */
const setWindow = (range) => {
  const { range: gone, ...caps } = shown.state.caps ?? {};
  change({ caps: range ? { ...caps, range } : caps });
};

const windowLow = /** @type {HTMLInputElement} */ (make('input', { id: 'window-low', type: 'number', step: 'any', ariaLabel: 'Least sample of the window' }));
const windowHigh = /** @type {HTMLInputElement} */ (make('input', { id: 'window-high', type: 'number', step: 'any', ariaLabel: 'Greatest sample of the window' }));
const windowRow = make('div', { className: 'row', hidden: true }, make('label', {}, 'Window'), windowLow, windowHigh);
const windowButtons = make('div', { className: 'row', hidden: true }, make('span', {}),
  make('button', { id: 'window-percentiles', className: 'small', title: 'From the 2nd to the 98th percentile of the samples inside',
    onclick: () => setWindow(CAP_WINDOW) }, '2 to 98 %'),
  make('button', { id: 'window-all', className: 'small', title: 'All samples', onclick: () => setWindow(null) }, 'All'));

function changeWindow() {
  const [min, max] = [windowLow, windowHigh].map(({ value, placeholder }) => parseFloat(value || placeholder));
  if (!Number.isFinite(min) || !Number.isFinite(max)) {
    return;  // the other end is missing
  }
  if (!(max > min)) {
    say('The greatest sample of the window must be above the least one.', true);
    return;
  }
  setWindow({ min, max });
}

export function drawWindow() {
  const { caps } = shown.state;
  windowRow.hidden = !caps?.colorMap;
  windowButtons.hidden = windowRow.hidden || !isOffered();
  for (const [input, end] of /** @type {[HTMLInputElement, 'min' | 'max'][]} */ ([[windowLow, 'min'], [windowHigh, 'max']])) {
    const isNumber = caps?.range && !caps.range.percentiles;
    if (document.activeElement !== input) {
      input.value = isNumber ? String(caps.range[end] ?? 0) : '';
    }
    input.placeholder = capsRange ? String(Number(Number(capsRange[end] ?? 0).toPrecision(4))) : '';
  }
}

export function listenToCapWindow() {
  windowLow.onchange = windowHigh.onchange = changeWindow;
  page.caps.closest('.row')?.after(windowRow, windowButtons);
}
