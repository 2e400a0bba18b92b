// The histogram: its counts, and its chart with a handle for each isovalue.
// @ts-check

import { afterKey, byId, describeSlider, page, svg } from './elements.js';
import { MAX_SURFACES, asShown, isOfLabels } from './label-sets.js';
import { say } from './messages.js';
import { change, client, finiteRangeOf, redraw, shown } from './page-view.js';
import { histogramWords } from './series.js';
import { PALETTE, format, formatIn, fromHex, nextColor, rangesOfChart, tidy, toHex } from './values.js';

// ---- counts ----

/** @type {any} */
let histogram = null;
let histogramOf = '';
let histogramTimer = 0;

/** Whether the pointer is on the chart, and the line below tells what is under it. */
let isHovered = false;

/** @param {any} dataset @param {any} selection */
export function suggestedIsovalue(dataset, selection) {
  const suggestions = histogram?.suggestions ?? [];
  const best = suggestions.find((/** @type {any} */ one) => one.method === 'METHOD_BETWEEN_CLASSES') ?? suggestions[0];
  const { min = 0, max = 1 } = finiteRangeOf(dataset, selection) ?? {};
  return tidyIsovalue(best ? best.isovalue ?? 0 : (Number(min) + Number(max)) / 2, { min: Number(min), max: Number(max) });
}

/**
 * An isovalue with few digits, within the range.
 * @param {number} isovalue @param {{min: number, max: number}} range
 */
function tidyIsovalue(isovalue, { min, max }) {
  const rounded = tidy(isovalue, max - min);
  return rounded > min && rounded <= max ? rounded : isovalue;
}

/** The labels that the samples suggest; none: they are no labels. @returns {number[]} */
export const suggestedLabels = () => histogram?.suggestedLabels ?? [];

function chartHint() {
  return !histogram ? '' : histogram.hasSampleCounts ? `${levelsNow().length > 0 ? 'Drag a line; double-click' : 'Double-click'} adds a surface.`
    : 'Active blocks by isovalue: partition this dataset anew to count its samples.';
}

/** @param {any} dataset @param {any} selection */
const histogramAddress = (dataset, selection) =>
  `v1/datasets/${encodeURIComponent(dataset.name)}/histogram?bins=256${histogramWords(dataset, selection)}`;

/** @param {any} dataset @param {any} selection */
export async function loadHistogram(dataset, selection) {
  const address = histogramAddress(dataset, selection);
  if (histogramOf === address && histogram) {
    return;
  }
  // The curve of another step stays until the new one is here.
  histogram = histogramOf.startsWith(`v1/datasets/${encodeURIComponent(dataset.name)}/`) ? histogram : null;
  histogramOf = address;
  clearTimeout(histogramTimer);
  try {
    const answer = await client.get(address);
    if (histogramOf !== address) {
      return;  // another one was asked for meanwhile
    }
    histogram = answer;
    page.hover.textContent = chartHint();
    page.hover.classList.remove('error');
  } catch (error) {
    if (histogramOf !== address) {
      return;
    }
    page.hover.textContent = `No histogram: ${/** @type {Error} */ (error).message}`;
    page.hover.classList.add('error');
  }
  redraw();
}

/**
 * Counts of another step are asked for once the time rests.
 * @param {boolean} isPlaying or about to show other samples, whose counts are being asked for
 */
export function followHistogram(isPlaying) {
  clearTimeout(histogramTimer);
  const { dataset, state } = shown;
  if (dataset && dataset.name === state.dataset && !isPlaying && histogramOf !== histogramAddress(dataset, state.selection)) {
    histogramTimer = window.setTimeout(() => loadHistogram(dataset, state.selection), 250);
  }
}

// ---- chart ----

const CHART = { width: 294, height: 132, left: 8, right: 8, top: 16, bottom: 20 };

// A field has its range over all steps, so that a surface's line stands still during play.
const chartRanges = () => rangesOfChart((shown.dataset?.fields ?? []).length > 0 ? [] : histogram?.bins ?? [],
  finiteRangeOf(shown.dataset, shown.state.selection));

