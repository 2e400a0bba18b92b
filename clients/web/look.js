// Colour and light: colours of surfaces, background, lights, effects; and the legend of the picture.
// @ts-check

import { COLOR_MAP_POINTS } from './color-maps.js';
import { drawColorRange, listenToColorRange } from './color-range.js';
import { byId, make, page } from './elements.js';
import { axisNamesOf, basisOf } from './isoscope-view.js';
import { isNothing, isOfLabels } from './label-sets.js';
import { announcer, say } from './messages.js';
import { change, finiteRangeOf, samplesOf, shown } from './page-view.js';
import { COLOR_MAPS, EFFECTS } from './parameters.js';
import { choiceOf, legendOf } from './series.js';
import { format, fromHex, percent, toHex, whyBeyond } from './values.js';
import { defaultNanColor, colorByFromKey, colorByToKey, colorMapFromJson, colorMapToJson, stateToHash } from './view-state.js';

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
    // A surface of labels has no gradient.
    if (quantity !== 'none' && !(quantity === 'gradient' && isOfLabels(surface))) {
      surface.colorBy = { ...colorByFromKey(quantity), ...(isMapped ? { colorMap: colorMapToJson(page.map.value) } : {}),
        ...(isRange ? { range: { min, max } } : {}), ...(isMapped && atMin * atMax < 1 ? { opacity: { atMin, atMax } } : {}) };
    }
  }
  change({ surfaces }, isMoving === true);
}

/** @typedef {import('./series.js').LegendEntry} LegendEntry */

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

export function listenToLook() {
  page.map.replaceChildren(...COLOR_MAPS.map((name) => make('option', { value: name }, name)));
  page.quantity.onchange = () => {
    page.rangeMin.value = page.rangeMax.value = '';
    changeColorBy();
  };
  page.map.onchange = page.rangeMin.onchange = page.rangeMax.onchange = () => changeColorBy();
  listenToColorRange(({ min, max }) => {
    [page.rangeMin.value, page.rangeMax.value] = [String(min), String(max)];
    changeColorBy();
  });
  page.opacityMin.oninput = page.opacityMax.oninput = () => changeColorBy(true);
  page.nanColor.oninput = () => change({ nanColor: fromHex(page.nanColor.value) }, true);
  page.nanDefault.onclick = () => change({ nanColor: undefined });
  page.background.oninput = () => change({ backgroundColor: fromHex(page.background.value) }, true);
  page.lights.onchange = () => change({ lights: LIGHTS[page.lights.value] });
  page.effects.replaceChildren(...EFFECTS.map(({ flag, json, title, values: [first] }) => {
    const onchange = (/** @type {any} */ { target }) =>
      change({ [json]: target.checked ? { [first.json]: Number(first.initial) } : undefined });
    return make('label', { className: 'switch' }, make('input', { id: flag, type: 'checkbox', onchange }), make('span', {}, title));
  }));
  page.samples.onchange = () => change({ samples: page.samples.value === '1' ? undefined : Number(page.samples.value) });
  page.box.onchange = () => shown.decorate({ box: page.box.checked });
  page.parallel.onchange = () => {
    const { camera } = shown;
    if (camera) {
      const height = 2 * Math.tan(camera.fovYDegrees * Math.PI / 360) * basisOf(camera).distance;
      shown.setCamera({ ...camera, height: page.parallel.checked ? height : 0 });
    }
  };
}

export function drawLook() {
  const { state } = shown;
  axisNamesOf(shown.dataset).forEach((name, axis) => {
    const option = page.quantity.querySelector(`option[value=${'xyz'[axis]}]`);
    /** @type {HTMLOptionElement} */ (option).textContent = `position ${name}`;
  });
  const colorBy = (state.surfaces ?? []).find((/** @type {any} */ surface) => surface.colorBy)?.colorBy;
  const quantity = colorByToKey(colorBy);
  page.quantity.value = quantity;
  const isMapped = quantity !== 'none' && quantity !== 'normal';
  document.querySelectorAll('[data-for=map]').forEach((row) => { /** @type {HTMLElement} */ (row).hidden = !isMapped; });
  drawColorRange();
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
    /** @type {HTMLElement} */ (input.nextElementSibling).textContent = percent(opacity);
  }
  const showsSamples = Boolean(state.caps?.colorMap) ||
    (state.surfaces ?? []).some((/** @type {any} */ { colorBy: one }) => one?.quantity === 'QUANTITY_FIELD');
  document.querySelectorAll('[data-for=nan]').forEach((row) => { /** @type {HTMLElement} */ (row).hidden = !showsSamples; });
  page.nanColor.value = state.nanColor ? toHex(state.nanColor) : defaultNanColor(state.caps?.colorMap ?? colorBy?.colorMap);
  page.nanDefault.disabled = !state.nanColor;
  page.background.value = toHex(state.backgroundColor);
  const words = lightWords(state.lights);
  page.lights.value = Object.keys(LIGHTS).find((name) => lightWords(LIGHTS[name]) === words) ?? 'custom';
  EFFECTS.forEach(({ flag, json }) => { byId(flag, HTMLInputElement).checked = Boolean(state[json]); });
  page.samples.value = String(state.samples || 1);
  page.box.checked = shown.decorations.box;
  page.parallel.checked = (shown.camera?.height ?? 0) > 0;
}

