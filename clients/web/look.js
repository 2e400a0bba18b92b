// Colour and light: colours of surfaces, background, lights, effects; and the legend of the picture.
// @ts-check

import { COLOR_MAP_POINTS } from './color-maps.js';
import { make, page } from './elements.js';
import { basisOf } from './isoscope-view.js';
import { isOfLabels } from './label-sets.js';
import { say } from './messages.js';
import { change, shown } from './page-view.js';
import { titleOfColoring } from './series.js';
import { format, fromHex, percent, toHex } from './values.js';
import { COLOR_MAPS, colorByFromKey, colorByToKey, colorMapFromJson, colorMapToJson, stateToHash } from './view-state.js';

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
  page.opacityMin.oninput = page.opacityMax.oninput = () => changeColorBy(true);
  page.background.oninput = () => change({ backgroundColor: fromHex(page.background.value) }, true);
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
}

export function drawLook() {
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
export function drawLegend(frame) {
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
