// The page: controls around a view.
//
// 1. The address gives the first state (view-state.js); the token is removed from it.
// 2. The view's state (a RenderIsosurfaceRequest as JSON) is the only state. A control changes it
//    by `change`.
// 3. The view sends the event 'state', and each section below redraws its controls from it.
// 4. Datasets, histogram and cost come from the gateway's HTTP side (Client).
//
// Invariant: no control keeps a value of its own, so a link, the keyboard and the mouse give the
// same state.
// @ts-check

import { Announcer, Client, PATIENT_VIEWS, WORLD_VIEWS, basisOf, boxOfDataset, lengthUnitOf, mount, roundLength,
  whileShown } from './isoscope-view.js';
import { COLOR_MAPS, colorByFromKey, colorByToKey, colorMapFromJson, colorMapToJson, otherSideOf, stateFromHash,
  stateToCommand, stateToHash } from './view-state.js';
import { COLOR_MAP_POINTS } from './color-maps.js';
import { SeriesControls, choiceOf, histogramWords, titleOfColoring, withoutFields } from './series.js';

/** @typedef {import('./isoscope-view.js').FrameRequest} FrameRequest */
/** @typedef {import('./isoscope-view.js').Vec3} Vec3 */

/** @template {HTMLElement} T @param {string} id @param {new () => T} type @returns {T} */
function byId(id, type) {
  const element = document.getElementById(id);
  if (!(element instanceof type)) {
    throw new Error(`the page has no ${id}`);
  }
  return element;
}

/**
 * @param {string} name @param {Record<string, any>} [attributes] @param {(Node | string)[]} children
 * @returns {HTMLElement}
 */
function make(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith('on')) {
      element.addEventListener(key.slice(2), value);
    } else if (key in element && key !== 'list') {
      /** @type {any} */ (element)[key] = value;
    } else {
      element.setAttribute(key, value);
    }
  }
  element.append(...children);
  return element;
}

/** @param {string} name @param {Record<string, any>} attributes @param {(Node | string)[]} children */
function svg(name, attributes, ...children) {
  const element = document.createElementNS('http://www.w3.org/2000/svg', name);
  for (const [key, value] of Object.entries(attributes)) {
    element.setAttribute(key, String(value));
  }
  element.append(...children);
  return element;
}

const page = {
  dataset: byId('dataset', HTMLSelectElement), facts: byId('facts', HTMLElement), views: byId('views', HTMLElement),
  state: byId('state', HTMLElement), legend: byId('legend', HTMLElement), points: byId('points', HTMLElement),
  hover: byId('hover', HTMLElement), surfaces: byId('surfaces', HTMLElement), quantity: byId('quantity', HTMLSelectElement),
  map: byId('map', HTMLSelectElement), rangeMin: byId('range-min', HTMLInputElement),
  rangeMax: byId('range-max', HTMLInputElement), opacityMin: byId('opacity-min', HTMLInputElement),
  opacityMax: byId('opacity-max', HTMLInputElement), caps: byId('caps', HTMLSelectElement), background: byId('background', HTMLInputElement),
  lights: byId('lights', HTMLSelectElement), occlusion: byId('occlusion', HTMLInputElement),
  silhouette: byId('silhouette', HTMLInputElement), samples: byId('samples', HTMLSelectElement),
  parallel: byId('parallel', HTMLInputElement), box: byId('box', HTMLInputElement), clip: byId('clip', HTMLElement),
  planes: byId('planes', HTMLElement), times: byId('times', HTMLCanvasElement), agents: byId('agents', HTMLElement),
  figures: byId('figures', HTMLElement), dialog: byId('dialog', HTMLDialogElement), width: byId('width', HTMLInputElement),
  height: byId('height', HTMLInputElement), saveSamples: byId('save-samples', HTMLSelectElement),
  transparent: byId('transparent', HTMLInputElement), savePng: byId('save-png', HTMLButtonElement),
  saveNote: byId('save-note', HTMLElement), meshNote: byId('mesh-note', HTMLElement), command: byId('command', HTMLElement),
  toast: byId('toast', HTMLElement), speech: byId('speech', HTMLElement), dialogSpeech: byId('dialog-speech', HTMLElement),
  histogram: /** @type {SVGSVGElement} */ (/** @type {unknown} */ (document.getElementById('histogram'))),
  chart: /** @type {SVGGElement} */ (/** @type {unknown} */ (document.getElementById('chart'))),
  handles: /** @type {SVGGElement} */ (/** @type {unknown} */ (document.getElementById('handles'))),
};

/**
 * Removes the token from the address, so that no link and no screenshot shows it, and keeps it for
 * reloads of this tab. It is not stored as a cookie: browsers send those to every port of a host,
 * and other users may listen there.
 */
function takeToken() {
  const address = new URL(location.href);
  const given = address.searchParams.get('token') ?? '';
  const key = `isoscope-token ${new URL('./', document.baseURI).pathname}`;
  if (address.searchParams.has('token')) {
    address.searchParams.delete('token');
    history.replaceState(null, '', address);
  }
  try {
    if (given) {
      sessionStorage.setItem(key, given);
    }
    return given || (sessionStorage.getItem(key) ?? '');
  } catch {
    return given;  // the browser stores nothing for pages
  }
}

const token = takeToken();
const client = new Client('', token);
const query = new URLSearchParams(location.search);
/** @type {any} */
const renderer = query.get('renderer') ?? 'auto';

// ---- small things ----

/** @param {number} value @param {number} [digits] */
const format = (value, digits = 5) => Number(value.toPrecision(digits)).toLocaleString('en', { maximumSignificantDigits: digits });
/** @param {number} bytes */
function formatBytes(bytes) {
  const power = Math.min(4, Math.floor(Math.log2(Math.max(bytes, 1)) / 10));
  return `${format(bytes / 1024 ** power, 3)} ${['B', 'KiB', 'MiB', 'GiB', 'TiB'][power]}`;
}
/** @param {string} text of a protobuf Duration; milliseconds */
const milliseconds = (text) => 1000 * (parseFloat(text) || 0);
/** @param {any} color */
const toHex = (color) => `#${['red', 'green', 'blue'].map((name) => Math.round(255 * (color?.[name] ?? 0)).toString(16).padStart(2, '0')).join('')}`;
/** @param {string} hex @param {number} [alpha] */
const fromHex = (hex, alpha = 1) => {
  /** @param {number} at */
  const channel = (at) => Math.round(parseInt(hex.slice(at, at + 2), 16) / 255 * 1e4) / 1e4;
  return { red: channel(1), green: channel(3), blue: channel(5), alpha };
};
const PALETTE = ['#dcc8b4', '#f2e9d8', '#c46a5a', '#6aa3d5', '#8cc08a', '#c9a0dc', '#e5b567', '#7fc4bd'];
const BACKGROUNDS = { dark: '#0b0e14', light: '#ffffff' };

