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
import { listenToColorRanges, offerColorRanges, takeCapsColoring } from './color-ranges.js';
import { addCost, watchAgents } from './cost.js';
import { listenToDownloads } from './downloads.js';
import { byId, make, page, quietly } from './elements.js';
import { drawHistogram, followHistogram, listenToHistogram, loadHistogram, suggestedIsovalue } from './histogram.js';
import { PATIENT_VIEWS, WORLD_VIEWS, whileShown } from './isoscope-view.js';
import { withColors } from './label-sets.js';
import { drawLabels, listenToLabels } from './labels.js';
import { drawLegend, drawLook, drawNotes, listenToLook } from './look.js';
import { say } from './messages.js';
import { client, drawControlsBy, redraw, shown, start, stateOfAddress, theme } from './page-view.js';
import { clearPoints, listenToPoints } from './points.js';
import { SeriesControls, choiceOf, withoutFields } from './series.js';
import { drawSurfaces } from './surfaces.js';
import { BACKGROUNDS, PALETTE, format, fromHex } from './values.js';
import { stateToHash } from './view-state.js';

/** @typedef {import('./isoscope-view.js').FrameRequest} FrameRequest */

const series = new SeriesControls(shown, { field: byId('field', HTMLSelectElement), fieldPicker: byId('field-picker', HTMLElement),
  timeline: byId('timeline', HTMLElement), back: byId('step-back', HTMLButtonElement), play: byId('play', HTMLButtonElement),
  on: byId('step-on', HTMLButtonElement), step: byId('step', HTMLInputElement), time: byId('time', HTMLElement),
  loop: byId('loop', HTMLInputElement), quantities: byId('field-quantities', HTMLOptGroupElement) },
{ say, format, chooseField: (selection) => {
  // Isovalues, clips of samples and ranges of colours were of other samples.
  const { surfaces, caps, ...rest } = shown.getState();
  open({ ...rest, selection }, []);
} });

byId('fold', HTMLElement).onclick = (event) => {
  const isFolded = document.body.classList.toggle('folded');
  /** @type {HTMLElement} */ (event.currentTarget).setAttribute('aria-expanded', String(!isFolded));
  redraw();
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
      history.replaceState(null, '', `#${stateToHash(shown.getState())}`);
    }
  }, 250);
});
window.addEventListener('hashchange', () => {
  const { state, problems } = stateOfAddress();
  if (stateToHash(state) !== stateToHash(shown.getState())) {
    open(state, problems);
  }
});

// ---- datasets ----

/** @type {any[]} */
let datasets = [];
/** Whether the coordinator tells why surfaces do not show; older ones refuse the question. */
let hasNotes = false;

/** @param {any} dataset */
function factsOf(dataset) {
  const dims = dataset.geometry?.sampleDims ?? {};
  const { field, component } = choiceOf(dataset, shown.state.selection) ?? { field: {}, component: dataset };
  const type = (component.sampleType ?? '').replace('SAMPLE_TYPE_', '').toLowerCase();
  const { valueRange: ends } = component;
  const range = ends ? ` · ${format(Number(ends.min ?? 0))} to ${format(Number(ends.max ?? 0))}${field.unit ? ` ${field.unit}` : ''}` : '';
  return `${dims.x} × ${dims.y} × ${dims.z} ${type}${range}`;
}

/**
 * Returns the label of a dataset. The name of a cached volume ends with 16 digits of its content;
 * they are omitted if the rest is unique.
 * @param {string} name @param {{name: string}[]} datasets
 */
function labelOf(name, datasets) {
  const short = (/** @type {string} */ text) => text.replace(/-[0-9a-f]{16}$/, '');
  return datasets.filter((other) => short(other.name) === short(name)).length > 1 ? name : short(name);
}

async function loadDatasets() {
  try {
    // A gateway that does not know its coordinator's abilities still shows pictures.
    const abilities = client.get('v1/capabilities').catch(() => ({}));
    datasets = (await client.get('v1/datasets')).datasets ?? [];
    const features = (await abilities).features ?? [];
    hasNotes = features.includes('notes');
    offerColorRanges(features.includes('color_ranges'));
  } catch (error) {
    say(/** @type {Error} */ (error).message, true);
    return;
  }
  if (datasets.length === 0) {
    say('The server has no dataset yet. Start an agent with one: isoscope partition head.nii.gz, then isoscope serve head.', true);
  }
  page.dataset.replaceChildren(...datasets.map((dataset) => make('option', { value: dataset.name, title: dataset.name }, labelOf(dataset.name, datasets))));
  open(stateOfAddress().state, start.problems);
}

