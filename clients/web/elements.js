// Elements of the page: found, made and described. It knows no view and no state.
// @ts-check

/** @template {HTMLElement} T @param {string} id @param {new () => T} type @returns {T} */
export function byId(id, type) {
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
export function make(name, attributes = {}, ...children) {
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
export function svg(name, attributes, ...children) {
  const element = document.createElementNS('http://www.w3.org/2000/svg', name);
  for (const [key, value] of Object.entries(attributes)) {
    element.setAttribute(key, String(value));
  }
  element.append(...children);
  return element;
}

export const page = {
  dataset: byId('dataset', HTMLSelectElement), facts: byId('facts', HTMLElement), views: byId('views', HTMLElement),
  state: byId('state', HTMLElement), legend: byId('legend', HTMLElement), choice: byId('choice', HTMLElement), points: byId('points', HTMLElement),
  hover: byId('hover', HTMLElement), surfaces: byId('surfaces', HTMLElement), quantity: byId('quantity', HTMLSelectElement),
  map: byId('map', HTMLSelectElement), rangeMin: byId('range-min', HTMLInputElement),
  rangeMax: byId('range-max', HTMLInputElement), opacityMin: byId('opacity-min', HTMLInputElement),
  opacityMax: byId('opacity-max', HTMLInputElement), caps: byId('caps', HTMLSelectElement), background: byId('background', HTMLInputElement),
  nanColor: byId('nan-color', HTMLInputElement), nanDefault: byId('nan-default', HTMLButtonElement), notes: byId('notes', HTMLElement),
  lights: byId('lights', HTMLSelectElement), effects: byId('effects', HTMLElement),
  samples: byId('samples', HTMLSelectElement),
  parallel: byId('parallel', HTMLInputElement), box: byId('box', HTMLInputElement), clip: byId('clip', HTMLElement),
  planes: byId('planes', HTMLElement), times: byId('times', HTMLCanvasElement), agents: byId('agents', HTMLElement),
  figures: byId('figures', HTMLElement), dialog: byId('dialog', HTMLDialogElement), width: byId('width', HTMLInputElement),
  height: byId('height', HTMLInputElement), saveSamples: byId('save-samples', HTMLSelectElement),
  transparent: byId('transparent', HTMLInputElement), savePng: byId('save-png', HTMLButtonElement),
  saveNote: byId('save-note', HTMLElement), meshNote: byId('mesh-note', HTMLElement), command: byId('command', HTMLElement),
  labels: byId('labels', HTMLElement), labelList: byId('label-list', HTMLElement), labelSet: byId('label-set', HTMLInputElement),
  labelsMore: byId('labels-more', HTMLElement), toast: byId('toast', HTMLElement), speech: byId('speech', HTMLElement), dialogSpeech: byId('dialog-speech', HTMLElement),
  histogram: /** @type {SVGSVGElement} */ (/** @type {unknown} */ (document.getElementById('histogram'))),
  chart: /** @type {SVGGElement} */ (/** @type {unknown} */ (document.getElementById('chart'))),
  handles: /** @type {SVGGElement} */ (/** @type {unknown} */ (document.getElementById('handles'))),
};

/**
 * Sets the value and the limits of a slider.
 * @param {Element} slider @param {{min: number, max: number, now: number, text: string}} value
 */
export function describeSlider(slider, { min, max, now, text }) {
  for (const [name, word] of Object.entries({ valuemin: min, valuemax: max, valuenow: now, valuetext: text })) {
    slider.setAttribute(`aria-${name}`, String(word));
  }
}

/** Where a key takes a slider: steps of a hundredth or a tenth of it, or an end of it; null if it moves none. */
const SLIDER_KEYS = /** @type {Record<string, number>} */ ({ ArrowLeft: -0.01, ArrowDown: -0.01, ArrowRight: 0.01,
  ArrowUp: 0.01, PageDown: -0.1, PageUp: 0.1, Home: -Infinity, End: Infinity });
/** @param {string} key @param {number} now @param {number} min @param {number} max */
export function afterKey(key, now, min, max) {
  const step = SLIDER_KEYS[key];
  return step === undefined ? null : Math.max(min, Math.min(max, now + step * (max - min)));
}

/**
 * Returns a function that calls `draw` at once, and then at most every 250 ms, with the newest
 * argument. It is for text: without a GPU, a browser takes longer to draw it than a picture.
 * @template T @param {(argument: T) => void} draw
 */
export function quietly(draw) {
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