// The only live regions. While the dialog is open, screen readers ignore the page behind it.
const announcer = new Announcer((sentence) => {
  (page.dialog.open ? page.dialogSpeech : page.speech).textContent = sentence;
});

let toastTimer = 0;
/** @param {string} sentence @param {boolean} [isError] */
function say(sentence, isError = false) {
  announcer.say(sentence);
  page.toast.textContent = sentence;
  page.toast.classList.toggle('error', isError);
  page.toast.hidden = false;
  clearTimeout(toastTimer);
  toastTimer = window.setTimeout(() => { page.toast.hidden = true; }, isError ? 9000 : 2600);
}

/** @param {string} text @param {string} sentence */
async function copy(text, sentence) {
  try {
    await navigator.clipboard.writeText(text);
    say(sentence);
  } catch {
    say(`The browser does not let this page copy. Copy it by hand:\n${text}`, true);
  }
}

// ---- theme ----

/** @returns {'dark' | 'light'} */
const theme = () => document.documentElement.dataset.theme === 'light' ? 'light' : 'dark';
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
byId('fold', HTMLElement).onclick = (event) => {
  const isFolded = document.body.classList.toggle('folded');
  /** @type {HTMLElement} */ (event.currentTarget).setAttribute('aria-expanded', String(!isFolded));
  redraw();
};

// ---- the view ----

/** Returns the view of the address: after '#', else what `isoscope view` names after '?'. */
function stateOfAddress() {
  if (location.hash.length > 1) {
    return stateFromHash(location.hash);
  }
  const words = [...query].filter(([name]) => ['dataset', 'isovalue', 'surface', 'field', 'component', 'step', 'time'].includes(name));
  return stateFromHash(new URLSearchParams(words).toString());
}

const start = stateOfAddress();

const shown = mount(byId('view', HTMLElement), { state: start.state.surfaces ? start.state : undefined, renderer,
  maxSide: Number(query.get('max-side')) || 2048, token, announce: (sentence) => announcer.say(sentence) });
view = shown;
// For users of the console, and for tests.
/** @type {any} */ (window).isoscope = { view: shown, client };

const series = new SeriesControls(shown, { field: byId('field', HTMLSelectElement), fieldPicker: byId('field-picker', HTMLElement),
  timeline: byId('timeline', HTMLElement), back: byId('step-back', HTMLButtonElement), play: byId('play', HTMLButtonElement),
  on: byId('step-on', HTMLButtonElement), step: byId('step', HTMLInputElement), time: byId('time', HTMLElement),
  loop: byId('loop', HTMLInputElement), quantities: byId('field-quantities', HTMLOptGroupElement) },
{ say, format, chooseField: (selection) => {
  // Isovalues, clips of samples and ranges of colours were of other samples.
  const { surfaces, caps, ...rest } = shown.getState();
  open({ ...rest, selection }, []);
} });

/** @param {FrameRequest} part @param {boolean} [isMoving] */
function change(part, isMoving = false) {
  shown.update(part, { isMoving });
}

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

/**
 * Returns a function that calls `draw` at once, and then at most every 250 ms, with the newest
 * argument. It is for text: without a GPU, a browser takes longer to draw it than a picture.
 * @template T @param {(argument: T) => void} draw
 */
function quietly(draw) {
  let timer = 0;
  /** @type {{argument: T} | null} */
  let waiting = null;
  const next = () => {
    timer = 0;
    if (waiting) {
      const { argument } = waiting;
      waiting = null;
      timer = window.setTimeout(next, 250);
      draw(argument);
    }
  };
  return (/** @type {T} */ argument) => {
    waiting = { argument };
    if (!timer) {
      next();
    }
  };
}

let isRedrawing = false;
function redraw() {
  if (!isRedrawing) {
    isRedrawing = true;
    requestAnimationFrame(() => {
      isRedrawing = false;
      drawControls();
    });
  }
}

// ---- datasets ----

/** @type {any[]} */
let datasets = [];
/** @type {any} */
let histogram = null;
let histogramOf = '';

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
    datasets = (await client.get('v1/datasets')).datasets ?? [];
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
 * Shows a state. If it has no isovalue, the histogram suggests one; if it has no camera, the server
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
  filled.backgroundColor ??= fromHex(BACKGROUNDS[theme()]);
  shown.setPins([]);
  picks = [];
  drawPoints();
  shown.setState(filled);
}

/**
 * The samples of what is shown: of a field, or of the dataset.
 * @param {any} dataset @param {any} selection
 */
const samplesOf = (dataset, selection) => choiceOf(dataset, selection)?.component ?? dataset ?? {};

/** @param {any} dataset @param {any} selection */
function suggestedIsovalue(dataset, selection) {
  const suggestions = histogram?.suggestions ?? [];
  const best = suggestions.find((/** @type {any} */ one) => one.method === 'METHOD_BETWEEN_CLASSES') ?? suggestions[0];
  const { min = 0, max = 1 } = samplesOf(dataset, selection).valueRange ?? {};
  return best ? best.isovalue ?? 0 : (Number(min) + Number(max)) / 2;
}

function chartHint() {
  return !histogram ? '' : histogram.hasSampleCounts ? 'Drag a line; double-click adds a surface.'
    : 'Active blocks by isovalue: partition this dataset anew to count its samples.';
}

/** @param {any} dataset @param {any} selection */
const histogramAddress = (dataset, selection) =>
  `v1/datasets/${encodeURIComponent(dataset.name)}/histogram?bins=256${histogramWords(dataset, selection)}`;

/** @param {any} dataset @param {any} selection */
async function loadHistogram(dataset, selection) {
  const address = histogramAddress(dataset, selection);
  if (histogramOf === address && histogram) {
    return;
  }
  // The curve of another step stays until the new one is here.
  histogram = histogramOf.startsWith(`v1/datasets/${encodeURIComponent(dataset.name)}/`) ? histogram : null;
  histogramOf = address;
  try {
    const answer = await client.get(address);
    if (histogramOf !== address) {
      return;  // another one was asked for meanwhile
    }
    histogram = answer;
    page.hover.textContent = chartHint();
    page.hover.classList.remove('error');
  } catch (error) {
    page.hover.textContent = `No histogram: ${/** @type {Error} */ (error).message}`;
    page.hover.classList.add('error');
  }
  redraw();
}

page.dataset.onchange = () => open({ dataset: page.dataset.value, backgroundColor: shown.state.backgroundColor }, []);

// ---- histogram and surfaces ----

