// Ranges of colours: of what is visible, and of a field those of the step that is shown, and of all steps.
// @ts-check

import { abilities } from './abilities.js';
import { byId } from './elements.js';
import { boxOfDataset } from './isoscope-view.js';
import { say } from './messages.js';
import { client, shown } from './page-view.js';
import { choiceOf, histogramWords, indexOfStep, rangeOfBins, stepsOf } from './series.js';
import { isSameRange, tidyRange, unitedRange } from './values.js';

/** @typedef {{min: number, max: number}} Range */

const visible = byId('range-visible', HTMLButtonElement);
const thisStep = byId('range-step', HTMLButtonElement);
const allSteps = byId('range-all', HTMLButtonElement);

/** The scalar that colours the surfaces, and the step of it that is shown; null without one. */
function coloring() {
  const { dataset, state } = shown;
  const colorBy = (state.surfaces ?? []).find((/** @type {any} */ { colorBy: one }) => one?.quantity === 'QUANTITY_FIELD')?.colorBy;
  const choice = colorBy && choiceOf(dataset, colorBy);
  if (!choice) {
    return null;
  }
  const steps = stepsOf(dataset, choice.field);
  const selection = { ...state.selection, field: choice.field.name, component: choice.component.name };
  return { choice, selection, stepCount: steps.length, isServed: steps.length === 0 || indexOfStep(steps, selection) >= 0 };
}

/** @param {any} selection a scalar and a step */
const addressOfCounts = (selection) =>
  `v1/datasets/${encodeURIComponent(shown.dataset?.name ?? '')}/histogram?bins=4096${histogramWords(shown.dataset, selection)}`;

/** @param {any} component @returns {Range | null} of its finite values over all steps */
function wholeRange({ finiteRange, valueRange }) {
  const { min = 0, max = 0 } = finiteRange ?? valueRange ?? {};
  return finiteRange || valueRange ? { min: Number(min), max: Number(max) } : null;
}

/** @param {any} surface whether its colour is that of a map */
const isMapped = ({ colorBy }) => Boolean(colorBy) && colorBy.quantity !== 'QUANTITY_NORMAL';
/** What the maps show, as text. */
const mappedNow = () => JSON.stringify([shown.state.dataset, (shown.state.surfaces ?? []).map((/** @type {any} */ { colorBy }) =>
  [colorBy?.quantity, colorBy?.field, colorBy?.component])]);
/** @param {any} surface whether nothing is seen of it */
const isClear = ({ color }) => Boolean(color) && !color.alpha;

/**
 * The ranges of what each mapped surface shows, by its place. They depend on the picture's pixels; only the ranges are
 * wanted, so the picture itself is sent as small as it gets.
 * @param {(surface: any) => any} colorByOf what the map of a surface shows @returns {Promise<Map<number, Range>>}
 */
async function askVisible(colorByOf) {
  const { withNotes, withUnresolvedCount, samples, ambientOcclusion, silhouette, ...state } = shown.getState();
  const { width, height } = shown.loop.picture;
  const surfaces = (state.surfaces ?? []).map((/** @type {any} */ surface) =>
    isMapped(surface) ? { ...surface, colorBy: { ...colorByOf(surface), range: { source: 'SOURCE_VISIBLE' } } } : surface);
  const answer = await client.post(`v1/datasets/${encodeURIComponent(state.dataset ?? '')}/render`, { ...state, surfaces,
    viewport: { widthPx: width, heightPx: height }, backgroundColor: { red: 0, green: 0, blue: 0, alpha: 1 },
    output: { imageFormat: 'IMAGE_FORMAT_JPEG', jpegQuality: 1 } });
  const { caps, ...ranges } = JSON.parse(answer.headers.get('X-Isoscope-Color-Ranges') ?? '{}');
  return new Map(Object.entries(ranges).filter(([i]) => !isClear(surfaces[Number(i)])).map(([i, [min, max]]) => [Number(i), { min, max }]));
}

/**
 * The range of the values that the picture shows, of all maps together. For a surface that does not show, behind another
 * one say, the answer has the range of all values. Then positions tell: those that show do not fill the volume's box.
 * @returns {Promise<Range | null>} null where no value shows
 */
async function visibleRange() {
  const ranges = await askVisible(({ colorBy }) => colorBy);
  const whole = unitedRange([...ranges.values()]);
  const doubtful = [...ranges].filter(([, range]) => isSameRange(range, whole));
  const box = boxOfDataset(shown.dataset);
  if (doubtful.length === ranges.size || !box) {
    return whole;
  }
  const places = await askVisible(() => ({ quantity: 'QUANTITY_POSITION_X' }));
  for (const [i] of doubtful) {
    if (isSameRange(places.get(i), { min: box.min[0], max: box.max[0] })) {
      ranges.delete(i);
    }
  }
  return unitedRange([...ranges.values()]);
}

export function drawColorRange() {
  const shownColoring = coloring();
  visible.hidden = !abilities.features.includes('color_ranges') || !(shown.state.surfaces ?? []).some(isMapped);
  document.querySelectorAll('[data-for=range]').forEach((row) => {
    /** @type {HTMLElement} */ (row).hidden = visible.hidden && shownColoring === null;
  });
  thisStep.hidden = allSteps.hidden = shownColoring === null;
  if (shownColoring) {
    const isSeries = shownColoring.stepCount > 1;
    thisStep.hidden = !isSeries;
    thisStep.disabled = !shownColoring.isServed;
    allSteps.textContent = isSeries ? 'All steps' : 'Whole range';
  }
}

/** @param {(range: Range) => void} setRange of the colours */
export function listenToColorRange(setRange) {
  /** @param {Range | null} range */
  const take = (range) => {
    if (range && range.max > range.min) {
      setRange(tidyRange(range));
    } else {
      say(range ? `All values are ${range.min}: they have one colour.` : 'The range of the values is not known.', true);
    }
  };
  visible.onclick = async () => {
    visible.disabled = true;
    const mapped = mappedNow();
    try {
      const range = await visibleRange();
      if (mappedNow() === mapped) {  // else they are other values now
        take(range);
      }
    } catch (error) {
      say(/** @type {Error} */ (error).message, true);
    }
    visible.disabled = false;
  };
  allSteps.onclick = () => {
    const now = coloring();
    if (now) {
      take(wholeRange(now.choice.component));
    }
  };
  thisStep.onclick = async () => {
    const now = coloring();
    if (!now) {
      return;
    }
    thisStep.disabled = true;
    try {
      const address = addressOfCounts(now.selection);
      const answer = await client.get(address);
      const after = coloring();
      if (after && addressOfCounts(after.selection) === address) {  // else another one was chosen meanwhile
        take(rangeOfBins(answer, wholeRange(now.choice.component)));
      }
    } catch (error) {
      say(/** @type {Error} */ (error).message, true);
    }
    thisStep.disabled = false;
  };
}
