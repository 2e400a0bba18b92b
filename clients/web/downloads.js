// Links and downloads: pictures, films, meshes, and the commands that make the same.
//
// A download shows its progress beside its button, and can be cancelled. It goes on while the dialog is closed, with
// the view of the moment when it began.
// @ts-check

import { abilities, findWebp } from './abilities.js';
import { fileOf, filmToCommand, meshToCommand, stateToCommand } from './commands.js';
import { byId, make, page } from './elements.js';
import { drawFilm, frameCountOf, whyNoFilm, whyNoSuchFilm } from './film.js';
import { announcer, copy, say } from './messages.js';
import { client, shown } from './page-view.js';
import { format, formatBytes } from './values.js';
import { MESH_FORMATS, meshAddress, pictureAddress, stateToLink, webpAddress } from './view-state.js';

/** @typedef {import('./isoscope-view.js').FrameRequest} FrameRequest */
/** @typedef {import('./film.js').Film} Film */

const caption = byId('caption', HTMLInputElement);
const axes = byId('draw-axes', HTMLInputElement);
const scaleBar = byId('draw-scale-bar', HTMLInputElement);
const legend = byId('draw-legend', HTMLInputElement);
const record = byId('record', HTMLInputElement);
const filmKind = byId('film-kind', HTMLSelectElement);
const filmFormat = byId('film-format', HTMLSelectElement);
const filmFrames = byId('film-frames', HTMLInputElement);
const filmStride = byId('film-stride', HTMLInputElement);
const filmRate = byId('film-rate', HTMLInputElement);
const filmHint = byId('film-hint', HTMLElement);
const filmProgress = byId('film-progress', HTMLProgressElement);
const filmNote = byId('film-note', HTMLElement);
const saveFilm = byId('save-film', HTMLButtonElement);
const saveMesh = byId('save-mesh', HTMLButtonElement);
const meshFormat = byId('mesh-format', HTMLSelectElement);
const madeOf = byId('command-of', HTMLSelectElement);
const copyCommand = byId('copy-command', HTMLButtonElement);
const commandHint = byId('command-hint', HTMLElement);

/** @param {Blob} blob @param {string} name */
function saveAs(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}

/**
 * Writes a note, and says what people wait for where they look.
 * @param {HTMLElement} note @param {string} text @param {string} [sentence] @param {boolean} [isError]
 */
function tellOfDownload(note, text, sentence, isError = false) {
  note.textContent = text;
  note.classList.toggle('error', isError);
  if (sentence && page.dialog.open) {
    announcer.say(sentence);
  } else if (sentence) {
    say(sentence, isError);
  }
}

/**
 * Saves what `ask` gives. Meanwhile the note shows the progress, and in place of the button there is one that cancels.
 * @param {HTMLButtonElement} button @param {HTMLElement} note @param {string} verb @param {string} name of the file
 * @param {(signal: AbortSignal) => Promise<Blob>} ask
 */
async function download(button, note, verb, name, ask) {
  const abort = new AbortController();
  const cancel = make('button', { className: 'button cancel', 'aria-label': `Cancel: ${button.textContent}`, onclick: () => abort.abort() }, 'Cancel');
  const hadFocus = document.activeElement === button;
  button.hidden = true;
  button.after(cancel);
  if (hadFocus) {
    cancel.focus();
  }
  tellOfDownload(note, verb);
  try {
    const blob = await ask(abort.signal);
    abort.signal.throwIfAborted();
    saveAs(blob, name);
    tellOfDownload(note, formatBytes(blob.size), `Downloaded ${name}, ${formatBytes(blob.size)}.`);
  } catch (error) {
    const isCancelled = abort.signal.aborted;
    const sentence = isCancelled ? 'Cancelled.' : /** @type {Error} */ (error).message;
    tellOfDownload(note, sentence, sentence, !isCancelled);
  }
  const hasFocus = document.activeElement === cancel;
  cancel.remove();
  button.hidden = false;
  if (hasFocus) {
    button.focus();
  }
}

/** @param {import('./series.js').SeriesControls} series */
function listenToLinks(series) {
  function linkOfView() {
    history.replaceState(null, '', `#${stateToLink(series.pinned(shown.getState()), shown.dataset, shown.limits)}`);
    return location.href;
  }
  byId('link', HTMLElement).onclick = () => copy(linkOfView(), client.token
    ? 'The link is copied. It opens this view again for whoever has the token.' : 'The link is copied: it opens this view again.');
  const access = byId('link-access', HTMLElement);
  // After '#': neither a server nor a log sees it.
  access.onclick = () => copy(`${linkOfView()}&token=${encodeURIComponent(client.token)}`,
    'The link is copied, with the token: whoever gets it sees what you see.');
  shown.addEventListener('status', () => { access.hidden = !client.token; });
}

