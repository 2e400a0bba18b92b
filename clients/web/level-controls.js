// The level of the picture, what the exact one may cost, and the button that draws it in any case.
// @ts-check

import { abilities } from './abilities.js';
import { byId, make } from './elements.js';
import { DEFAULT_SPACING_PX, levelKey, levelMenu, levelOfKey } from './levels.js';
import { announcer, say } from './messages.js';
import { change, redraw, shown } from './page-view.js';
import { costText } from './view/refinement.js';

const levelRow = byId('level-row', HTMLElement);
const level = byId('level', HTMLSelectElement);
const spacing = byId('level-spacing', HTMLInputElement);
const limitRow = byId('limit-row', HTMLElement);
const seconds = byId('limit-seconds', HTMLInputElement);
const gigabytes = byId('limit-gigabytes', HTMLInputElement);
const offerBox = byId('exact-offer', HTMLElement);
const offerText = byId('exact-cost', HTMLElement);
const drawExact = byId('draw-exact', HTMLButtonElement);
const stage = byId('stage', HTMLElement);

let menuDrawn = '';
let offered = '';

/**
 * The limit in a field; null if it is empty, undefined if it is none.
 * @param {HTMLInputElement} field
 */
const limitIn = (field) => field.value === '' && !field.validity.badInput ? null : field.valueAsNumber > 0 ? field.valueAsNumber : undefined;

function changeLimits() {
  const [most, size] = [limitIn(seconds), limitIn(gigabytes)];
  if (most === undefined || size === undefined) {
    say('A limit of the exact picture is a number above 0. An empty field is no limit.', true);
    drawLevels();
    return;
  }
  shown.limits = { seconds: most, bytes: size === null ? null : size * 1e9 };
  // The link has them.
  shown.dispatchEvent(new CustomEvent('state', { detail: { state: shown.getState(), isMoving: false } }));
  redraw();
}

/** Shows what the exact picture would cost, where it is over a limit. */
export function drawOffer() {
  const { deferred } = shown;
  const text = deferred ? `exact: ${costText(deferred)}` : '';
  if (text === offered) {
    return;
  }
  offered = text;
  const hadFocus = document.activeElement === drawExact;
  offerBox.hidden = text === '';
  stage.classList.toggle('has-offer', text !== '');
  offerText.textContent = text;
  if (deferred) {
    announcer.say(`The exact picture is not drawn by itself: it would take ${costText(deferred)}. There is a button that draws it.`);
  } else if (hadFocus) {
    shown.root.focus({ preventScroll: true });
  }
}

export function listenToLevels() {
  level.onchange = () => change({ level: levelOfKey(level.value, spacing.valueAsNumber > 0 ? spacing.valueAsNumber : DEFAULT_SPACING_PX) });
  spacing.onchange = () => {
    if (spacing.valueAsNumber > 0) {
      change({ level: { maxSpacingPx: spacing.valueAsNumber } });
    } else {
      say('The distance of samples is a number of pixels above 0.', true);
      drawLevels();
    }
  };
  seconds.onchange = gigabytes.onchange = changeLimits;
  drawExact.onclick = () => {
    shown.drawExact();
    drawOffer();
  };
}

/**
 * Writes a number, unless people do.
 * @param {HTMLInputElement} field @param {number | null} value
 */
function write(field, value) {
  if (document.activeElement !== field) {
    field.value = value === null ? '' : String(value);
  }
}

export function drawLevels() {
  const choice = shown.state.level;
  const menu = levelMenu(shown.dataset);
  const words = JSON.stringify(menu);
  if (words !== menuDrawn) {
    menuDrawn = words;
    level.replaceChildren(...menu.map(([value, text]) => make('option', { value }, text)));
  }
  levelRow.hidden = menu.length === 0 || !abilities.features.includes('levels');
  level.value = levelKey(choice);
  spacing.hidden = level.value !== 'spacing';
  write(spacing, choice?.maxSpacingPx ?? DEFAULT_SPACING_PX);
  limitRow.hidden = !abilities.features.includes('refinement');
  const { limits } = shown;
  write(seconds, limits.seconds);
  write(gigabytes, limits.bytes === null ? null : limits.bytes / 1e9);
}