const CHART = { width: 294, height: 132, left: 6, right: 6, top: 16, bottom: 18 };

function valueRange() {
  // A field has its range over all steps, so that a surface's line stands still during play.
  const bins = (shown.dataset?.fields ?? []).length > 0 ? [] : histogram?.bins ?? [];
  const { min = 0, max = 1 } = samplesOf(shown.dataset, shown.state.selection).valueRange ?? {};
  const low = bins.length > 0 ? Number(bins[0].min ?? 0) : Number(min);
  const high = bins.length > 0 ? Number(bins.at(-1).max ?? 0) : Number(max);
  return high > low ? { min: low, max: high } : { min: low - 0.5, max: low + 0.5 };
}

/** Behind a length: its unit, if it is known. */
const unit = () => ` ${lengthUnitOf(shown.dataset)}`.trimEnd();

/**
 * Sets the value and the limits of a slider.
 * @param {Element} slider @param {{min: number, max: number, now: number, text: string}} value
 */
function describeSlider(slider, { min, max, now, text }) {
  for (const [name, word] of Object.entries({ valuemin: min, valuemax: max, valuenow: now, valuetext: text })) {
    slider.setAttribute(`aria-${name}`, String(word));
  }
}

/** Where a key takes a slider: steps of a hundredth or a tenth of it, or an end of it; null if it moves none. */
const SLIDER_KEYS = /** @type {Record<string, number>} */ ({ ArrowLeft: -0.01, ArrowDown: -0.01, ArrowRight: 0.01,
  ArrowUp: 0.01, PageDown: -0.1, PageUp: 0.1, Home: -Infinity, End: Infinity });
/** @param {string} key @param {number} now @param {number} min @param {number} max */
function afterKey(key, now, min, max) {
  const step = SLIDER_KEYS[key];
  return step === undefined ? null : Math.max(min, Math.min(max, now + step * (max - min)));
}

/** @param {number} value */
function toChart(value) {
  const { min, max } = valueRange();
  return CHART.left + (value - min) / (max - min) * (CHART.width - CHART.left - CHART.right);
}

/** @param {number} x of the chart */
function fromChart(x) {
  const { min, max } = valueRange();
  const share = (x - CHART.left) / (CHART.width - CHART.left - CHART.right);
  const step = 10 ** Math.floor(Math.log10((max - min) / 500));
  const value = min + Math.max(0, Math.min(1, share)) * (max - min);
  return Number((Math.round(value / step) * step).toPrecision(12));
}

function drawHistogram() {
  CHART.width = page.histogram.clientWidth || CHART.width;
  const bins = histogram?.bins ?? [];
  const counts = bins.map((/** @type {any} */ bin) => Number(histogram.hasSampleCounts ? bin.sampleCount ?? 0 : bin.activeBlockCount ?? 0));
  const top = Math.log1p(Math.max(1, ...counts));
  const floor = CHART.height - CHART.bottom;
  /** @param {number} count */
  const y = (count) => floor - Math.log1p(count) / top * (floor - CHART.top);
  const begin = bins.length > 0 ? Number(bins[0].min ?? 0) : valueRange().min;
  let path = `M${toChart(begin).toFixed(1)},${floor}`;
  bins.forEach((/** @type {any} */ bin, /** @type {number} */ i) => {
    path += `V${y(counts[i]).toFixed(1)}H${toChart(Number(bin.max ?? 0)).toFixed(1)}`;
  });
  path += `V${floor}Z`;
  const { min, max } = valueRange();
  const parts = [svg('path', { class: 'area', d: path })];
  for (const [value, anchor] of /** @type {[number, string][]} */ ([[min, 'start'], [(min + max) / 2, 'middle'], [max, 'end']])) {
    parts.push(svg('text', { class: 'tick', x: toChart(value), y: CHART.height - 5, 'text-anchor': anchor }, format(value, 4)));
  }
  for (const suggestion of histogram?.suggestions ?? []) {
    const x = toChart(suggestion.isovalue ?? 0);
    parts.push(svg('path', { class: 'suggestion', d: `M${x - 4},${floor + 5}h8l-4,-5z` }, svg('title', {},
      `Suggested: ${format(suggestion.isovalue ?? 0)}`)));
  }
  page.histogram.setAttribute('viewBox', `0 0 ${CHART.width} ${CHART.height}`);
  page.chart.replaceChildren(...parts);
  const { surfaces = [] } = shown.state;
  // A focused handle must not be replaced: screen readers would read it again.
  if (page.handles.children.length !== surfaces.length) {
    page.handles.replaceChildren(...surfaces.map((/** @type {any} */ _, /** @type {number} */ i) =>
      svg('g', { class: 'handle', tabindex: 0, role: 'slider', 'data-surface': i, 'aria-label': `Isovalue ${i + 1}`,
        'aria-orientation': 'horizontal' }, svg('line', { y1: 10, y2: floor }), svg('circle', { cy: 9, r: 6.5 }))));
  }
  surfaces.forEach((/** @type {any} */ { isovalue = 0, color }, /** @type {number} */ i) => {
    const handle = page.handles.children[i];
    const [line, circle] = handle.children;
    const x = String(toChart(isovalue));
    const paint = toHex(color ?? fromHex(PALETTE[0]));
    for (const [element, name, value] of /** @type {[Element, string, string][]} */ ([[line, 'x1', x], [line, 'x2', x],
      [line, 'stroke', paint], [circle, 'cx', x], [circle, 'fill', paint]])) {
      element.setAttribute(name, value);
    }
    describeSlider(handle, { min, max, now: isovalue, text: format(isovalue) });
  });
}

/** @param {number} index @param {Record<string, any>} part @param {boolean} [isMoving] */
function changeSurface(index, part, isMoving = false) {
  const surfaces = structuredClone(shown.state.surfaces ?? []);
  Object.assign(surfaces[index], part);
  change({ surfaces }, isMoving);
}

/** @param {number} isovalue */
function addSurface(isovalue) {
  const surfaces = structuredClone(shown.state.surfaces ?? []);
  if (surfaces.length >= 16) {
    say('A picture has at most 16 surfaces.', true);
    return;
  }
  const color = PALETTE.find((one) => surfaces.every((/** @type {any} */ surface) => toHex(surface.color) !== one)) ?? PALETTE[0];
  // The outer surface becomes translucent, so that the new one is visible.
  for (const surface of surfaces) {
    surface.color ??= fromHex(PALETTE[0]);
    if (surfaces.length === 1 && isovalue > (surface.isovalue ?? 0) && surface.color.alpha === 1) {
      surface.color.alpha = 0.4;
    }
  }
  const isClear = surfaces.some((/** @type {any} */ surface) => isovalue < (surface.isovalue ?? 0));
  surfaces.push({ isovalue, color: fromHex(color, isClear ? 0.4 : 1), ...(surfaces[0]?.colorBy ? { colorBy: surfaces[0].colorBy } : {}) });
  change({ surfaces });
}

