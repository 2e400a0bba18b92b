// Sentences for people: the toast, the live regions of screen readers, the clipboard.
// @ts-check

import { Announcer } from './isoscope-view.js';
import { page } from './elements.js';

// The only live regions. While the dialog is open, screen readers ignore the page behind it.
export const announcer = new Announcer((sentence) => {
  (page.dialog.open ? page.dialogSpeech : page.speech).textContent = sentence;
});

let toastTimer = 0;
/** @param {string} sentence @param {boolean} [isError] */
export function say(sentence, isError = false) {
  announcer.say(sentence);
  page.toast.textContent = sentence;
  page.toast.classList.toggle('error', isError);
  page.toast.hidden = false;
  clearTimeout(toastTimer);
  toastTimer = window.setTimeout(() => { page.toast.hidden = true; }, isError ? 9000 : 2600);
}

/** @param {string} text @param {string} sentence */
export async function copy(text, sentence) {
  try {
    await navigator.clipboard.writeText(text);
    say(sentence);
  } catch {
    say(`The browser does not let this page copy. Copy it by hand:\n${text}`, true);
  }
}
