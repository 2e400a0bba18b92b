// The page: controls around a view.
//
// 1. The address gives the first state (view-state.js); the token is removed from it (page-view.js).
// 2. The view's state is the only state. A control changes it by `change`.
// 3. The view sends the event 'state', and each section redraws its controls from it: one module each.
// 4. Datasets, histogram and cost come from the gateway's HTTP side (Client).
//
// Invariant: no control keeps a value of its own, so a link, the keyboard and the mouse give the
// same state.
// @ts-check

import { drawClip, listenToClip } from './clip.js';
import { abilities, loadAbilities } from './abilities.js';
import { listenToCapWindow, takeCapsColoring } from './cap-window.js';
import { addCost, watchAgents } from './cost.js';
import { closeDoor, isDoorClosed, listenToDoor, tryAtDoor } from './door.js';
import { listenToDownloads } from './downloads.js';
import { byId, make, page, quietly } from './elements.js';
import { listenToHelp } from './help.js';
import { drawHistogram, followHistogram, listenToHistogram, loadHistogram, suggestedIsovalue, suggestedLabels } from './histogram.js';
import { PATIENT_VIEWS, WORLD_VIEWS, whileShown } from './isoscope-view.js';
import { allLabels, withColors } from './label-sets.js';
import { drawLabels, listenToLabels } from './labels.js';
import { drawLevels, drawOffer, listenToLevels } from './level-controls.js';
import { DEFAULT_LIMITS, unresolvedText } from './levels.js';
import { drawLegend, drawLook, drawNotes, listenToLook, takeNotes } from './look.js';
import { announcer, say } from './messages.js';
import { listenToMore } from './more.js';
import { client, drawControlsBy, hasColors, redraw, shown, start, stateOfAddress, takeTokenAgain, theme } from './page-view.js';
import { clearPoints, drawPoints, listenToPoints } from './points.js';
import { SeriesControls, choiceOf, withoutFields } from './series.js';
import { drawSurfaces } from './surfaces.js';
import { listenToUndo, undo } from './undo-controls.js';
import { BACKGROUNDS, PALETTE, format, formatIn, fromHex, paintedApart } from './values.js';
import { asksFirstLook, stateToHash, stateToLink, withFirstLook, withMaterialOf } from './view-state.js';

/** @typedef {import('./isoscope-view.js').FrameRequest} FrameRequest */

const series = new SeriesControls(shown, { field: byId('field', HTMLSelectElement), fieldPicker: byId('field-picker', HTMLElement),
  timeline: byId('timeline', HTMLElement), back: byId('step-back', HTMLButtonElement), play: byId('play', HTMLButtonElement),
  on: byId('step-on', HTMLButtonElement), step: byId('step', HTMLInputElement), time: byId('time', HTMLElement),
  loop: byId('loop', HTMLInputElement), quantities: byId('field-quantities', HTMLOptGroupElement) },
{ say, format, chooseField: (selection) => {
  // Isovalues, clips of samples and ranges of colours were of other samples; a material is of none.
  const { surfaces } = shown.getState();
  open(() => {
    const { surfaces: gone, caps, ...rest } = shown.getState();
    return { ...rest, selection };
  }, [], surfaces);
} });

byId('fold', HTMLElement).onclick = (event) => {
  const isFolded = document.body.classList.toggle('folded');
  /** @type {HTMLElement} */ (event.currentTarget).setAttribute('aria-expanded', String(!isFolded));
  redraw();
  shown.refit();
};

let hashTimer = 0;
let controlsDrawn = '';
shown.addEventListener('state', () => {
  // A drag changes only the camera, which a single control shows.
  const { camera, ...rest } = shown.state;
  const controls = JSON.stringify([rest, (shown.camera?.height ?? 0) > 0, shown.decorations.box]);
  if (controls !== controlsDrawn) {
    controlsDrawn = controls;
    redraw();
  }
  clearTimeout(hashTimer);
  hashTimer = window.setTimeout(() => {
    if (shown.hasState) {
      history.replaceState(null, '', `#${stateToLink(shown.getState(), shown.dataset, shown.limits)}`);
    }
  }, 250);
});
/** Shows the state of the address, unless it is shown already. */
function openAddress() {
  const { state, problems, limits } = stateOfAddress();
  shown.limits = limits ?? DEFAULT_LIMITS;
  // A link has not the colours of the dataset, nor those that tell surfaces apart.
  const colored = state.surfaces ? { ...state, surfaces: paintedApart(withColors(state.surfaces, shown.dataset)) } : state;
  if (stateToHash(colored) !== stateToHash(shown.getState())) {
    open(() => state, problems);
  }
}
/** Whether what the view shows is of the address: it may have begun before the datasets are known. */
let isOfAddress = true;
window.addEventListener('hashchange', () => {
  isOfAddress = false;
  tryAtDoor(takeTokenAgain());
  // Behind the door nothing is known; the address is read again once it opens.
  if (!isDoorClosed()) {
    openAddress();
  }
});