function listenToHistogram() {
  const chart = page.histogram;
  let dragged = -1;
  /** @param {MouseEvent} event */
  const x = (event) => {
    const box = chart.getBoundingClientRect();
    return (event.clientX - box.left) / box.width * CHART.width;
  };
  chart.addEventListener('pointerdown', (event) => {
    const distances = (shown.state.surfaces ?? []).map((/** @type {any} */ surface) => Math.abs(toChart(surface.isovalue ?? 0) - x(event)));
    const nearest = distances.indexOf(Math.min(...distances));
    dragged = distances[nearest] < 12 ? nearest : -1;
    if (dragged >= 0) {
      chart.setPointerCapture(event.pointerId);
      event.preventDefault();
    }
  });
  chart.addEventListener('pointermove', (event) => {
    const value = fromChart(x(event));
    if (dragged >= 0) {
      changeSurface(dragged, { isovalue: value }, true);
    }
    const bin = (histogram?.bins ?? []).find((/** @type {any} */ one) => value >= (one.min ?? 0) && value < (one.max ?? 0));
    page.hover.textContent = bin ? `${format(value)} · ${histogram.hasSampleCounts ? `${Number(bin.sampleCount ?? 0).toLocaleString('en')} samples · ` : ''}` +
      `about ${Number(bin.estimatedTriangleCount ?? 0).toLocaleString('en', { notation: 'compact' })} triangles` : '';
  });
  const end = () => {
    if (dragged >= 0) {
      dragged = -1;
      change({});
    }
  };
  chart.addEventListener('pointerup', end);
  chart.addEventListener('pointercancel', end);
  chart.addEventListener('pointerleave', () => { page.hover.textContent = chartHint() || page.hover.textContent; });
  chart.addEventListener('dblclick', (event) => addSurface(fromChart(x(event))));
  chart.addEventListener('keydown', (event) => {
    const index = Number(/** @type {Element} */ (event.target).getAttribute('data-surface') ?? NaN);
    const { min, max } = valueRange();
    const isovalue = Number.isInteger(index) ? afterKey(event.key, shown.state.surfaces[index].isovalue ?? 0, min, max) : null;
    if (isovalue !== null) {
      changeSurface(index, { isovalue: fromChart(toChart(isovalue)) }, true);
      event.preventDefault();
    }
  });
}

byId('add', HTMLElement).onclick = () => {
  const values = (shown.state.surfaces ?? []).map((/** @type {any} */ surface) => surface.isovalue ?? 0);
  const { min, max } = valueRange();
  const free = (histogram?.suggestions ?? []).map((/** @type {any} */ one) => one.isovalue ?? 0)
    .find((/** @type {number} */ value) => values.every((/** @type {number} */ used) => Math.abs(used - value) > (max - min) / 50));
  addSurface(free ?? fromChart(toChart((Math.max(min, ...values) + max) / 2)));
};

/** @param {number} share */
const percent = (share) => `${Math.round(100 * share)} %`;

let surfacesDrawn = '';
function drawSurfaces() {
  const { surfaces = [] } = shown.state;
  // Controls under the pointer must not be replaced.
  const form = JSON.stringify([surfaces.length]);
  if (form !== surfacesDrawn) {
    surfacesDrawn = form;
    page.surfaces.replaceChildren(...surfaces.map((/** @type {any} */ _, /** @type {number} */ i) => {
      /** @param {string} hex @param {number} [alpha] */
      const paint = (hex, alpha) => {
        const now = shown.state.surfaces[i].color ?? fromHex(PALETTE[0]);
        return { color: { ...fromHex(hex), alpha: alpha ?? now.alpha } };
      };
      return make('li', {},
        make('input', { type: 'color', title: 'Colour', 'aria-label': `Colour of surface ${i + 1}`,
          oninput: (/** @type {any} */ event) => changeSurface(i, paint(event.target.value), true) }),
        make('input', { type: 'number', step: 'any', title: 'Isovalue', 'aria-label': `Isovalue of surface ${i + 1}`,
          onchange: (/** @type {any} */ event) => Number.isFinite(event.target.valueAsNumber) && changeSurface(i, { isovalue: event.target.valueAsNumber }) }),
        make('input', { type: 'range', min: '0.05', max: '1', step: '0.05', title: 'Opacity', 'aria-label': `Opacity of surface ${i + 1}`,
          oninput: (/** @type {any} */ event) => changeSurface(i, paint(toHex(shown.state.surfaces[i].color ?? fromHex(PALETTE[0])), event.target.valueAsNumber), true) }),
        make('span', { className: 'figure', 'aria-hidden': 'true' }),
        make('button', { className: 'remove', title: 'Remove this surface', 'aria-label': `Remove surface ${i + 1}`,
          onclick: () => change({ surfaces: shown.state.surfaces.filter((/** @type {any} */ __, /** @type {number} */ k) => k !== i) }) }, '✕'));
    }));
  }
  surfaces.forEach((/** @type {any} */ surface, /** @type {number} */ i) => {
    const [color, isovalue, opacity] = page.surfaces.children[i].querySelectorAll('input');
    const paint = surface.color ?? fromHex(PALETTE[0]);
    color.value = toHex(paint);
    if (document.activeElement !== isovalue) {
      isovalue.value = String(surface.isovalue ?? 0);
    }
    opacity.value = String(paint.alpha ?? 0);
    opacity.setAttribute('aria-valuetext', percent(paint.alpha ?? 0));
    /** @type {HTMLElement} */ (page.surfaces.children[i].querySelector('.figure')).textContent = percent(paint.alpha ?? 0);
    /** @type {HTMLButtonElement} */ (page.surfaces.children[i].querySelector('.remove')).disabled = surfaces.length === 1;
  });
}

// ---- colour and light ----

