// The labels of a dataset, in the section of surfaces: a check box, a name and a colour each, and an opacity where one is
// shown. They are those with names, else those that the samples suggest.
//
// A label that is checked is a surface of this label alone. Sets of several labels stand in the list
// of surfaces (surfaces.js). A label is chosen by its name here, or in the picture: it can be shown alone, hidden or
// highlighted.
// @ts-check

import { abilities } from './abilities.js';
import { byId, make, page } from './elements.js';
import { changeSurface, suggestedLabels } from './histogram.js';
import { MAX_SURFACES, allLabels, areSmooth, asShown, colorOfLabel, foundLabels, indexOfLabel, indexWithLabel, isOfLabels, labelsOf, nameOfLabels,
  onlyLabel, valuesOfText, withHighlight, withLabels, withSmooth } from './label-sets.js';
import { say } from './messages.js';
import { change, finiteRangeOf, redraw, shown } from './page-view.js';
import { fromHex, percent, toHex } from './values.js';

/** More rows make the page slow; the search finds, and the field below the list takes every label. */
const MAX_ROWS = 500;
/** So many rows are seen without scrolling. */
const MIN_SEARCHED = 10;

const surfacesNow = () => shown.state.surfaces ?? [];
const rangeNow = () => finiteRangeOf(shown.dataset, shown.state.selection);
/** @returns {import('./label-sets.js').Label[]} */
export const knownLabels = () => labelsOf(shown.dataset).length > 0 ? labelsOf(shown.dataset) : suggestedLabels().map((/** @type {number} */ value) => ({ value }));

/** @param {any[]} surfaces new ones are as smooth as those there are */
const changeLabels = (surfaces) => change({ surfaces: withSmooth(surfaces, areSmooth(surfacesNow())) });

/** @param {number[]} values */
function addLabels(values) {
  if (surfacesNow().length >= MAX_SURFACES) {
    say(`A picture has at most ${MAX_SURFACES} surfaces.`, true);
    drawLabels();
    return;
  }
  changeLabels(withLabels(surfacesNow(), values, shown.dataset, rangeNow()));
}

/** @param {number} index */
export function removeSurface(index) {
  change({ surfaces: asShown(surfacesNow().filter((/** @type {any} */ _, /** @type {number} */ i) => i !== index), rangeNow()) });
}

/**
 * Paints the surface of a label.
 * @param {number} value @param {(now: any) => any} paint
 */
function repaint(value, paint) {
  const index = indexOfLabel(surfacesNow(), value);
  if (index >= 0) {
    changeSurface(index, { color: paint(surfacesNow()[index].color ?? colorOfLabel(shown.dataset, value)) }, true);
  }
}

// ---- the chosen label ----

/** @type {number | null} */
let chosen = null;
/** The dataset that it is one of. */
let chosenOf = '';
/**
 * The surfaces before the highlight, and with it, as text: another change ends it.
 * @type {{before: any[], after: string} | null}
 */
let highlight = null;
const isHighlighted = () => highlight !== null && highlight.after === JSON.stringify(surfacesNow());

/**
 * Chooses a label: of the list, or of a point of the picture.
 * @param {number} value @param {boolean} [toggles] whether it may be chosen already, and is no more then
 */
export function pickLabel(value, toggles = false) {
  chosen = toggles && chosen === value ? null : value;
  drawLabels();
  page.labelList.querySelector('.chosen')?.scrollIntoView({ block: 'nearest' });
}

function drawActions() {
  const index = chosen === null ? -1 : indexWithLabel(surfacesNow(), chosen);
  page.labelActions.hidden = chosen === null;
  if (chosen !== null) {
    const name = page.labelActions.querySelector('.name');
    if (name) {
      name.textContent = nameOfLabels(shown.dataset, index >= 0 ? surfacesNow()[index].labels : [chosen]);
    }
    byId('label-hide', HTMLButtonElement).disabled = index < 0;
    page.labelHighlight.disabled = index < 0 && !isHighlighted();
    page.labelHighlight.setAttribute('aria-pressed', String(isHighlighted()));
  }
}

function listenToActions() {
  /** @param {(index: number, value: number) => void} act with the place of the chosen label's surface, or -1 */
  const onChosen = (act) => () => chosen !== null && act(indexWithLabel(surfacesNow(), chosen), chosen);
  byId('label-only', HTMLElement).onclick = onChosen((index, value) => changeLabels(index >= 0 ? onlyLabel(surfacesNow(), index)
    : withLabels(surfacesNow().filter((/** @type {any} */ one) => !isOfLabels(one)), [value], shown.dataset, rangeNow())));
  byId('label-hide', HTMLElement).onclick = onChosen((index) => index >= 0 && removeSurface(index));
  page.labelHighlight.onclick = onChosen((index) => {
    if (highlight && isHighlighted()) {
      change({ surfaces: highlight.before });
      highlight = null;
    } else if (index >= 0) {
      const after = withHighlight(surfacesNow(), index, shown.dataset);
      highlight = { before: structuredClone(surfacesNow()), after: JSON.stringify(after) };
      change({ surfaces: after });
    }
  });
}

