// Ranges of the colours of a field: of the step that is shown, and of all steps.
// @ts-check

import { byId } from './elements.js';
import { say } from './messages.js';
import { client, shown } from './page-view.js';
import { choiceOf, histogramWords, indexOfStep, rangeOfBins, stepsOf } from './series.js';
import { tidyRange } from './values.js';

/** @typedef {{min: number, max: number}} Range */

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

/** @param {any} component @returns {Range | null} of its finite values over all steps */
function wholeRange({ finiteRange, valueRange }) {
  const { min = 0, max = 0 } = finiteRange ?? valueRange ?? {};
  return finiteRange || valueRange ? { min: Number(min), max: Number(max) } : null;
}

export function drawColorRange() {
  const shownColoring = coloring();
  document.querySelectorAll('[data-for=range]').forEach((row) => { /** @type {HTMLElement} */ (row).hidden = shownColoring === null; });
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
      const { dataset } = shown;
      const answer = await client.get(`v1/datasets/${encodeURIComponent(dataset?.name ?? '')}/histogram?bins=4096${histogramWords(dataset, now.selection)}`);
      const { choice } = coloring() ?? {};
      if (shown.dataset === dataset && choice?.word === now.choice.word) {  // else another one was chosen meanwhile
        take(rangeOfBins(answer, wholeRange(now.choice.component)));
      }
    } catch (error) {
      say(/** @type {Error} */ (error).message, true);
    }
    thisStep.disabled = false;
  };
}