page.map.replaceChildren(...COLOR_MAPS.map((name) => make('option', { value: name }, name)));
/** @param {boolean} [isMoving] */
function changeColorBy(isMoving) {
  const quantity = page.quantity.value;
  const isMapped = quantity !== 'none' && quantity !== 'normal';
  const [min, max] = [page.rangeMin.valueAsNumber, page.rangeMax.valueAsNumber];
  const isRange = isMapped && Number.isFinite(min) && Number.isFinite(max);
  if (isRange && !(max > min)) {
    say('The greatest value of the colours must be above the least one.', true);
    return;
  }
  const [atMin, atMax] = [page.opacityMin.valueAsNumber, page.opacityMax.valueAsNumber];
  const surfaces = structuredClone(shown.state.surfaces ?? []);
  for (const surface of surfaces) {
    delete surface.colorBy;
    if (quantity !== 'none') {
      surface.colorBy = { ...colorByFromKey(quantity), ...(isMapped ? { colorMap: colorMapToJson(page.map.value) } : {}),
        ...(isRange ? { range: { min, max } } : {}), ...(isMapped && atMin * atMax < 1 ? { opacity: { atMin, atMax } } : {}) };
    }
  }
  change({ surfaces }, isMoving === true);
}
page.quantity.onchange = () => {
  page.rangeMin.value = page.rangeMax.value = '';
  changeColorBy();
};
page.map.onchange = page.rangeMin.onchange = page.rangeMax.onchange = () => changeColorBy();
page.opacityMin.oninput = page.opacityMax.oninput = () => changeColorBy(true);
page.background.oninput = () => change({ backgroundColor: fromHex(page.background.value) }, true);

/** @type {Record<string, any[] | undefined>} */
const LIGHTS = {
  head: undefined,
  studio: [
    { direction: { x: -1, y: 1.2, z: 1.6 }, intensity: 0.85 },
    { direction: { x: 1.5, y: 0.2, z: 1 }, intensity: 0.3, color: { red: 0.75, green: 0.85, blue: 1, alpha: 1 } },
    { direction: { x: 0, y: -1, z: 0.6 }, intensity: 0.15, color: { red: 1, green: 0.85, blue: 0.7, alpha: 1 } },
  ],
  side: [{ direction: { x: -1, y: 0.5, z: 0.35 }, intensity: 1 }],
};
/** @param {any} lights */
const lightWords = (lights) => stateToHash({ lights });
page.lights.onchange = () => change({ lights: LIGHTS[page.lights.value] });
page.occlusion.onchange = () => change({ ambientOcclusion: page.occlusion.checked ? { radiusPx: 32 } : undefined });
page.silhouette.onchange = () => change({ silhouette: page.silhouette.checked ? { widthPx: 2 } : undefined });
page.samples.onchange = () => change({ samples: page.samples.value === '1' ? undefined : Number(page.samples.value) });
page.box.onchange = () => shown.decorate({ box: page.box.checked });
page.parallel.onchange = () => {
  const { camera } = shown;
  if (camera) {
    const height = 2 * Math.tan(camera.fovYDegrees * Math.PI / 360) * basisOf(camera).distance;
    shown.setCamera({ ...camera, height: page.parallel.checked ? height : 0 });
  }
};

function drawLook() {
  const { state } = shown;
  const colorBy = (state.surfaces ?? []).find((/** @type {any} */ surface) => surface.colorBy)?.colorBy;
  const quantity = colorByToKey(colorBy);
  page.quantity.value = quantity;
  const isMapped = quantity !== 'none' && quantity !== 'normal';
  document.querySelectorAll('[data-for=map]').forEach((row) => { /** @type {HTMLElement} */ (row).hidden = !isMapped; });
  page.map.value = colorMapFromJson(colorBy?.colorMap);
  for (const [input, end] of /** @type {[HTMLInputElement, string][]} */ ([[page.rangeMin, 'min'], [page.rangeMax, 'max']])) {
    if (document.activeElement !== input) {
      input.value = colorBy?.range ? String(colorBy.range[end] ?? 0) : '';
      input.placeholder = end === 'min' ? 'least' : 'greatest';
    }
  }
  for (const [input, end] of /** @type {[HTMLInputElement, string][]} */ ([[page.opacityMin, 'atMin'], [page.opacityMax, 'atMax']])) {
    const opacity = colorBy?.opacity ? colorBy.opacity[end] ?? 0 : 1;
    input.value = String(opacity);
    input.setAttribute('aria-valuetext', percent(opacity));
  }
  page.background.value = toHex(state.backgroundColor);
  const words = lightWords(state.lights);
  page.lights.value = Object.keys(LIGHTS).find((name) => lightWords(LIGHTS[name]) === words) ?? 'custom';
  page.occlusion.checked = Boolean(state.ambientOcclusion);
  page.silhouette.checked = Boolean(state.silhouette);
  page.samples.value = String(state.samples || 1);
  page.box.checked = shown.decorations.box;
  page.parallel.checked = (shown.camera?.height ?? 0) > 0;
}

let legendDrawn = 'null';
/** @param {any} frame of the response */
function drawLegend(frame) {
  const coloring = (frame?.colorings ?? [])[0]?.colorBy;
  const words = JSON.stringify(coloring?.range ? coloring : null);
  if (words === legendDrawn) {
    return;
  }
  legendDrawn = words;
  page.legend.hidden = !coloring?.range;
  if (!coloring?.range) {
    return;
  }
  const [title, canvas, top, bottom] = page.legend.children;
  title.textContent = titleOfColoring(coloring, shown.dataset);
  top.textContent = format(Number(coloring.range.max ?? 0), 4);
  bottom.textContent = format(Number(coloring.range.min ?? 0), 4);
  const context = /** @type {HTMLCanvasElement} */ (canvas).getContext('2d');
  const points = COLOR_MAP_POINTS[colorMapFromJson(coloring.colorMap)] ?? [];
  if (context) {
    const gradient = context.createLinearGradient(0, 160, 0, 0);
    points.forEach((color, i) => gradient.addColorStop(i / (points.length - 1), color));
    context.fillStyle = gradient;
    context.fillRect(0, 0, 12, 160);
  }
}

// ---- clip ----

/** @type {Record<string, any>} */
const CAPS = { open: undefined, filled: {}, slice: { colorMap: 'COLOR_MAP_GREY' } };

/** @param {any} clip @param {boolean} [isMoving] */
function changeClip(clip, isMoving) {
  const isCut = Object.keys(clip).length > 0;
  // Without a cut there is nothing to fill, and the server refuses caps.
  change(isCut ? { clip } : { clip: undefined, caps: undefined }, isMoving);
}

/** @type {{element: HTMLElement, draw: () => void}[]} */
let clipSliders = [];
let clipSlidersOf = '';

/**
 * A slider with two thumbs.
 * @param {string} name @param {number} axis
 */
