// The elements of a view, in a shadow tree with their style.
// @ts-check

import { AXES_PX, SCALE_BAR_PX } from './overlay.js';

const STYLE = `
:host { display: block; position: relative; }
.view { position: absolute; inset: 0; overflow: hidden; outline: none; touch-action: none; cursor: grab;
  background: #000; user-select: none; -webkit-user-select: none; }
.view:active { cursor: grabbing; }
.view:focus-visible { box-shadow: inset 0 0 0 2px #6aa8ff; }
canvas { position: absolute; inset: 0; width: 100%; height: 100%; display: block; }
canvas.plain { object-fit: contain; }
canvas.whole { image-rendering: pixelated; }
canvas.overlay { pointer-events: none; }
canvas.axes { inset: auto auto 0 0; width: ${AXES_PX}px; height: ${AXES_PX}px; }
canvas.scale-bar { inset: auto 20px 20px auto; width: ${SCALE_BAR_PX + 24}px; height: 38px; }
canvas[hidden] { display: none; }
.notice { position: absolute; left: 50%; bottom: var(--isoscope-notice-bottom, 26px); transform: translateX(-50%); box-sizing: border-box;
  width: max-content; max-width: min(620px, calc(100% - 32px)); padding: 10px 16px; border-radius: 10px;
  font: 14px/1.45 system-ui, sans-serif; color: #e6ecf5; background: rgba(22, 28, 38, .92);
  border: 1px solid rgba(255, 255, 255, .14); box-shadow: 0 8px 30px rgba(0, 0, 0, .35);
  user-select: text; -webkit-user-select: text; cursor: auto; white-space: pre-line; }
.notice[hidden] { display: none; }
.notice.error { border-color: #ff7b72; }
.notice.error::before { content: ''; display: inline-block; width: 8px; height: 8px; margin-right: 10px;
  border-radius: 50%; background: #ff7b72; }
.notice.busy::before { content: ''; display: inline-block; width: 10px; height: 10px; margin-right: 10px;
  border-radius: 50%; border: 2px solid #6aa8ff; border-right-color: transparent; box-sizing: border-box;
  animation: spin .8s linear infinite; vertical-align: -1px; }
@keyframes spin { to { transform: rotate(360deg); } }
@media (prefers-reduced-motion: reduce) { .notice.busy::before { animation: none; } }
.speech { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); }
.cross { position: absolute; left: 50%; top: 50%; width: 17px; height: 17px; transform: translate(-50%, -50%);
  pointer-events: none; display: none; filter: drop-shadow(0 0 1px #000); background:
  linear-gradient(#fff, #fff) center / 100% 1px no-repeat, linear-gradient(#fff, #fff) center / 1px 100% no-repeat; }
.view:focus-visible > .cross { display: block; }
`;

/**
 * @typedef {{host: HTMLElement, root: HTMLElement, notice: HTMLElement, speech: HTMLElement, cross: HTMLElement}} Elements
 *   `host` has the shadow tree, `root` gets the pointer and the keyboard; `speech` is the live region for screen readers.
 */

/**
 * Adds the elements of a view to another one.
 * @param {HTMLElement} element @param {{label?: string, isSpeaking: boolean}} options @returns {Elements}
 */
export function buildElements(element, { label, isSpeaking }) {
  const [host, root, notice, speech, cross] = Array.from({ length: 5 }, () => document.createElement('div'));
  host.className = 'isoscope-view';
  host.style.position = 'absolute';
  host.style.inset = '0';
  if (getComputedStyle(element).position === 'static') {
    element.style.position = 'relative';
  }
  const shadow = host.attachShadow({ mode: 'open' });
  // Unlike a style element, this needs no permission of the page's content security policy.
  const sheet = new CSSStyleSheet();
  sheet.replaceSync(STYLE);
  shadow.adoptedStyleSheets = [sheet];
  root.className = 'view';
  root.tabIndex = 0;
  root.setAttribute('role', 'application');
  root.setAttribute('aria-label', label ?? 'Isosurface. Arrow keys turn it, plus and minus ' +
    'zoom, with Shift arrow keys move it, 0 shows all of it, Enter picks the point in the middle.');
  // It changes with each attempt to connect; screen readers get the important changes.
  notice.className = 'notice';
  notice.hidden = true;
  speech.className = 'speech';
  cross.className = 'cross';
  shadow.append(root);
  if (isSpeaking) {
    speech.setAttribute('role', 'status');
    shadow.append(speech);
  }
  root.append(cross, notice);
  element.append(host);
  return { host, root, notice, speech, cross };
}