// ---- datasets ----

/** @type {any[]} */
let datasets = [];

/** @param {any} dataset */
function factsOf(dataset) {
  const dims = dataset.geometry?.sampleDims ?? {};
  const { field, component } = choiceOf(dataset, shown.state.selection) ?? { field: {}, component: dataset };
  const type = (component.sampleType ?? '').replace('SAMPLE_TYPE_', '').toLowerCase();
  const { valueRange: ends } = component;
  const [min, max] = [Number(ends?.min ?? 0), Number(ends?.max ?? 0)];
  const range = ends ? ` · ${formatIn(min, { min, max })} to ${formatIn(max, { min, max })}${field.unit ? ` ${field.unit}` : ''}` : '';
  return `${dims.x} × ${dims.y} × ${dims.z} ${type}${range}`;
}

/**
 * Returns the label of a dataset. The name of a cached volume ends with 16 digits of its content;
 * they are omitted if the rest is unique.
 * @param {string} name @param {{name: string}[]} datasets
 */
function shortNameOf(name, datasets) {
  const short = (/** @type {string} */ text) => text.replace(/-[0-9a-f]{16}$/, '');
  return datasets.filter((other) => short(other.name) === short(name)).length > 1 ? name : short(name);
}

function drawDatasets() {
  page.dataset.replaceChildren(...datasets.map((dataset) => make('option', { value: dataset.name, title: dataset.name }, shortNameOf(dataset.name, datasets))));
}

/**
 * Takes the fit that the coordinator knows, and shows the first look of the address if that can be done without the
 * dataset: the picture need not wait for the histogram.
 */
function showFirst() {
  if (!abilities.features.includes('fit_cells')) {
    return;
  }
  shown.fitKind = 'CAMERA_FIT_CELLS';
  if (!shown.hasState && asksFirstLook(start.state) && hasColors(start.state)) {
    shown.setState(withFirstLook(start.state, shown.fitKind));
  }
}

let isLoading = false;
async function loadDatasets() {
  if (isLoading) {
    return;
  }
  isLoading = true;
  const { token } = client;
  try {
    // Where datasets are known, abilities are.
    const [answer] = await Promise.all([client.get('v1/datasets'), loadAbilities().then(showFirst)]);
    datasets = answer.datasets ?? [];
    isLoading = false;
  } catch (error) {
    isLoading = false;
    const { status, message } = /** @type {Error & {status: number}} */ (error);
    if (status !== 401) {
      say(message, true);
    } else if (token === client.token) {
      closeDoor();
    } else if (!isDoorClosed()) {
      loadDatasets();  // the answer to a token of before says nothing of that of now
    }
    return;
  }
  if (datasets.length === 0) {
    say('The server has no dataset yet. Start an agent with one: isoscope partition head.nii.gz, then isoscope serve head.', true);
  }
  drawDatasets();
  const { state } = stateOfAddress();
  open(() => isOfAddress && shown.state.surfaces ? shown.getState() : state, start.problems);
}

/**
 * @param {string} name or id; a dataset that has come since is asked for
 * @returns {Promise<any>} null if there is none
 */
async function datasetOf(name) {
  const known = datasets.find((one) => one.name === name || one.datasetId === name);
  if (known) {
    return known;
  }
  const come = await client.get(`v1/datasets/${encodeURIComponent(name)}`).catch(() => null);
  if (come && !datasets.some((one) => one.name === come.name)) {
    datasets.push(come);
    drawDatasets();
  }
  return come;
}

/**
 * Offers the datasets that there are in place of one of a link. What the link shows is kept where the names say that
 * it is the same volume.
 * @param {FrameRequest} state of the link
 */
function offer(state) {
  const wanted = state.dataset ?? '';
  const short = (/** @type {string} */ name) => name.toLowerCase().replace(/-[0-9a-f]{16}$/, '');
  const sentence = `There is no dataset “${wanted.slice(0, 100)}” here. There ${datasets.length === 1 ? 'is' : 'are'}:`;
  page.choice.hidden = false;
  page.choice.replaceChildren(make('p', {}, sentence), make('ul', {}, ...datasets.map(({ name }) => make('li', {},
    make('button', { className: 'button', title: name, onclick: () => {
      open(() => short(name) === short(wanted) ? { ...state, dataset: name } : { dataset: name }, []);
    } }, shortNameOf(name, datasets))))));
  announcer.say(sentence);
}

