// The one view of the page: its address, token and theme, and how a control changes it.
//
// The view's state (a RenderIsosurfaceRequest as JSON) is the only state. A control changes it by
// `change`. Controls are drawn from it by `redraw`, once in an animation frame.
// @ts-check

import { Client, lengthUnitOf, mount } from './isoscope-view.js';
import { DEFAULT_LIMITS } from './levels.js';
import { asksFirstLook, stateFromHash, tokenOfHash, withMaterialOf, withoutToken } from './view-state.js';
import { needsColor } from './label-sets.js';
import { choiceOf } from './series.js';
import { byId } from './elements.js';
import { announcer } from './messages.js';
import { BACKGROUNDS, fromHex, paintedApart, toHex } from './values.js';

/** @typedef {import('./isoscope-view.js').FrameRequest} FrameRequest */

const TOKEN_KEY = `isoscope-token ${new URL('./', document.baseURI).pathname}`;

/**
 * Keeps the token for reloads of this tab. It is not stored as a cookie: browsers send those to every port of a host,
 * and other users may listen there.
 * @param {string} token
 */
function keepToken(token) {
  try {
    sessionStorage.setItem(TOKEN_KEY, token);
  } catch {
    // The browser stores nothing for pages.
  }
}

function keptToken() {
  try {
    return sessionStorage.getItem(TOKEN_KEY) ?? '';
  } catch {
    return '';
  }
}

/**
 * Removes the token from the address, so that no screenshot and no link but one with access shows it. It is after '?'
 * in addresses that servers print, and after '#' in links with access, which no server and no log sees.
 * @returns {string} '' if there is none
 */
function takeToken() {
  const address = new URL(location.href);
  const given = address.searchParams.get('token') ?? tokenOfHash(address.hash);
  if (address.searchParams.has('token') || tokenOfHash(address.hash)) {
    address.searchParams.delete('token');
    address.hash = withoutToken(address.hash);
    history.replaceState(null, '', address);
  }
  if (given) {
    keepToken(given);
  }
  return given;
}

const token = takeToken() || keptToken();
export const client = new Client('', token);
const query = new URLSearchParams(location.search);
/** @type {any} */
const renderer = query.get('renderer') ?? 'auto';

// ---- theme ----

/** @returns {'dark' | 'light'} */
export const theme = () => document.documentElement.dataset.theme === 'light' ? 'light' : 'dark';
/** @param {string} name */
function setTheme(name) {
  const before = BACKGROUNDS[theme()];
  document.documentElement.dataset.theme = name;
  const { backgroundColor } = view?.state ?? {};
  if (view && (!backgroundColor || toHex(backgroundColor) === before)) {
    view.update({ backgroundColor: fromHex(BACKGROUNDS[theme()]) });
  }
}
/** @type {import('./isoscope-view.js').View | null} */
let view = null;
setTheme(query.get('theme') ?? localStorage.getItem('isoscope-theme') ??
  (matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark'));
byId('theme', HTMLElement).onclick = () => {
  setTheme(theme() === 'dark' ? 'light' : 'dark');
  localStorage.setItem('isoscope-theme', theme());
};

// ---- the view ----

/** Returns the view of the address: after '#', else what `isoscope view` names after '?'. */
export function stateOfAddress() {
  if (location.hash.length > 1) {
    return stateFromHash(location.hash);
  }
  const words = [...query].filter(([name]) => ['dataset', 'isovalue', 'surface', 'label', 'labels', 'smooth-labels', 'field', 'component', 'step', 'time', 'level', 'max-spacing'].includes(name));
  return stateFromHash(new URLSearchParams(words).toString());
}

export const start = stateOfAddress();

/**
 * Whether the surfaces of a state are known, with their colours, also without its dataset.
 * @param {FrameRequest} state
 */
export const hasColors = ({ surfaces }) => Boolean(surfaces) && !surfaces.some(needsColor) &&
  paintedApart(surfaces).every((/** @type {any} */ one, /** @type {number} */ i) => one === surfaces[i]);

export const shown = mount(byId('view', HTMLElement), { renderer,
  // Without colours that only the dataset knows, or a camera, `open` sets it later.
  state: hasColors(start.state) && !asksFirstLook(start.state) ? start.state : undefined,
  maxSide: Number(query.get('max-side')) || undefined, token, limits: start.limits ?? DEFAULT_LIMITS, announce: (sentence) => announcer.say(sentence) });
view = shown;
// For users of the console, and for tests.
/** @type {any} */ (window).isoscope = { view: shown, client };

/** @param {string} given from now on */
export function setToken(given) {
  keepToken(given);
  client.token = given;
  shown.setToken(given);
}

/**
 * Takes the token of a link with access that was opened in this page.
 * @returns {string} '' if there is none
 */
export function takeTokenAgain() {
  const given = takeToken();
  if (given && given !== client.token) {
    setToken(given);
  }
  return given;
}

/**
 * Changes the state. New surfaces get the material of the others.
 * @param {FrameRequest} part @param {boolean} [isMoving]
 */
export function change(part, isMoving = false) {
  shown.update(part.surfaces ? { ...part, surfaces: withMaterialOf(part.surfaces, shown.state.surfaces ?? []) } : part, { isMoving });
}

/** Behind a length: its unit, if it is known. */
export const unit = () => ` ${lengthUnitOf(shown.dataset)}`.trimEnd();

/**
 * The samples of what is shown: of a field, or of the dataset.
 * @param {any} dataset @param {any} selection
 */
export const samplesOf = (dataset, selection) => choiceOf(dataset, selection)?.component ?? dataset ?? {};

/**
 * The range of their finite values; undefined if there are none.
 * @param {any} dataset @param {any} selection
 */
export function finiteRangeOf(dataset, selection) {
  const { finiteRange, valueRange } = samplesOf(dataset, selection);
  return finiteRange ?? valueRange;
}

/** Draws all controls; page.js sets it. @type {() => void} */
let drawControls = () => {};
/** @param {() => void} draw what `redraw` calls */
export function drawControlsBy(draw) {
  drawControls = draw;
}

let isRedrawing = false;
export function redraw() {
  if (!isRedrawing) {
    isRedrawing = true;
    requestAnimationFrame(() => {
      isRedrawing = false;
      drawControls();
    });
  }
}