/**
 * Shows a state. If it has no surface, the histogram suggests an isovalue; if it has no camera, the server
 * chooses it, as for every other client.
 * @param {FrameRequest} state @param {string[]} problems
 */
async function open(state, problems) {
  const dataset = datasets.find((one) => one.name === state.dataset) ?? (state.dataset ? null : datasets[0]);
  const wrong = [...problems, ...(dataset ? withoutFields(state, dataset) : [])];
  if (wrong.length > 0) {
    say(wrong.slice(0, 3).join('\n'), true);
  }
  if (!dataset) {
    if (state.dataset) {
      shown.setState({ surfaces: [{ isovalue: 0 }], ...state });
    }
    return;
  }
  page.dataset.value = dataset.name;
  document.title = `${dataset.name} · Isoscope`;
  await loadHistogram(dataset, state.selection);
  /** @type {FrameRequest} */
  const filled = { ...state, dataset: dataset.name };
  filled.surfaces ??= [{ isovalue: suggestedIsovalue(dataset, state.selection), color: fromHex(PALETTE[0]) }];
  filled.surfaces = withColors(filled.surfaces, dataset);
  filled.backgroundColor ??= fromHex(BACKGROUNDS[theme()]);
  shown.setPins([]);
  clearPoints();
  shown.setState({ ...filled, ...(hasNotes ? { withNotes: true } : {}) });
}

page.dataset.onchange = () => open({ dataset: page.dataset.value, backgroundColor: shown.state.backgroundColor }, []);

// ---- views ----

let viewsDrawn = '';
function drawViews() {
  const names = shown.dataset?.patientFrame ? PATIENT_VIEWS : WORLD_VIEWS;
  if (names.join() !== viewsDrawn) {
    viewsDrawn = names.join();
    page.views.replaceChildren(...names.map((name, i) => make('button', { title: `Look from the side “${name}” (key ${i + 1})`,
      'data-view': name, onclick: () => shown.lookFrom(name) }, name[0].toUpperCase() + name.slice(1))),
    make('button', { title: 'Show all of it (key 0)', onclick: () => shown.reset() }, 'Fit'));
  }
}

function drawControls() {
  if (shown.dataset) {
    page.facts.textContent = factsOf(shown.dataset);
  }
  series.draw();
  followHistogram(series.isPlaying);
  drawHistogram();
  drawSurfaces();
  drawLabels();
  drawLook();
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
  drawLegend(header.frame);
  takeCapsColoring(header.frame);
  drawNotes(header.frame, Boolean(header.isExact));
  series.frameShown(header.frame);
  pillChanged();
});
shown.addEventListener('status', (event) => {
  const { kind } = /** @type {CustomEvent} */ (event).detail;
  if (kind === 'open' && datasets.length === 0) {
    loadDatasets();
  }
  pillChanged();
});
shown.addEventListener('state', () => pillChanged());
const quietPill = quietly(drawPill);
let pillKind = '';
/** The kind of picture shows at once, figures now and then. */
function pillChanged() {
  const kind = !shown.loop.connection.isOpen ? 'closed' : shown.isExact ? 'exact' : 'moving';
  if (kind !== pillKind) {
    pillKind = kind;
    drawPill();
  } else {
    quietPill(undefined);
  }
}
function drawPill() {
  const stats = shown.stats();
  const kind = !stats.isConnected ? 'closed' : stats.isExact ? 'exact' : 'moving';
  page.state.className = `pill ${kind}`;
  const latency = stats.shownLatencyMs === null ? '' : ` · ${format(stats.shownLatencyMs, 2)} ms`;
  const rate = stats.framesPerSecond > 1 ? ` · ${stats.framesPerSecond} frames/s` : '';
  const text = kind === 'closed' ? 'not connected' : kind === 'exact' ? `exact · ${stats.width} × ${stats.height}`
    : `moving${rate}${latency}`;
  const label = page.state.querySelector('span');
  if (label && label.textContent !== text) {
    label.textContent = text;
  }
}

drawControlsBy(drawControls);
listenToHistogram();
listenToLabels();
listenToLook();
listenToClip();
listenToColorRanges(series);
listenToPoints(series);
listenToDownloads(series);
loadDatasets();
whileShown(watchAgents, 5000);
whileShown(watchSteps, 5000);