/** @param {string} name of the dataset that is shown, or soon will be */
function nameDataset(name) {
  page.dataset.value = name;
  document.title = `${name} · Isoscope`;
}

/** How many states were opened: one that is still being asked about gives way to a later one. */
let openCount = 0;
/** How many of them are still being asked about. */
let openingCount = 0;
/**
 * Shows a state once its dataset and its histogram are here.
 * @param {() => FrameRequest} stateNow is asked again then: what people have changed meanwhile of a view that goes on stays
 * @param {string[]} problems @param {any[]} [before] the surfaces that suggested ones replace
 */
async function open(stateNow, problems, before) {
  openingCount += 1;
  try {
    await ask(openCount += 1, stateNow, problems, before);
  } finally {
    openingCount -= 1;
  }
  redraw();
}
/**
 * If the state has no surface, the histogram suggests labels or an isovalue; if it has no camera, it is the first look,
 * as of every other client.
 * @param {number} turn @param {() => FrameRequest} stateNow @param {string[]} problems @param {any[]} [before]
 */
async function ask(turn, stateNow, problems, before = []) {
  const first = stateNow();
  const dataset = first.dataset ? await datasetOf(first.dataset) : datasets[0] ?? null;
  if (turn !== openCount) {
    return;
  }
  const wrong = [...problems, ...(dataset ? withoutFields(first, dataset) : [])];
  if (wrong.length > 0) {
    say(wrong.slice(0, 3).join('\n'), true);
  }
  if (!dataset) {
    if (first.dataset && datasets.length > 0) {
      offer(first);
    }
    return;
  }
  page.choice.hidden = true;
  nameDataset(dataset.name);
  await loadHistogram(dataset, first.selection);
  if (turn !== openCount) {
    return;
  }
  const state = stateNow();
  withoutFields(state, dataset);
  /** @type {FrameRequest} */
  const filled = { ...state, dataset: dataset.name };
  const labels = allLabels(dataset, suggestedLabels().map((/** @type {number} */ value) => ({ value })));
  filled.surfaces ??= labels.length > 0 ? labels : [{ isovalue: suggestedIsovalue(dataset, state.selection), color: fromHex(PALETTE[0]) }];
  filled.surfaces = withMaterialOf(paintedApart(withColors(filled.surfaces, dataset)), before);
  filled.backgroundColor ??= fromHex(BACKGROUNDS[theme()]);
  shown.setPins([]);
  clearPoints();
  const looked = asksFirstLook(state) ? withFirstLook(filled, shown.fitKind) : filled;
  // Older coordinators refuse the questions.
  shown.setState({ ...looked, ...(abilities.features.includes('notes') ? { withNotes: true } : {}),
    ...(abilities.features.includes('unresolved_count') ? { withUnresolvedCount: true } : {}) });
}

page.dataset.onchange = () => {
  const dataset = page.dataset.value;
  open(() => ({ dataset, backgroundColor: shown.state.backgroundColor }), []);
};

// ---- views ----

let viewsDrawn = '';
function drawViews() {
  const names = shown.dataset?.patientFrame ? PATIENT_VIEWS : WORLD_VIEWS;
  if (names.join() !== viewsDrawn) {
    viewsDrawn = names.join();
    page.views.replaceChildren(...names.map((name, i) => make('button', { title: `Look from the side “${name}” (key ${i + 1})`,
      'data-view': name, onclick: () => shown.lookFrom(name) }, name[0].toUpperCase() + name.slice(1))),
    make('button', { title: 'Show all of it, from here (key 0)', 'data-view': 'fit', onclick: () => shown.fit() }, 'Fit'));
  }
}

function drawAll() {
  if (shown.dataset) {
    page.facts.textContent = factsOf(shown.dataset);
  }
  series.draw();
  byId('stage', HTMLElement).classList.toggle('has-time', !byId('timeline', HTMLElement).hidden);
  followHistogram(series.isPlaying || openingCount > 0);
  drawHistogram();
  drawSurfaces();
  drawLabels();
  drawLook();
  if (shown.isCurrent) {
    drawLegend();
  }
  drawLevels();
  drawNotes();
  drawPoints();
  drawClip();
  drawViews();
}
shown.addEventListener('dataset', redraw);

window.addEventListener('resize', redraw);

