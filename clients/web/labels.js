// The labels of a dataset, in the section of surfaces: a check box, a colour and a name each, and an opacity where
// one is shown.
//
// A label that is checked is a surface of this label alone. Sets of several labels stand in the list
// of surfaces (surfaces.js).
// @ts-check

import { byId, make, page } from './elements.js';
import { changeSurface } from './histogram.js';
import { MAX_SURFACES, allLabels, asShown, colorOfLabel, indexOfLabel, isOfLabels, labelsOf, nameOfLabels, valuesOfText, withLabels } from './label-sets.js';
import { say } from './messages.js';
import { change, finiteRangeOf, shown } from './page-view.js';
import { fromHex, percent, toHex } from './values.js';

/** More rows make the page slow; the field below the list takes every label. */
const MAX_ROWS = 500;

const surfacesNow = () => shown.state.surfaces ?? [];
const rangeNow = () => finiteRangeOf(shown.dataset, shown.state.selection);

/** @param {number[]} values */
function addLabels(values) {
  if (surfacesNow().length >= MAX_SURFACES) {
    say(`A picture has at most ${MAX_SURFACES} surfaces.`, true);
    drawLabels();
    return;
  }
  change({ surfaces: withLabels(surfacesNow(), values, shown.dataset, rangeNow()) });
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

/** @param {number} value */
function rowOf(value) {
  const name = nameOfLabels(shown.dataset, [value]);
  return make('li', { 'data-label': String(value) },
    make('label', { className: 'switch', title: `${name} (${value})` },
      make('input', { type: 'checkbox', onchange: (/** @type {any} */ event) => {
        if (event.target.checked) {
          addLabels([value]);
        } else {
          removeSurface(indexOfLabel(surfacesNow(), value));
        }
      } }), make('span', { className: 'name' }, name)),
    make('input', { type: 'range', min: '0.05', max: '1', step: '0.05', title: 'Opacity', 'aria-label': `Opacity of ${name}`,
      oninput: (/** @type {any} */ event) => repaint(value, (now) => ({ ...now, alpha: event.target.valueAsNumber })) }),
    make('input', { type: 'color', title: 'Colour', 'aria-label': `Colour of ${name}`,
      oninput: (/** @type {any} */ event) => repaint(value, (now) => ({ ...fromHex(event.target.value), alpha: now.alpha })) }));
}

let labelsDrawn = '';
export function drawLabels() {
  const { dataset } = shown;
  const labels = labelsOf(dataset);
  page.labels.hidden = labels.length === 0 && !surfacesNow().some(isOfLabels);
  const values = labels.slice(0, MAX_ROWS).map((label) => label.value ?? 0);
  // Controls under the pointer must not be replaced.
  const form = JSON.stringify([dataset?.datasetId, values, labels.slice(0, MAX_ROWS).map(({ name }) => name)]);
  if (form !== labelsDrawn) {
    labelsDrawn = form;
    page.labelList.replaceChildren(...values.map(rowOf));
    page.labelsMore.hidden = labels.length <= MAX_ROWS;
    page.labelsMore.textContent = `and ${(labels.length - MAX_ROWS).toLocaleString('en')} more, for the field below`;
  }
  values.forEach((value, i) => {
    const [check, opacity, color] = page.labelList.children[i].querySelectorAll('input');
    const surface = surfacesNow()[indexOfLabel(surfacesNow(), value)];
    const paint = surface?.color ?? colorOfLabel(dataset, value);
    check.checked = surface !== undefined;
    color.value = toHex(paint);
    color.disabled = opacity.hidden = surface === undefined;
    opacity.value = String(paint.alpha ?? 0);
    opacity.setAttribute('aria-valuetext', percent(paint.alpha ?? 0));
  });
}

export function listenToLabels() {
  byId('labels-all', HTMLElement).onclick = () => {
    const all = allLabels(shown.dataset);
    if (all.length > MAX_SURFACES) {
      say(`There are ${all.length.toLocaleString('en')} labels, and a picture has at most ${MAX_SURFACES} surfaces: choose some, ` +
        'or join several, as 3,7-9, in the field below the list.', true);
    } else if (all.length > 0) {
      change({ surfaces: all });
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
}