/** @param {number} value */
function toChart(value) {
  const { min, max } = chartRanges().edges;
  return CHART.left + (value - min) / (max - min) * (CHART.width - CHART.left - CHART.right);
}

/** @param {number} x of the chart */
function fromChart(x) {
  const { edges: { min, max }, values } = chartRanges();
  const share = (x - CHART.left) / (CHART.width - CHART.left - CHART.right);
  const step = 10 ** Math.floor(Math.log10((max - min) / 500));
  const value = Math.max(values.min, Math.min(values.max, min + share * (max - min)));
  return Number((Math.round(value / step) * step).toPrecision(12));
}

/**
 * The surfaces of isovalues, with their places in the state.
 * @returns {{surface: any, index: number}[]}
 */
const levelsNow = () => (shown.state.surfaces ?? []).map((/** @type {any} */ surface, /** @type {number} */ index) => ({ surface, index }))
  .filter((/** @type {any} */ level) => !isOfLabels(level.surface));

export function drawHistogram() {
  CHART.width = page.histogram.clientWidth || CHART.width;
  const bins = histogram?.bins ?? [];
  const counts = bins.map((/** @type {any} */ bin) => Number(histogram.hasSampleCounts ? bin.sampleCount ?? 0 : bin.activeBlockCount ?? 0));
  const top = Math.log1p(Math.max(1, ...counts));
  const floor = CHART.height - CHART.bottom;
  /** @param {number} count */
  const y = (count) => floor - Math.log1p(count) / top * (floor - CHART.top);
  const { edges, values: { min, max } } = chartRanges();
  const begin = bins.length > 0 ? Number(bins[0].min ?? 0) : edges.min;
  let path = `M${toChart(begin).toFixed(1)},${floor}`;
  bins.forEach((/** @type {any} */ bin, /** @type {number} */ i) => {
    path += `V${y(counts[i]).toFixed(1)}H${toChart(Number(bin.max ?? 0)).toFixed(1)}`;
  });
  path += `V${floor}Z`;
  const parts = [svg('path', { class: 'area', d: path })];
  for (const [value, anchor] of /** @type {[number, string][]} */ ([[min, 'start'], [(min + max) / 2, 'middle'], [max, 'end']]).slice(0, max > min ? 3 : 1)) {
    parts.push(svg('text', { class: 'tick', x: toChart(value), y: CHART.height - 5, 'text-anchor': anchor }, formatIn(value, { min, max })));
  }
  const levels = levelsNow();
  // Labels alone have no line to drag there.
  for (const suggestion of levels.length > 0 ? histogram?.suggestions ?? [] : []) {
    const x = toChart(suggestion.isovalue ?? 0);
    parts.push(svg('path', { class: 'suggestion', d: `M${x - 4},${floor + 5}h8l-4,-5z` }, svg('title', {},
      `Suggested: ${format(suggestion.isovalue ?? 0, 4)}`)));
  }
  page.histogram.setAttribute('viewBox', `0 0 ${CHART.width} ${CHART.height}`);
  page.chart.replaceChildren(...parts);
  if (!isHovered && histogram) {
    page.hover.textContent = chartHint();
  }
  // A focused handle must not be replaced: screen readers would read it again.
  if (page.handles.children.length !== levels.length) {
    page.handles.replaceChildren(...levels.map((_, i) => svg('g', { class: 'handle', tabindex: 0, role: 'slider', 'aria-label': `Isovalue ${i + 1}`,
        'aria-orientation': 'horizontal' }, svg('line', { y1: 10, y2: floor }), svg('circle', { cy: 9, r: 6.5 }))));
  }
  levels.forEach(({ surface: { isovalue = 0, color }, index }, i) => {
    const handle = page.handles.children[i];
    handle.setAttribute('data-surface', String(index));
    const [line, circle] = handle.children;
    handle.classList.toggle('beyond', isovalue < edges.min || isovalue > edges.max);
    const x = String(Math.max(CHART.left, Math.min(CHART.width - CHART.right, toChart(isovalue))));
    const paint = toHex(color ?? fromHex(PALETTE[0]));
    for (const [element, name, value] of /** @type {[Element, string, string][]} */ ([[line, 'x1', x], [line, 'x2', x],
      [line, 'stroke', paint], [circle, 'cx', x], [circle, 'fill', paint]])) {
      element.setAttribute(name, value);
    }
    describeSlider(handle, { min, max, now: isovalue, text: format(isovalue) });
  });
}