/** A simulation that runs may append steps. */
async function watchSteps() {
  const { dataset } = shown;
  if ((dataset?.timeSteps ?? []).length > 0) {
    try {
      series.refresh(await client.get(`v1/datasets/${encodeURIComponent(dataset?.name ?? '')}`));
    } catch {
      // The view says that the gateway is away.
    }
  }
}

// ---- pill ----

shown.addEventListener('frame', (event) => {
  const { header } = /** @type {CustomEvent} */ (event).detail;
  if (header.frame?.statistics) {
    addCost(header.frame.statistics);
  }
  drawLegend(header.frame ?? null);
  takeCapsColoring(header.frame);
  takeNotes(header.frame, shown.isExact);
  unresolved = unresolvedText(header.frame?.statistics);
  series.frameShown(header.frame);
  pillChanged();
});
shown.addEventListener('refined', pillChanged);
shown.addEventListener('status', (event) => {
  const { kind } = /** @type {CustomEvent} */ (event).detail;
  if (kind === 'open' && datasets.length === 0) {
    loadDatasets();
  }
  pillChanged();
});
let isMoving = false;
let stillTimer = 0;
/** Whether the picture follows something: what is drawn at rest moves no more. */
const moves = () => isMoving || series.isPlaying;
shown.addEventListener('state', (event) => {
  ({ isMoving } = /** @type {CustomEvent} */ (event).detail);
  clearTimeout(stillTimer);
  stillTimer = window.setTimeout(() => {
    isMoving = false;
    pillChanged();
  }, 500);
  pillChanged();
});
const quietPill = quietly(drawPill);
let pillKind = '';
/** What the level of the picture hides. */
let unresolved = '';
/** Exact are only the pixels of the server, of all samples. */
const kindOfPicture = (/** @type {boolean} */ isConnected) => !isConnected ? 'closed' : shown.deferred ? 'deferred' : shown.progress && !shown.isExact ? 'tiles'
  : !shown.isExact ? moves() ? 'moving' : 'drawing' : shown.level > 0 ? 'coarse' : shown.isScaled ? 'scaled' : 'exact';
/** The kind of picture shows at once, figures now and then. */
function pillChanged() {
  const kind = kindOfPicture(shown.loop.connection.isOpen);
  if (kind !== pillKind) {
    pillKind = kind;
    drawPill();
  } else {
    quietPill(undefined);
  }
}
function drawPill() {
  const stats = shown.stats();
  const kind = kindOfPicture(stats.isConnected);
  page.state.className = `pill ${kind === 'drawing' ? 'moving' : kind}`;
  const latency = stats.shownLatencyMs === null ? '' : ` · ${format(stats.shownLatencyMs, 2)} ms`;
  const rate = stats.framesPerSecond > 1 ? ` · ${stats.framesPerSecond} frames/s` : '';
  const text = kind === 'closed' ? 'not connected' : kind === 'exact' ? `exact · ${stats.width} × ${stats.height}`
    : kind === 'coarse' ? `${shown.pictureText} · ${stats.width} × ${stats.height}`
    : kind === 'deferred' || kind === 'tiles' ? shown.pictureText || 'not exact'
    : kind === 'scaled' ? `scaled from ${stats.width} × ${stats.height}` : moves() ? `moving${rate}${latency}`
    : shown.pictureText ? `${shown.pictureText} …` : `drawing${shown.isCurrent && latency || ' …'}`;
  const told = shown.isCurrent && !moves() ? unresolved : '';
  if (told !== page.state.title) {
    page.state.title = told;
    page.state.toggleAttribute('title', told !== '');
  }
  drawOffer();
  const label = page.state.querySelector('span');
  if (label && label.textContent !== text) {
    label.textContent = text;
  }
}

drawControlsBy(drawAll);
listenToHistogram();
listenToLabels();
listenToLook();
listenToLevels();
listenToClip();
listenToCapWindow();
listenToPoints(series);
listenToDownloads(series);
loadDatasets();
listenToHelp();
listenToMore();
listenToUndo((state) => {
  series.rest();
  if (state.dataset !== shown.state.dataset) {
    return open(() => state, []);
  }
  openCount += 1;  // what was still being asked about gives way
  nameDataset(state.dataset);
  shown.setState(state);
}, () => series.isPlaying);
/** @type {any} */ (window).isoscope.undo = undo;
listenToDoor(() => datasets.length === 0 ? loadDatasets() : openAddress());
whileShown(() => isDoorClosed() || watchAgents(), 5000);
whileShown(() => isDoorClosed() || watchSteps(), 5000);