function makeClipSlider(name, axis) {
  const between = make('div', { className: 'between' });
  const key = /** @type {'x' | 'y' | 'z'} */ ('xyz'[axis]);
  const range = () => {
    const whole = boxOfDataset(shown.dataset) ?? { min: [0, 0, 0], max: [1, 1, 1] };
    const box = shown.state.clip?.box;
    return { min: whole.min[axis], max: whole.max[axis], low: box ? box.min?.[key] ?? 0 : whole.min[axis],
      high: box ? box.max?.[key] ?? 0 : whole.max[axis] };
  };
  const thumbs = ['low', 'high'].map((end) => make('div', { className: 'thumb', tabIndex: 0, role: 'slider', 'data-end': end,
    'data-axis': key, 'aria-orientation': 'horizontal', 'aria-label': `${end === 'low' ? 'Least' : 'Greatest'} ${name}` }));
  const figures = make('span', { className: 'ends', 'aria-hidden': 'true' });
  const bar = make('div', { className: 'slider' }, between, ...thumbs);
  /**
   * Thumbs stay a two-hundredth of the range apart.
   * @param {number} which
   */
  const limits = (which) => {
    const { min, max, low, high } = range();
    const least = (max - min) / 200;
    return which === 0 ? { min, max: Math.max(min, high - least), now: low } : { min: Math.min(max, low + least), max, now: high };
  };
  /** @param {number} which @param {number} value @param {boolean} isMoving */
  const set = (which, value, isMoving) => {
    const now = range();
    const whole = /** @type {{min: Vec3, max: Vec3}} */ (boxOfDataset(shown.dataset));
    const clip = structuredClone(shown.state.clip ?? {});
    const toJson = (/** @type {Vec3} */ v) => ({ x: v[0], y: v[1], z: v[2] });
    clip.box ??= { min: toJson(whole.min), max: toJson(whole.max) };
    const step = 10 ** Math.floor(Math.log10((now.max - now.min) / 400));
    const rounded = Number((Math.round(value / step) * step).toPrecision(12));
    const { min, max } = limits(which);
    clip.box[which === 0 ? 'min' : 'max'][key] = Math.max(min, Math.min(max, rounded));
    const isWhole = ['x', 'y', 'z'].every((one, i) => (clip.box.min[one] ?? 0) <= whole.min[i] && (clip.box.max[one] ?? 0) >= whole.max[i]);
    if (isWhole) {
      delete clip.box;
    }
    changeClip(clip, isMoving);
  };
  let dragged = -1;
  /** @param {PointerEvent} event */
  const valueAt = (event) => {
    const place = bar.getBoundingClientRect();
    const { min, max } = range();
    return min + Math.max(0, Math.min(1, (event.clientX - place.left) / place.width)) * (max - min);
  };
  bar.addEventListener('pointerdown', (event) => {
    if (!boxOfDataset(shown.dataset)) {
      return;
    }
    const value = valueAt(event);
    const { low, high } = range();
    dragged = Math.abs(value - low) < Math.abs(value - high) || value < low ? 0 : 1;
    bar.setPointerCapture(event.pointerId);
    set(dragged, value, true);
  });
  bar.addEventListener('pointermove', (event) => dragged >= 0 && set(dragged, valueAt(event), true));
  const end = () => {
    if (dragged >= 0) {
      dragged = -1;
      change({});
    }
  };
  bar.addEventListener('pointerup', end);
  bar.addEventListener('pointercancel', end);
  thumbs.forEach((thumb, which) => thumb.addEventListener('keydown', (event) => {
    const { min, max, now } = limits(which);
    const value = boxOfDataset(shown.dataset) ? afterKey(event.key, now, min, max) : null;
    if (value !== null) {
      set(which, value, true);
      event.preventDefault();
    }
  }));
  return { element: make('div', { className: 'double' }, make('span', { 'aria-hidden': 'true' }, name), bar, figures), draw: () => {
    const { min, max, low, high } = range();
    /** @param {number} value */
    const share = (value) => `${Math.max(0, Math.min(100, 100 * (value - min) / (max - min)))}%`;
    thumbs[0].style.left = share(low);
    thumbs[1].style.left = share(high);
    between.style.left = share(low);
    between.style.right = share(min + max - high);
    thumbs.forEach((thumb, i) => {
      const value = limits(i);
      describeSlider(thumb, { ...value, text: `${format(value.now, 4)}${unit()}` });
    });
    figures.textContent = `${format(low, 4)} – ${format(high, 4)}`;
  } };
}

byId('clear-clip', HTMLElement).onclick = () => changeClip({});
page.caps.onchange = () => change({ caps: CAPS[page.caps.value] });
byId('add-plane', HTMLElement).onclick = () => {
  const { camera } = shown;
  const planes = shown.state.clip?.halfSpaces ?? [];
  if (!camera || planes.length >= 6) {
    say(camera ? 'A picture has at most 6 clip planes.' : 'Wait for the first picture.', true);
    return;
  }
  const normal = basisOf(camera).forward.map((value) => Math.round(value * 1000) / 1000);
  const box = boxOfDataset(shown.dataset);
  const middle = box ? box.min.map((value, axis) => (value + box.max[axis]) / 2) : camera.target;
  const offset = Number(normal.reduce((sum, value, axis) => sum + value * middle[axis], 0).toPrecision(6));
  change({ clip: { ...shown.state.clip, halfSpaces: [...planes, { normal: { x: normal[0], y: normal[1], z: normal[2] }, offset }] } });
};

/** @param {number} value */
const format12 = (value) => String(Number(value.toPrecision(12)));