// ---- surfaces by the chart ----

/** @param {number} index @param {Record<string, any>} part @param {boolean} [isMoving] */
export function changeSurface(index, part, isMoving = false) {
  const surfaces = structuredClone(shown.state.surfaces ?? []);
  Object.assign(surfaces[index], part);
  change({ surfaces }, isMoving);
}

/** @param {number} isovalue */
function addSurface(isovalue) {
  const all = structuredClone(shown.state.surfaces ?? []);
  if (all.length >= MAX_SURFACES) {
    say(`A picture has at most ${MAX_SURFACES} surfaces.`, true);
    return;
  }
  const surfaces = all.filter((/** @type {any} */ one) => !isOfLabels(one));
  const color = nextColor(surfaces.map((/** @type {any} */ surface) => toHex(surface.color ?? fromHex(PALETTE[0]))));
  // The outer surface becomes translucent, so that the new one is visible.
  for (const surface of surfaces) {
    surface.color ??= fromHex(PALETTE[0]);
    if (surfaces.length === 1 && isovalue > (surface.isovalue ?? 0) && surface.color.alpha === 1) {
      surface.color.alpha = 0.4;
    }
  }
  const isClear = surfaces.some((/** @type {any} */ surface) => isovalue < (surface.isovalue ?? 0));
  surfaces.push({ isovalue, color: fromHex(color, isClear ? 0.4 : 1), ...(surfaces[0]?.colorBy ? { colorBy: surfaces[0].colorBy } : {}) });
  change({ surfaces: asShown([...surfaces, ...all.filter(isOfLabels)], finiteRangeOf(shown.dataset, shown.state.selection)) });
}

/** Adds a surface at a suggestion that has none near it, else above the others. */
function addSuggestedSurface() {
  const values = levelsNow().map(({ surface }) => surface.isovalue ?? 0);
  const { min, max } = chartRanges().values;
  const free = (histogram?.suggestions ?? []).map((/** @type {any} */ one) => one.isovalue ?? 0)
    .find((/** @type {number} */ value) => values.every((/** @type {number} */ used) => Math.abs(used - value) > (max - min) / 50));
  addSurface(free !== undefined ? tidyIsovalue(free, { min, max }) : fromChart(toChart((Math.max(min, ...values) + max) / 2)));
}

export function listenToHistogram() {
  const chart = page.histogram;
  let dragged = -1;
  /** @param {MouseEvent} event */
  const x = (event) => {
    const box = chart.getBoundingClientRect();
    return (event.clientX - box.left) / box.width * CHART.width;
  };
  chart.addEventListener('pointerdown', (event) => {
    const distances = levelsNow().map(({ surface }) => Math.abs(toChart(surface.isovalue ?? 0) - x(event)));
    const nearest = distances.indexOf(Math.min(...distances));
    dragged = distances[nearest] < (event.pointerType === 'touch' ? 24 : 12) ? levelsNow()[nearest].index : -1;
    if (dragged >= 0) {
      chart.setPointerCapture(event.pointerId);
      event.preventDefault();
    }
  });
  chart.addEventListener('pointermove', (event) => {
    isHovered = true;
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
  chart.addEventListener('pointerleave', () => { isHovered = false; page.hover.textContent = chartHint() || page.hover.textContent; });
  chart.addEventListener('dblclick', (event) => addSurface(fromChart(x(event))));
  chart.addEventListener('keydown', (event) => {
    const index = Number(/** @type {Element} */ (event.target).getAttribute('data-surface') ?? NaN);
    const { min, max } = chartRanges().values;
    const isovalue = Number.isInteger(index) ? afterKey(event.key, shown.state.surfaces[index].isovalue ?? 0, min, max) : null;
    if (isovalue !== null) {
      changeSurface(index, { isovalue: fromChart(toChart(isovalue)) }, true);
      event.preventDefault();
    }
  });
  byId('add', HTMLElement).onclick = addSuggestedSurface;
}
