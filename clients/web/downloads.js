// Links and downloads: pictures, meshes, and the command that draws the same picture.
// @ts-check

import { abilities } from './abilities.js';
import { byId, make, page } from './elements.js';
import { announcer, copy } from './messages.js';
import { client, shown } from './page-view.js';
import { formatBytes } from './values.js';
import { fileOf, stateToCommand, stateToHash } from './view-state.js';

/** @typedef {import('./isoscope-view.js').FrameRequest} FrameRequest */

/** @param {Blob} blob @param {string} name */
function saveAs(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}

/** @param {HTMLElement} note @param {string} text @param {'begin' | 'end' | 'error'} stage the end is for screen readers, too */
function tellOfDownload(note, text, stage) {
  note.textContent = text;
  note.classList.toggle('error', stage === 'error');
  if (stage !== 'begin') {
    announcer.say(stage === 'end' ? `Downloaded ${text}.` : text);
  }
}

/**
 * Saves the result of `ask`. The note shows the progress, and the button is disabled meanwhile.
 * @param {HTMLButtonElement} button @param {HTMLElement} note @param {string} verb @param {string} name of the file
 * @param {() => Promise<Response>} ask
 */
async function download(button, note, verb, name, ask) {
  button.disabled = true;
  tellOfDownload(note, verb, 'begin');
  try {
    const blob = await (await ask()).blob();
    saveAs(blob, name);
    tellOfDownload(note, formatBytes(blob.size), 'end');
  } catch (error) {
    tellOfDownload(note, /** @type {Error} */ (error).message, 'error');
  }
  button.disabled = false;
}

/** @param {import('./series.js').SeriesControls} series */
export function listenToDownloads(series) {
  function linkOfView() {
    history.replaceState(null, '', `#${stateToHash(series.pinned(shown.getState()))}`);
    return location.href;
  }
  byId('link', HTMLElement).onclick = () => copy(linkOfView(), client.token
    ? 'The link is copied. It opens this view again for whoever has the token.' : 'The link is copied: it opens this view again.');
  const access = byId('link-access', HTMLElement);
  // After '#': neither a server nor a log sees it.
  access.onclick = () => copy(`${linkOfView()}&token=${encodeURIComponent(client.token)}`,
    'The link is copied, with the token: whoever gets it sees what you see.');
  shown.addEventListener('status', () => { access.hidden = !client.token; });
  /**
   * What the dialog asks for.
   * @returns {FrameRequest}
   */
  function stateOfDialog() {
    const state = { ...series.pinned(shown.getState()), samples: Number(page.saveSamples.value) };
    return page.transparent.checked ? { ...state, backgroundColor: { red: 0, green: 0, blue: 0, alpha: 0 } } : state;
  }
  const sizeOfDialog = () => ({ width: page.width.valueAsNumber || 1, height: page.height.valueAsNumber || 1 });
  function drawCommand() {
    const file = fileOf(shown.dataset, abilities.gatewayAddress, location.href);
    page.command.textContent = stateToCommand(stateOfDialog(), 'picture.png', sizeOfDialog(), { file, hasToken: client.token !== '' });
    byId('command-hint', HTMLElement).textContent = file ? `draws this picture in the folder of ${file}`
      : `draws this picture; HOST is the coordinator${client.token ? ', TOKEN_FILE has its token' : ''}`;
  }
  /** Whether people chose a size; else it is that of the view. */
  let isSizeChosen = false;
  page.width.oninput = page.height.oninput = () => {
    isSizeChosen = true;
    drawCommand();
  };
  page.saveSamples.oninput = page.transparent.oninput = drawCommand;
  // The server sends the camera of a view that is being fitted.
  shown.addEventListener('state', () => page.dialog.open && drawCommand());
  byId('save', HTMLElement).onclick = () => {
    if (!isSizeChosen) {
      page.width.value = String(shown.loop.picture.width);
      page.height.value = String(shown.loop.picture.height);
    }
    page.saveSamples.value = String(Math.max(4, Number(shown.state.samples ?? 1)));
    drawCommand();
    page.dialog.showModal();
  };
  byId('copy-command', HTMLElement).onclick = () => copy(page.command.textContent ?? '', 'The command is copied.');
  byId('sizes', HTMLElement).append(...[['As shown', 0], ['1080p', 1080], ['4K', 2160], ['Print, 8K', 4320]].map(([name, side]) =>
    make('button', { className: 'small', onclick: () => {
      const tall = Number(side) || shown.loop.picture.height;
      page.height.value = String(tall);
      page.width.value = String(Math.min(16384, Math.round(tall * shown.loop.picture.aspect)));
      isSizeChosen = Number(side) > 0;
      drawCommand();
    } }, String(name))));

  page.savePng.onclick = () => {
    const state = stateOfDialog();
    const { width, height } = sizeOfDialog();
    /** @type {FrameRequest} */
    const request = { ...state, withNotes: undefined, viewport: { widthPx: width, heightPx: height } };
    download(page.savePng, page.saveNote, 'Drawing …', `${state.dataset || 'isoscope'}.png`,
      () => client.post(`v1/datasets/${encodeURIComponent(state.dataset ?? '')}/render`, request));
  };
  byId('save-mesh', HTMLElement).onclick = (event) => {
    const button = /** @type {HTMLButtonElement} */ (event.currentTarget);
    const state = series.pinned(shown.getState());
    const words = stateToHash({ selection: state.selection, surfaces: (state.surfaces ?? []).map((/** @type {any} */ { isovalue, labels, color }) => ({ isovalue, labels, color: color && { ...color, alpha: 1 } })), clip: state.clip });
    download(button, page.meshNote, 'Extracting …', `${state.dataset || 'isoscope'}.glb`,
      () => client.request(`v1/datasets/${encodeURIComponent(state.dataset ?? '')}/mesh.glb?${words}`));
  };
}