/** @param {LegendEntry} entry */
function barOf({ title, colorMap, range, nan }) {
  const canvas = /** @type {HTMLCanvasElement} */ (make('canvas', { width: 12, height: 160 }));
  const context = canvas.getContext('2d');
  const points = COLOR_MAP_POINTS[colorMapFromJson(colorMap)] ?? [];
  if (context) {
    const gradient = context.createLinearGradient(0, 160, 0, 0);
    points.forEach((color, i) => gradient.addColorStop(i / (points.length - 1), color));
    context.fillStyle = gradient;
    context.fillRect(0, 0, 12, 160);
  }
  const bar = make('div', { className: 'legend' }, make('span', {}, title), canvas,
    make('b', {}, format(Number(range.max ?? 0), 4)), make('em', {}, format(Number(range.min ?? 0), 4)));
  if (nan) {
    const swatch = make('i', {});
    swatch.style.background = nan;
    bar.append(swatch, make('small', {}, 'no data'));
  }
  return bar;
}

let legendDrawn = '[]';
/** @type {any} */
let legendFrame = null;
/** @param {any} [frame] of the response; default: the last one, as its dataset, which names the axes, may have come since */
export function drawLegend(frame = legendFrame) {
  legendFrame = frame;
  const entries = legendOf(frame, shown.dataset);
  const words = JSON.stringify(entries);
  if (words !== legendDrawn) {
    legendDrawn = words;
    page.legend.hidden = entries.length === 0;
    page.legend.replaceChildren(...entries.map(barOf));
  }
}

/**
 * Of the server, for the surfaces and the step of `of`.
 * @type {{of: string, notes: any[]}}
 */
let serverNotes = { of: '', notes: [] };
const notedNow = () => JSON.stringify([shown.state.surfaces, shown.state.selection]);

/**
 * Keeps what the server says of surfaces that do not show. Only exact pictures have notes; the last ones stay while
 * the picture moves.
 * @param {any} frame of the response @param {boolean} isExact
 */
export function takeNotes(frame, isExact) {
  if (frame && isExact) {
    serverNotes = { of: notedNow(), notes: frame.notes ?? [] };
    drawNotes();
  }
}

let notesDrawn = '';
/** Shows why surfaces do not show: at once where the isovalue is beyond the samples, else as the server says. */
export function drawNotes() {
  const { surfaces = [], selection } = shown.state;
  const range = finiteRangeOf(shown.dataset, selection);
  const unit = choiceOf(shown.dataset, selection)?.field.unit;
  /** @type {Map<number, string>} */
  const beyond = new Map();
  surfaces.forEach((/** @type {any} */ surface, /** @type {number} */ i) => {
    // Of all samples: there are surfaces around infinite ones.
    const why = isOfLabels(surface) ? '' : whyBeyond(surface.isovalue ?? 0, samplesOf(shown.dataset, selection).valueRange, unit);
    if (why) {
      beyond.set(i, why);
    }
  });
  const others = serverNotes.of !== notedNow() ? [] : serverNotes.notes.filter((/** @type {any} */ { surfaceIndex = 0 }) => {
    const surface = surfaces[surfaceIndex];
    return !beyond.has(surfaceIndex) && (!surface || !isNothing(surface, range));
  }).map((/** @type {any} */ { message }) => message);
  const text = [...beyond.values(), ...others].join('\n');
  if (text !== notesDrawn) {
    notesDrawn = text;
    page.notes.textContent = text;
    page.notes.hidden = text === '';
    if (text) {
      announcer.say(text);
    }
  }
}