/**
 * Whether a legend has something to show.
 * @param {FrameRequest} state
 */
const hasQuantity = ({ surfaces = [], caps }) => Boolean(caps?.colorMap) || surfaces.some((/** @type {any} */ { colorBy }) => colorBy);

/** @param {import('./series.js').SeriesControls} series */
export function listenToDownloads(series) {
  listenToLinks(series);
  /**
   * What the dialog asks for, but for the background of films.
   * @returns {FrameRequest}
   */
  const stateOfDialog = () => ({ ...series.pinned(shown.getState()), samples: Number(page.saveSamples.value) });
  /** @returns {FrameRequest} */
  const stateOfPicture = () => page.transparent.checked
    ? { ...stateOfDialog(), backgroundColor: { red: 0, green: 0, blue: 0, alpha: 0 } } : stateOfDialog();
  /**
   * A mesh has no pixels: of a level that is chosen by them, the mesh is of the one on the screen.
   * @returns {FrameRequest}
   */
  const stateForMesh = () => {
    const state = series.pinned(shown.getState());
    return state.level?.maxSpacingPx ? { ...state, level: { level: shown.isExact ? shown.level : 0 } } : state;
  };
  /** Of an empty field, that of the view. */
  const sizeOfDialog = () => ({ width: Math.round(page.width.valueAsNumber) || shown.loop.picture.width,
    height: Math.round(page.height.valueAsNumber) || shown.loop.picture.height });
  /** @returns {import('./view-state.js').Drawn} */
  const drawnOfDialog = () => ({ axes: axes.checked, scaleBar: scaleBar.checked, legend: legend.checked && !legend.disabled, caption: caption.value });
  /** @returns {Film} */
  const filmOfDialog = () => ({ format: filmFormat.value === 'webp' ? 'webp' : 'apng', kind: filmKind.value === 'steps' ? 'steps' : 'turn', frameCount: filmFrames.valueAsNumber,
    steps: series.steps.map(({ number }) => number).filter((_, i) => i % (Math.round(filmStride.valueAsNumber) || 1) === 0),
    framesPerSecond: filmRate.valueAsNumber, ...sizeOfDialog() });

  function drawFilmRows() {
    const isSeries = series.steps.length > 1;
    /** @type {HTMLOptionElement} */ (filmKind.options[1]).disabled = !isSeries;
    if (!isSeries) {
      filmKind.value = 'turn';
    }
    document.querySelectorAll('[data-film]').forEach((row) => {
      /** @type {HTMLElement} */ (row).hidden = row.getAttribute('data-film') !== filmKind.value;
    });
    const film = filmOfDialog();
    const why = whyNoFilm(film);
    const count = frameCountOf(film);
    filmHint.textContent = why || `${count} frames of ${film.width} × ${film.height}, ${format(count / film.framesPerSecond, 3)} s, ` +
      `with the samples and words of the picture${filmKind.value === 'steps' && !caption.value ? ', the time as caption' : ''}; the background is opaque.`;
    filmHint.classList.toggle('error', why !== '');
    saveFilm.disabled = why !== '';
  }
  /** A film of steps tells the time, as those of the command line do. */
  const drawnOfFilm = () => ({ ...drawnOfDialog(), caption: caption.value || (filmKind.value === 'steps' ? '{time}' : '') });

  /**
   * The command that makes what people chose, or why there is none.
   * @returns {{command?: string | null, verb: string, why?: string}}
   */
  function commandOfDialog() {
    const source = { file: fileOf(shown.dataset, abilities.gatewayAddress, location.href), hasToken: client.token !== '' };
    if (madeOf.value === 'mesh') {
      return { command: meshToCommand(stateForMesh(), meshFormat.value, source), verb: 'writes this mesh' };
    }
    if (madeOf.value === 'film') {
      const film = filmOfDialog();
      const why = whyNoSuchFilm(film);
      const command = why ? null : filmToCommand(film, series.steps.map(({ number }) => number), stateOfDialog(), source, drawnOfFilm());
      return { command, verb: 'draws this film', why: why || 'The numbers of these steps are not evenly apart: no command can name them.' };
    }
    return { command: stateToCommand(stateOfPicture(), 'picture.png', sizeOfDialog(), source, drawnOfDialog()), verb: 'draws this picture' };
  }
  function drawCommand() {
    const file = fileOf(shown.dataset, abilities.gatewayAddress, location.href);
    const { command, verb, why } = commandOfDialog();
    page.command.hidden = !command;
    page.command.textContent = command ?? '';
    copyCommand.disabled = !command;
    commandHint.textContent = !command ? why ?? '' : file ? `${verb} in the folder of ${file}`
      : `${verb}; HOST is the coordinator${client.token ? ', TOKEN_FILE has its token' : ''}`;
  }
  function drawDialog() {
    legend.disabled = !hasQuantity(shown.state);
    drawFilmRows();
    drawCommand();
  }
  let isWebpOffered = false;
  /** WebP is the smaller film, where the gateway has its frames. */
  async function offerWebp() {
    if (!isWebpOffered && await findWebp() && !isWebpOffered) {
      isWebpOffered = true;
      filmFormat.prepend(make('option', { value: 'webp' }, 'WebP'));
      filmFormat.value = 'webp';
      drawDialog();
    }
  }
  /** Whether people chose a size; else it is that of the view. */
  let isSizeChosen = false;
  page.width.oninput = page.height.oninput = () => {
    isSizeChosen = true;
    drawDialog();
  };
  for (const input of [page.saveSamples, page.transparent, axes, scaleBar, legend, caption, filmFormat, filmKind, filmFrames, filmStride, filmRate,
    meshFormat, madeOf]) {
    input.oninput = drawDialog;
  }
  // The server sends the camera of a view that is being fitted.
  shown.addEventListener('state', () => page.dialog.open && drawDialog());
  byId('save', HTMLElement).onclick = () => {
    if (!isSizeChosen) {
      page.width.value = String(shown.loop.picture.width);
      page.height.value = String(shown.loop.picture.height);
    }
    page.saveSamples.value = String(Math.max(4, Number(shown.state.samples ?? 1)));
    drawDialog();
    page.dialog.showModal();
    offerWebp();
  };
  copyCommand.onclick = () => copy(page.command.textContent ?? '', 'The command is copied.');
  byId('sizes', HTMLElement).append(...[['As shown', 0], ['1080p', 1080], ['4K', 2160], ['Print, 8K', 4320]].map(([name, side]) =>
    make('button', { className: 'small', onclick: () => {
      const tall = Number(side) || shown.loop.picture.height;
      page.height.value = String(tall);
      page.width.value = String(Math.min(16384, Math.round(tall * shown.loop.picture.aspect)));
      isSizeChosen = Number(side) > 0;
      drawDialog();
    } }, String(name))));
  meshFormat.replaceChildren(...MESH_FORMATS.map(([value, text]) => make('option', { value }, text)));

  const nameOf = (/** @type {FrameRequest} */ state) => state.dataset || 'isoscope';
  page.savePng.onclick = () => {
    const state = stateOfPicture();
    const { width, height } = sizeOfDialog();
    /** @type {FrameRequest} */
    const request = { ...state, withNotes: undefined, withUnresolvedCount: undefined, viewport: { widthPx: width, heightPx: height } };
    const address = pictureAddress(state.dataset ?? '', drawnOfDialog(), record.checked);
    download(page.savePng, page.saveNote, 'Drawing …', `${nameOf(state)}.png`, async (signal) => (await client.post(address, request, signal)).blob());
  };
  saveFilm.onclick = async () => {
    const film = filmOfDialog();
    const state = stateOfDialog();
    const drawn = drawnOfFilm();
    const count = frameCountOf(film);
    filmProgress.max = count;
    filmProgress.hidden = false;
    await download(saveFilm, filmNote, '', `${nameOf(state)}.${film.format}`, (signal) => drawFilm(film, { ...state, withNotes: undefined, withUnresolvedCount: undefined },
      (request, format) => format === 'webp' ? client.request(webpAddress(request, drawn), { signal, cache: 'no-store' })
        : client.post(pictureAddress(state.dataset ?? '', drawn, false), request, signal), signal, (done) => {
        filmProgress.value = done;
        filmNote.textContent = `frame ${done + 1} of ${count}`;
      }));
    filmProgress.hidden = true;
  };
  saveMesh.onclick = () => {
    const address = meshAddress(stateForMesh(), meshFormat.value);
    download(saveMesh, page.meshNote, 'Extracting …', `${nameOf(shown.state)}.${meshFormat.value}`,
      async (signal) => (await client.request(address, { signal })).blob());
  };
}
