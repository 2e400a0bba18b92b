// Ranges of colours that the server finds: of what is visible, of the step, of all steps; and the
// window of the samples on cuts. Their numbers go into the state, so a link shows the same colours.
// @ts-check

import { make, page } from './elements.js';
import { announcer, say } from './messages.js';
import { change, client, shown } from './page-view.js';
import { format, outwards } from './values.js';
import { CAP_WINDOW } from './view-state.js';

/** Whether the coordinator finds ranges; older ones refuse the question. */
let isOffered = false;

/** What cuts show: `page.caps` has a choice for each. */
export const capsOf = (/** @type {string} */ choice) => choice === 'open' ? undefined : choice === 'filled' ? {}
  : { colorMap: 'COLOR_MAP_GREY', ...(isOffered ? { range: CAP_WINDOW } : {}) };

// ---- ranges of colours ----

/** @typedef {'SOURCE_VISIBLE' | 'SOURCE_STEP' | ''} Source '' of all steps, the default */

/**
 * The state with a range of all its maps; null is the default one.
 * @param {any} state @param {any} range
 */
const withRange = (state, range) => (state.surfaces ?? []).map((/** @type {any} */ surface) => {
  const { range: gone, ...colorBy } = surface.colorBy ?? {};
  return !surface.colorBy || colorBy.quantity === 'QUANTITY_NORMAL' ? surface
    : { ...surface, colorBy: range ? { ...colorBy, range } : colorBy };
});

/**
 * Asks for the range of all maps together. What is visible depends on the picture's pixels, and only
 * its answer is wanted, so the picture is sent as small as it gets.
 * @param {import('./series.js').SeriesControls} series @param {Source} source
 */
async function findRange(series, source) {
  const state = series.pinned(shown.getState());
  const { width, height } = shown.loop.picture;
  const viewport = source === 'SOURCE_VISIBLE' ? { widthPx: width, heightPx: height } : { widthPx: 16, heightPx: 16 };
  const { withNotes, samples, ambientOcclusion, silhouette, ...plain } = state;
  const response = await client.post(`v1/datasets/${encodeURIComponent(state.dataset ?? '')}/render`, { ...plain, viewport,
    surfaces: withRange(state, { source }), backgroundColor: { red: 0, green: 0, blue: 0, alpha: 1 },
    output: { imageFormat: 'IMAGE_FORMAT_JPEG', jpegQuality: 1 } });
  const { caps, ...ranges } = JSON.parse(response.headers.get('X-Isoscope-Color-Ranges') ?? '{}');
  const ends = /** @type {[number, number][]} */ (Object.values(ranges));
  return ends.length === 0 ? null
    : outwards(Math.min(...ends.map(([min]) => min)), Math.max(...ends.map(([, max]) => max)));
}

/** @param {import('./series.js').SeriesControls} series @param {HTMLElement} row @param {Source} source */
async function rescale(series, row, source) {
  const buttons = /** @type {HTMLButtonElement[]} */ ([...row.querySelectorAll('button')]);
  buttons.forEach((button) => { button.disabled = true; });
  try {
    const range = source ? await findRange(series, source) : null;
    change({ surfaces: withRange(shown.state, range) });
    announcer.say(range ? `Colours from ${format(range.min)} to ${format(range.max)}.` : 'Colours have the range of all steps.');
  } catch (error) {
    say(/** @type {Error} */ (error).message, true);
  }
  buttons.forEach((button) => { button.disabled = false; });
}

// ---- the window of cuts ----

/** The range that the last picture had on its cuts. @type {any} */
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
  windowButtons.hidden = windowRow.hidden || !isOffered;
  for (const [input, end] of /** @type {[HTMLInputElement, 'min' | 'max'][]} */ ([[windowLow, 'min'], [windowHigh, 'max']])) {
    const isNumber = caps?.range && !caps.range.percentiles;
    if (document.activeElement !== input) {
      input.value = isNumber ? String(caps.range[end] ?? 0) : '';
    }
    input.placeholder = capsRange ? String(Number(Number(capsRange[end] ?? 0).toPrecision(4))) : '';
  }
}

/** @param {import('./series.js').SeriesControls} series */
export function listenToColorRanges(series) {
  const row = make('div', { id: 'rescale', className: 'row' }, make('label', {}, 'Rescale to'));
  row.dataset.for = 'map';
  row.append(...(/** @type {[string, Source, string][]} */ ([['visible', 'SOURCE_VISIBLE', 'The values that the picture shows'],
    ['step', 'SOURCE_STEP', 'The values of this step'], ['all', '', 'The values of all steps']])).map(([name, source, title]) =>
    make('button', { id: `rescale-${name}`, className: 'small', title, onclick: () => rescale(series, row, source) },
      name === 'visible' ? 'what is visible' : name === 'step' ? 'this step' : 'all steps')));
  page.rangeMin.closest('.row')?.after(row);
  windowLow.onchange = windowHigh.onchange = changeWindow;
  page.caps.closest('.row')?.after(windowRow, windowButtons);
}

/** @param {boolean} isKnown whether the coordinator finds ranges */
export function offerColorRanges(isKnown) {
  isOffered = isKnown;
  const row = document.getElementById('rescale');
  for (const name of ['visible', 'step']) {
    const button = row?.querySelector(`#rescale-${name}`);
    if (button instanceof HTMLButtonElement) {
      button.hidden = !isKnown;
    }
  }
  drawWindow();
}