let planesDrawn = -1;
function drawClip() {
  const key = JSON.stringify(shown.dataset?.geometry ?? null) + (shown.dataset?.patientFrame ?? '');
  if (key !== clipSlidersOf) {
    clipSlidersOf = key;
    clipSliders = [0, 1, 2].map((axis) => makeClipSlider(shown.dataset?.patientFrame?.[axis] ?? 'xyz'[axis], axis));
    page.clip.replaceChildren(...clipSliders.map((slider) => slider.element));
  }
  clipSliders.forEach((slider) => slider.draw());
  const { caps, clip } = shown.state;
  page.caps.value = !caps ? 'open' : caps.colorMap ? 'slice' : 'filled';
  page.caps.disabled = !clip;
  const planes = shown.state.clip?.halfSpaces ?? [];
  /** @param {number} i @param {any} part @param {boolean} isMoving */
  const setPlane = (i, part, isMoving) => {
    const halfSpaces = structuredClone(shown.state.clip.halfSpaces);
    Object.assign(halfSpaces[i], part);
    change({ clip: { ...shown.state.clip, halfSpaces } }, isMoving);
  };
  if (planes.length !== planesDrawn) {
    planesDrawn = planes.length;
    page.planes.replaceChildren(...planes.map((/** @type {any} */ _, /** @type {number} */ i) => make('li', {},
      make('span', { className: 'hint' }), make('input', { type: 'range', 'aria-label': `Place of plane ${i + 1}`,
        oninput: (/** @type {any} */ event) => setPlane(i, { offset: Number(event.target.valueAsNumber.toPrecision(6)) }, true) }),
      make('button', { className: 'small', title: 'Keep the other side', onclick: () => {
        setPlane(i, otherSideOf(shown.state.clip.halfSpaces[i]), false);
      } }, 'Flip'),
      make('button', { className: 'remove', 'aria-label': `Remove plane ${i + 1}`, onclick: () => {
        const halfSpaces = shown.state.clip.halfSpaces.filter((/** @type {any} */ __, /** @type {number} */ k) => k !== i);
        const { halfSpaces: gone, ...rest } = shown.state.clip;
        changeClip(halfSpaces.length > 0 ? { ...rest, halfSpaces } : rest);
      } }, '✕'))));
  }
  const box = boxOfDataset(shown.dataset);
  planes.forEach((/** @type {any} */ plane, /** @type {number} */ i) => {
    const normal = [plane.normal?.x ?? 0, plane.normal?.y ?? 0, plane.normal?.z ?? 0];
    const item = page.planes.children[i];
    const [name, input] = item.children;
    name.textContent = `${normal.map((value) => format(value, 2)).join(', ')}`;
    if (box && input instanceof HTMLInputElement) {
      const ends = normal.map((value, axis) => [value * box.min[axis], value * box.max[axis]]);
      const least = ends.reduce((sum, pair) => sum + Math.min(...pair), 0);
      const greatest = ends.reduce((sum, pair) => sum + Math.max(...pair), 0);
      const step = roundLength((greatest - least || 1) / 400);
      // A range input takes only whole steps from its minimum on.
      input.step = String(step);
      input.min = format12(Math.floor(least / step) * step);
      input.max = format12(Math.ceil(greatest / step) * step);
      input.value = String(plane.offset ?? 0);
      input.setAttribute('aria-valuetext', `${format(plane.offset ?? 0)}${unit()}`);
    }
  });
}

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
  followHistogram();
  drawHistogram();
  drawSurfaces();
  drawLook();
  drawClip();
  drawViews();
}
shown.addEventListener('dataset', redraw);

let histogramTimer = 0;
/** Counts of another step are asked for once the time rests. */
function followHistogram() {
  clearTimeout(histogramTimer);
  const { dataset, state } = shown;
  if (dataset && dataset.name === state.dataset && !series.isPlaying && histogramOf !== histogramAddress(dataset, state.selection)) {
    histogramTimer = window.setTimeout(() => loadHistogram(dataset, state.selection), 250);
  }
}
window.addEventListener('resize', redraw);

// ---- picks ----

/** @typedef {{position: Vec3, isovalue: number, point: any}} Pick */
/** @type {Pick[]} */
let picks = [];
shown.addEventListener('click', async (event) => {
  const { x, y, width, height } = /** @type {CustomEvent} */ (event).detail;
  /** @type {FrameRequest} */
  const frame = { ...series.pinned(shown.getState()), viewport: { widthPx: width, heightPx: height } };
  try {
    const response = await client.post(`v1/datasets/${encodeURIComponent(frame.dataset ?? '')}/pick`, { frame, pixels: [{ x, y }] });
    const point = (await response.json()).points?.[0];
    if (!point?.isHit) {
      picks = [];
    } else {
      const { position = {} } = point;
      picks = [...picks.slice(-1), { position: [position.x ?? 0, position.y ?? 0, position.z ?? 0],
        isovalue: frame.surfaces?.[point.surfaceIndex ?? 0]?.isovalue ?? 0, point }];
    }
    drawPoints();
    announcer.say(sentenceOfPicks());
  } catch (error) {
    say(`Nothing picked: ${/** @type {Error} */ (error).message}`, true);
  }
});

/** @returns {string | null} */
function distanceOfPicks() {
  if (picks.length < 2) {
    return null;
  }
  const [a, b] = picks.map((pick) => pick.position);
  return `${format(Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]), 5)}${unit()}`;
}

/** The newest point, for screen readers. */
function sentenceOfPicks() {
  const pick = picks.at(-1);
  const distance = distanceOfPicks();
  return !pick ? 'There is no surface at this point.' : `Point ${'AB'[picks.length - 1]}: position ` +
    `${pick.position.map((value) => format(value)).join('; ')}${unit()}. Value ${format(pick.isovalue)}.` +
    (distance ? ` A to B: ${distance}.` : '');
}

function drawPoints() {
  shown.setPins(picks.map((pick, i) => ({ position: pick.position, label: 'AB'[i] })));
  page.points.hidden = picks.length === 0;
  const rows = picks.flatMap((pick, i) => {
    const { normal, gradient, blockId, shardIndex } = pick.point;
    /** @param {any} v */
    const text = (v) => ['x', 'y', 'z'].map((axis) => format(v?.[axis] ?? 0, 5)).join(', ');
    const steepness = gradient ? Math.hypot(gradient.x ?? 0, gradient.y ?? 0, gradient.z ?? 0) : null;
    return [make('h3', {}, `Point ${'AB'[i]}`, ...(i === 0 ? [make('button', { className: 'small', onclick: () => { picks = []; drawPoints(); } }, 'Clear')] : [])),
      make('dl', {}, make('dt', {}, 'position'), make('dd', { className: 'position' }, text({ x: pick.position[0], y: pick.position[1], z: pick.position[2] })),
        make('dt', {}, 'value'), make('dd', {}, format(pick.isovalue)),
        ...(normal ? [make('dt', {}, 'normal'), make('dd', {}, ['x', 'y', 'z'].map((axis) => (normal[axis] ?? 0).toFixed(3)).join(', '))] : []),
        ...(steepness !== null ? [make('dt', {}, 'gradient'), make('dd', {}, format(steepness, 4))] : []),
        make('dt', {}, 'block'), make('dd', {}, `${blockId ?? 0}${shardIndex === undefined ? '' : ` of shard ${shardIndex}`}`))];
  });
  const distance = distanceOfPicks();
  if (distance) {
    rows.push(make('div', { className: 'distance' }, make('span', {}, 'A to B'), make('span', {}, distance)));
  }
  page.points.replaceChildren(...rows);
}

// ---- cost ----

/** @type {number[][]} */
const recentSteps = [];
const STEPS = ['occluderSelectionDuration', 'occluderRenderingDuration', 'visibilityCullingDuration', 'compositeDuration', 'encodeDuration'];

/** @param {any} statistics */
function addCost(statistics) {
  recentSteps.push(STEPS.map((name) => milliseconds(statistics.durations?.[name] ?? '0')));
  recentSteps.splice(0, Math.max(0, recentSteps.length - 120));
  drawCost(statistics);
}

