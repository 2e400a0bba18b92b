// The panel of moves and keys, and of what runs here.
// @ts-check

import { abilities } from './abilities.js';
import { byId, make } from './elements.js';

/** @type {[string, [string, string][]][]} */
const MOVES = [
  ['Mouse', [['drag', 'turn'], ['Shift or right button and drag', 'move'], ['wheel; Ctrl and drag', 'zoom'],
    ['click', 'pick a point'], ['another click', 'measure the distance'], ['double-click', 'bring the point to the middle']]],
  ['Touch', [['one finger', 'turn'], ['two fingers', 'move, zoom and roll'], ['tap', 'pick a point']]],
  ['Keys', [['arrows', 'turn by 5°'], ['Shift and arrows', 'move'], ['+ −', 'zoom'], [', .', 'roll'], ['0', 'fit, from here'], ['Home', 'the first look'],
    ['1 … 6', 'look from a side'], ['p', 'parallel projection'], ['b', 'box around the volume'],
    ['Enter', 'pick the point in the middle'], ['[ ]', 'one step back or on'], ['Space', 'play or rest'],
    ['Ctrl-Z', 'undo'], ['Ctrl-Shift-Z, Ctrl-Y', 'redo'], ['?', 'this panel']]],
  ['Histogram', [['drag a line', 'change an isovalue'], ['double-click', 'add a surface']]],
];

const dialog = byId('help', HTMLDialogElement);

function showHelp() {
  byId('help-version', HTMLElement).textContent = abilities.version ? `Isoscope ${abilities.version}` : 'Isoscope, of a version that does not tell';
  if (!dialog.open) {
    dialog.showModal();
  }
}

export function listenToHelp() {
  byId('help-moves', HTMLElement).replaceChildren(...MOVES.map(([title, moves]) => make('section', {}, make('h3', {}, title),
    make('dl', {}, ...moves.flatMap(([move, does]) => [make('dt', {}, move), make('dd', {}, does)])))));
  byId('help-open', HTMLElement).onclick = showHelp;
  document.addEventListener('keydown', (event) => {
    const isInText = /** @type {Element} */ (event.target).closest('input:is([type=number], [type=text], [type=search], [type=password]), textarea, select, dialog, form');
    if (event.key === '?' && !event.ctrlKey && !event.metaKey && !isInText) {
      event.preventDefault();
      showHelp();
    }
  });
}