// ---- the list ----

/** @param {number} value */
function rowOf(value) {
  const name = nameOfLabels(shown.dataset, [value]);
  return make('li', { 'data-label': String(value) },
    make('input', { type: 'checkbox', 'aria-label': `Show ${name}`, onchange: (/** @type {any} */ event) => {
      if (event.target.checked) {
        addLabels([value]);
      } else {
        removeSurface(indexOfLabel(surfacesNow(), value));
      }
    } }),
    make('button', { className: 'name', title: `${name} (${value}): choose it`, onclick: () => pickLabel(value, true) }, name),
    make('input', { type: 'range', min: '0.05', max: '1', step: '0.05', title: 'Opacity', 'aria-label': `Opacity of ${name}`,
      oninput: (/** @type {any} */ event) => repaint(value, (now) => ({ ...now, alpha: event.target.valueAsNumber })) }),
    make('input', { type: 'color', title: 'Colour', 'aria-label': `Colour of ${name}`,
      oninput: (/** @type {any} */ event) => repaint(value, (now) => ({ ...fromHex(event.target.value), alpha: now.alpha })) }));
}

let labelsDrawn = '';
export function drawLabels() {
  const { dataset } = shown;
  if (dataset && dataset.name !== chosenOf) {
    if (chosenOf) {
      chosen = null;
      page.labelSearch.value = '';
    }
    chosenOf = dataset.name;
  }
  const labels = knownLabels();
  page.labels.hidden = labels.length === 0 && !surfacesNow().some(isOfLabels);
  page.labelSearch.hidden = labels.length < MIN_SEARCHED;
  page.labelSearch.placeholder = `Search ${labels.length.toLocaleString('en')} labels`;
  const found = foundLabels(labels, page.labelSearch.hidden ? '' : page.labelSearch.value);
  const values = found.slice(0, MAX_ROWS).map((label) => label.value ?? 0);
  // Controls under the pointer must not be replaced.
  const form = JSON.stringify([dataset?.datasetId, values, found.slice(0, MAX_ROWS).map(({ name }) => name)]);
  if (form !== labelsDrawn) {
    labelsDrawn = form;
    page.labelList.replaceChildren(...values.map(rowOf));
    page.labelsMore.textContent = found.length > MAX_ROWS ? `and ${(found.length - MAX_ROWS).toLocaleString('en')} more, for the search or the field below`
      : labels.length > 0 && found.length === 0 ? 'No label has that in its name.' : '';
    page.labelsMore.hidden = page.labelsMore.textContent === '';
  }
  values.forEach((value, i) => {
    const row = page.labelList.children[i];
    const [check, opacity, color] = row.querySelectorAll('input');
    const surface = surfacesNow()[indexOfLabel(surfacesNow(), value)];
    const paint = surface?.color ?? colorOfLabel(dataset, value);
    row.classList.toggle('chosen', value === chosen);
    check.checked = surface !== undefined;
    color.value = toHex(paint);
    color.disabled = opacity.hidden = surface === undefined;
    opacity.value = String(paint.alpha ?? 0);
    opacity.setAttribute('aria-valuetext', percent(paint.alpha ?? 0));
  });
  page.smoothSwitch.hidden = !abilities.features.includes('smooth_labels') || !surfacesNow().some(isOfLabels);
  page.labelsSmooth.checked = areSmooth(surfacesNow());
  drawActions();
}

export function listenToLabels() {
  byId('labels-all', HTMLElement).onclick = () => {
    const all = allLabels(shown.dataset, knownLabels());
    if (all.length > MAX_SURFACES) {
      say(`There are ${all.length.toLocaleString('en')} labels, and a picture has at most ${MAX_SURFACES} surfaces: choose some, ` +
        'or join several, as 3,7-9, in the field below the list.', true);
    } else if (all.length > 0) {
      changeLabels(all);
    }
  };
  byId('labels-none', HTMLElement).onclick = () =>
    change({ surfaces: asShown(surfacesNow().filter((/** @type {any} */ one) => !isOfLabels(one)), rangeNow()) });
  const add = () => {
    const values = valuesOfText(page.labelSet.value, labelsOf(shown.dataset));
    if (values) {
      page.labelSet.value = '';
      addLabels(values);
    } else {
      say('A set of labels has values, ranges and names, with commas between: 3,7-9. It has at most 256 values.', true);
    }
  };
  byId('add-labels', HTMLElement).onclick = add;
  page.labelSet.onkeydown = (event) => {
    if (event.key === 'Enter') {
      add();
    }
  };
  page.labelSearch.oninput = () => redraw();
  page.labelsSmooth.onchange = () => change({ surfaces: withSmooth(surfacesNow(), page.labelsSmooth.checked) });
  listenToActions();
}
