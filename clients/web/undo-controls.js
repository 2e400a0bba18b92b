// The buttons and keys of undo and redo, and when a change of the view becomes an entry.
// @ts-check

import { byId } from './elements.js';
import { shown } from './page-view.js';
import { Undo } from './undo.js';
import { stateToHash } from './view-state.js';

/** @typedef {import('./isoscope-view.js').FrameRequest} FrameRequest */

/** A change is an entry when nothing has changed for so long, in milliseconds. */
const REST_MS = 400;

const back = byId('undo', HTMLButtonElement);
const on = byId('redo', HTMLButtonElement);
/** @type {Undo<FrameRequest>} */
export const undo = new Undo(stateToHash);

let restTimer = 0;
let isHeld = false;
/** How many states of before are on their way to the view: until then it shows what was undone, which is no new entry. */
let awaitedCount = 0;
/** Whether a play changes the view. */
let isPlaying = () => false;

function draw() {
  back.disabled = !undo.canUndo;
  on.disabled = !undo.canRedo;
}

/** Keeps the state of now, once its camera is known and the page has filled in what a link leaves out. */
function rest() {
  clearTimeout(restTimer);
  const state = shown.getState();
  if (awaitedCount === 0 && shown.hasState && state.camera && !state.cameraFit && state.dataset && state.backgroundColor) {
    undo.rested(state);
    draw();
  }
}

function restLater() {
  clearTimeout(restTimer);
  if (!isHeld && !isPlaying()) {
    restTimer = window.setTimeout(rest, REST_MS);
  }
}

/** @param {KeyboardEvent} event */
function directionOf({ key, shiftKey, ctrlKey, metaKey, altKey }) {
  const name = key.toLowerCase();
  return !(ctrlKey || metaKey) || altKey ? 0 : name === 'z' ? (shiftKey ? 1 : -1) : name === 'y' && !shiftKey ? 1 : 0;
}

/**
 * @param {(state: FrameRequest) => Promise<void> | void} show shows a state of before, at once or later @param {() => boolean} playing
 */
export function listenToUndo(show, playing) {
  isPlaying = playing;
  shown.addEventListener('state', restLater);
  /** @param {boolean} held */
  const hold = (held) => {
    isHeld = held;
    restLater();
  };
  window.addEventListener('pointerdown', () => hold(true), true);
  window.addEventListener('pointerup', () => hold(false), true);
  window.addEventListener('pointercancel', () => hold(false), true);
  // The list of a select takes the release of its button.
  window.addEventListener('pointermove', ({ buttons }) => isHeld && buttons === 0 && hold(false), true);
  /** @param {-1 | 1} direction */
  const go = async (direction) => {
    rest();
    const state = direction < 0 ? undo.undo() : undo.redo();
    draw();
    if (state) {
      awaitedCount += 1;
      try {
        await show(structuredClone(state));
      } finally {
        awaitedCount -= 1;
        restLater();
      }
    }
  };
  back.onclick = () => go(-1);
  on.onclick = () => go(1);
  document.addEventListener('keydown', (event) => {
    const direction = directionOf(event);
    // Fields for text have an undo of their own.
    const isInText = /** @type {Element} */ (event.target).closest('input:is([type=number], [type=text], [type=search], [type=password]), textarea, dialog');
    if (direction !== 0 && !isInText) {
      event.preventDefault();
      go(direction);
    }
  });
  draw();
}