/** @param {any[]} agents */
function drawAgents(agents) {
  const longest = Math.max(1, ...agents.map((/** @type {any} */ agent) => milliseconds(agent.busyDuration ?? '0')));
  page.agents.replaceChildren(...agents.map((/** @type {any} */ agent) => {
    const extract = milliseconds(agent.extractDuration ?? '0');
    const draw = milliseconds(agent.renderDuration ?? '0');
    const busy = milliseconds(agent.busyDuration ?? '0');
    const bars = svg('svg', { viewBox: '0 0 100 9', preserveAspectRatio: 'none' });
    let x = 0;
    for (const [value, name] of /** @type {[number, string][]} */ ([[extract, 'extract'], [draw, 'draw'], [Math.max(0, busy - extract - draw), 'rest']])) {
      bars.append(svg('rect', { class: name, x, y: 0, width: 100 * value / longest, height: 9 }));
      x += 100 * value / longest;
    }
    return make('div', { className: 'agent', title: `${agent.agentAddress}: shards ${(agent.shardIndices ?? []).join(', ')}; ` +
      `${Number(agent.triangleCount ?? 0).toLocaleString('en')} triangles, ${formatBytes(Number(agent.readBytes ?? 0))} read` },
    make('span', {}, agent.agentAddress), bars, make('b', {}, `${format(busy, 3)} ms`));
  }), make('div', { className: 'key' }, ...['extract', 'draw', 'rest'].map((name) => make('span', {}, make('i', { className: name }), name))));
}

const drawCost = quietly((/** @type {any} */ statistics) => {
  const canvas = page.times;
  const ratio = devicePixelRatio || 1;
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  const context = canvas.getContext('2d');
  if (context) {
    context.scale(ratio, ratio);
    const style = getComputedStyle(document.documentElement);
    const colors = ['--warn', '--accent', '--bars', '--good', '--quiet'].map((name) => style.getPropertyValue(name));
    const totals = recentSteps.map((one) => one.reduce((a, b) => a + b, 0));
    const top = Math.max(10, ...totals) * 1.15;
    recentSteps.forEach((one, i) => {
      let y = height;
      one.forEach((value, k) => {
        const tall = value / top * height;
        context.fillStyle = colors[k];
        context.fillRect(width - (recentSteps.length - i) * (width / 120), y - tall, Math.max(1, width / 120 - 0.6), tall);
        y -= tall;
      });
    });
    context.fillStyle = style.getPropertyValue('--quiet');
    context.font = '10px system-ui, sans-serif';
    context.fillText(`${format(totals.at(-1) ?? 0, 3)} ms a frame, by step`, 7, 13);
  }
  if (statistics.agents) {  // a moving frame has none: the agents of the last exact one stay
    drawAgents(statistics.agents);
  }
  const count = (/** @type {any} */ value) => Number(value ?? 0).toLocaleString('en');
  const figures = [['Triangles', count(statistics.triangleCount)], ['Active blocks', count(statistics.activeBlockCount)],
    ['Drawn · culled', `${count(statistics.visibleBlockCount)} · ${count(statistics.culledBlockCount)}`],
    ['Read from disk', formatBytes(Number(statistics.readBytes ?? 0))], ['Between servers', formatBytes(Number(statistics.networkBytes ?? 0))]];
  page.figures.replaceChildren(...figures.flatMap(([name, value]) => [make('dt', {}, name), make('dd', {}, value)]));
});

async function watchAgents() {
  try {
    const { agents = [] } = await client.get('v1/status');
    const lost = agents.filter((/** @type {any} */ agent) => agent.state === 'STATE_UNREACHABLE');
    const text = lost.map((/** @type {any} */ agent) => `${agent.address} does not answer: ${agent.message || 'no reason given'}`).join('\n');
    if (text && text !== watchedProblem) {
      say(text, true);
    }
    watchedProblem = text;
  } catch {
    // The view reports that the gateway is unreachable.
  }
}
let watchedProblem = '';

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
/** What the view is shows at once, figures now and then. */
function pillChanged() {
  const kind = !shown.isOpen ? 'closed' : shown.isExact ? 'exact' : 'moving';
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

// ---- link and downloads ----

byId('link', HTMLElement).onclick = () => {
  history.replaceState(null, '', `#${stateToHash(series.pinned(shown.getState()))}`);
  copy(location.href, 'The link is copied: it opens this view again.');
};
function drawCommand() {
  page.command.textContent = stateToCommand(series.pinned(shown.getState()), 'picture.png', shown);
}
// The server sends the camera of a view that is being fitted.
shown.addEventListener('state', () => page.dialog.open && drawCommand());
byId('save', HTMLElement).onclick = () => {
  page.width.value ||= String(shown.width);
  page.height.value ||= String(shown.height);
  drawCommand();
  page.saveSamples.value = String(Math.max(4, Number(shown.state.samples ?? 1)));
  page.dialog.showModal();
};
byId('copy-command', HTMLElement).onclick = () => copy(page.command.textContent ?? '', 'The command is copied.');
byId('sizes', HTMLElement).append(...[['As shown', 0], ['1080p', 1080], ['4K', 2160], ['Print, 8K', 4320]].map(([name, side]) =>
  make('button', { className: 'small', onclick: () => {
    const tall = Number(side) || shown.height;
    page.height.value = String(tall);
    page.width.value = String(Math.round(tall * shown.aspect));
  } }, String(name))));

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

page.savePng.onclick = () => {
  const state = series.pinned(shown.getState());
  /** @type {FrameRequest} */
  const request = { ...state, viewport: { widthPx: page.width.valueAsNumber, heightPx: page.height.valueAsNumber },
    samples: Number(page.saveSamples.value) };
  if (page.transparent.checked) {
    request.backgroundColor = { red: 0, green: 0, blue: 0, alpha: 0 };
  }
  download(page.savePng, page.saveNote, 'Drawing …', `${state.dataset || 'isoscope'}.png`,
    () => client.post(`v1/datasets/${encodeURIComponent(state.dataset ?? '')}/render`, request));
};
byId('save-mesh', HTMLElement).onclick = (event) => {
  const button = /** @type {HTMLButtonElement} */ (event.currentTarget);
  const state = series.pinned(shown.getState());
  const words = stateToHash({ selection: state.selection, surfaces: (state.surfaces ?? []).map((/** @type {any} */ { isovalue, color }) => ({ isovalue, color: color && { ...color, alpha: 1 } })), clip: state.clip });
  download(button, page.meshNote, 'Extracting …', `${state.dataset || 'isoscope'}.glb`,
    () => client.request(`v1/datasets/${encodeURIComponent(state.dataset ?? '')}/mesh.glb?${words}`));
};

listenToHistogram();
loadDatasets();
whileShown(watchAgents, 5000);
whileShown(watchSteps, 5000);
