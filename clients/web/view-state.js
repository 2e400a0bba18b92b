// The state of the view as words of the command line: `surface=60:0.9,0.8,0.7:1&eye=...`. It is the
// part of the page's address after '#', the query of GET .../render, and the flags of `isoscope
// render`. Numbers keep their bits. Written states have only numbers; states to read may also use
// CSS colour names.
// @ts-check

import { colorFromText } from './css-colors.js';

/** @typedef {Record<string, any>} FrameRequest RenderIsosurfaceRequest as JSON. */

export const COLOR_MAPS = ['viridis', 'magma', 'cividis', 'turbo', 'cool-warm', 'grey'];
/** @type {Record<string, string>} */
const QUANTITIES = {
  x: 'QUANTITY_POSITION_X', y: 'QUANTITY_POSITION_Y', z: 'QUANTITY_POSITION_Z', normal: 'QUANTITY_NORMAL',
  gradient: 'QUANTITY_GRADIENT_MAGNITUDE',
};

/** @param {string} name */
export const colorMapToJson = (name) => `COLOR_MAP_${name.toUpperCase().replace('-', '_')}`;
/** @param {string | undefined} json */
export const colorMapFromJson = (json) => (json ?? 'COLOR_MAP_VIRIDIS').replace('COLOR_MAP_', '').toLowerCase().replace('_', '-');
/** @param {string | undefined} json */
export const quantityFromJson = (json) => Object.keys(QUANTITIES).find((name) => QUANTITIES[name] === json) ?? 'none';
/** @param {string} name */
export const quantityToJson = (name) => QUANTITIES[name];

/**
 * Returns what a colouring shows, as one word: 'none', 'x', ..., or 'field:velocity:x'.
 * @param {any} colorBy
 */
export const colorByToKey = (colorBy) => colorBy?.quantity === 'QUANTITY_FIELD' ? `field:${fieldToWord(colorBy)}`
  : quantityFromJson(colorBy?.quantity);
/**
 * The inverse, of all but 'none'.
 * @param {string} key
 */
export const colorByFromKey = (key) => key.startsWith('field:')
  ? { quantity: 'QUANTITY_FIELD', ...fieldFromWord(key.slice('field:'.length)) } : { quantity: quantityToJson(key) };

/**
 * A field and its component in one word: 'pressure', 'velocity:x'.
 * @param {{field?: string, component?: string}} of
 */
export const fieldToWord = ({ field, component }) => `${field ?? ''}${component ? `:${component}` : ''}`;
/** @param {string} word @returns {{field: string, component?: string}} */
export function fieldFromWord(word) {
  const colon = word.lastIndexOf(':');
  return colon < 0 ? { field: word } : { field: word.slice(0, colon), component: word.slice(colon + 1) };
}

/**
 * Returns the half-space on the other side of the same plane.
 * @param {any} halfSpace
 */
export function otherSideOf({ normal, offset = 0 }) {
  return { normal: { x: -(normal.x ?? 0), y: -(normal.y ?? 0), z: -(normal.z ?? 0) }, offset: -offset };
}

/** @param {any} v */
const vec = (v) => `${v?.x ?? 0},${v?.y ?? 0},${v?.z ?? 0}`;
/** @param {any} c */
const rgb = (c) => `${c?.red ?? 0},${c?.green ?? 0},${c?.blue ?? 0}`;

/** @param {any} colorBy */
function colorByToWords(colorBy) {
  const quantity = colorBy?.quantity === 'QUANTITY_FIELD' ? fieldToWord(colorBy) : quantityFromJson(colorBy?.quantity);
  if (quantity === 'none' || quantity === 'normal') {
    return quantity;
  }
  const opacity = colorBy.opacity ? `:${colorBy.opacity.atMin ?? 0},${colorBy.opacity.atMax ?? 0}` : '';
  const range = colorBy.range ? `:${colorBy.range.min ?? 0},${colorBy.range.max ?? 0}` : opacity && ':';
  return `${quantity}:${colorMapFromJson(colorBy.colorMap)}${range}${opacity}`;
}

/**
 * The values of each flag in a state: none, one, or one for each time that the flag is given. The value '' is a flag
 * alone. Only flags of `isoscope render`: the page shows them as a command.
 * @type {Record<string, (state: FrameRequest) => string[]>}
 */
const FLAG_VALUES = {
  dataset: ({ dataset }) => dataset ? [dataset] : [],
  field: ({ selection }) => selection?.field ? [fieldToWord(selection)] : [],
  step: ({ selection }) => selection?.timeStep == null ? [] : [selection.timeStep < 0 ? 'last' : String(selection.timeStep)],
  time: ({ selection }) => selection?.time == null || selection.timeStep != null ? [] : [String(selection.time)],
  surface: ({ surfaces }) => (surfaces ?? []).map((/** @type {any} */ { isovalue, color }) => {
    const alpha = color?.alpha ?? 0;
    return `${isovalue ?? 0}${color ? `:${rgb(color)}${alpha === 1 ? '' : `:${alpha}`}` : ''}`;
  }),
  'color-by': ({ surfaces }) => (surfaces ?? []).some((/** @type {any} */ surface) => surface.colorBy)
    ? surfaces.map((/** @type {any} */ surface) => colorByToWords(surface.colorBy)) : [],
  eye: ({ camera }) => camera ? [vec(camera.eye)] : [],
  target: ({ camera }) => camera ? [vec(camera.target)] : [],
  up: ({ camera }) => camera ? [vec(camera.up)] : [],
  'fov-y': ({ camera }) => camera && !camera.orthographic ? [String(camera.perspective?.fovYDegrees ?? 30)] : [],
  'orthographic-height': ({ camera }) => camera?.orthographic ? [String(camera.orthographic.height ?? 0)] : [],
  fit: ({ cameraFit }) => cameraFit === 'CAMERA_FIT_SURFACE' ? ['surface'] : [],
  'clip-plane': ({ clip }) => (clip?.halfSpaces ?? []).map((/** @type {any} */ plane) => `${vec(plane.normal)},${plane.offset ?? 0}`),
  'clip-box': ({ clip }) => clip?.box
    ? [['x', 'y', 'z'].map((axis) => `${clip.box.min?.[axis] ?? 0},${clip.box.max?.[axis] ?? 0}`).join()] : [],
  caps: ({ caps }) => {
    const { colorMap, range } = caps ?? {};
    return !caps ? [] : colorMap ? [`${colorMapFromJson(colorMap)}${range ? `:${range.min ?? 0},${range.max ?? 0}` : ''}`] : [''];
  },
  light: ({ lights }) => (lights ?? []).map((/** @type {any} */ { direction, intensity, color }) =>
    `${vec(direction)}:${intensity ?? 1}${color ? `:${rgb(color)}` : ''}`),
  'light-space': ({ lights }) => lights?.[0]?.space === 'SPACE_WORLD' ? ['world'] : [],
  samples: ({ samples }) => samples > 1 ? [String(samples)] : [],
  'ambient-occlusion': ({ ambientOcclusion: effect }) =>
    effect ? [`${effect.radiusPx || 32}${effect.strength == null ? '' : `,${effect.strength}`}`] : [],
  silhouette: ({ silhouette }) =>
    silhouette ? [`${silhouette.widthPx || 2}${silhouette.color ? `:${rgb(silhouette.color)}` : ''}`] : [],
  'max-layers': ({ maxLayers }) => maxLayers ? [String(maxLayers)] : [],
  background: ({ backgroundColor: color }) => color ? [`${rgb(color)}${color.alpha === 1 ? '' : `,${color.alpha ?? 0}`}`] : [],
};
export const FLAGS = Object.keys(FLAG_VALUES);

/**
 * Returns names and values. A part that is null counts as absent.
 * @param {FrameRequest} state @returns {[string, string][]}
 */
export function stateToWords(state) {
  return FLAGS.flatMap((name) => FLAG_VALUES[name](state).map((value) => /** @type {[string, string]} */ ([name, value])));
}

/** @param {FrameRequest} state the part of an address after '#' */
export function stateToHash(state) {
  return stateToWords(state).map(([name, value]) =>
    `${name}=${encodeURIComponent(value).replace(/%2C/g, ',').replace(/%3A/g, ':')}`).join('&');
}

/** Its reader knows the coordinator's address, the page does not. */
const COMMAND = 'isoscope render --server HOST:50051';

/**
 * Returns the command that draws the same picture. A fitted view has its own camera once the server
 * has answered. Until then the command has the initial camera, because it takes no fit with a
 * camera.
 * @param {FrameRequest} state @param {string} file @param {{width: number, height: number}} [size]
 */
export function stateToCommand(state, file, size) {
  const flags = stateToWords(state.camera ? { ...state, cameraFit: undefined } : state).map(([name, value]) =>
    value === '' ? `--${name}` : `--${name} ${/^[\w.,:+-]+$/.test(value) ? value : `'${value.replace(/'/g, '\'\\\'\'')}'`}`);
  if (size) {
    flags.push(`--width ${size.width}`, `--height ${size.height}`);
  }
  return [COMMAND, ...flags, `--output ${file}`].join(' \\\n  ');
}

/** Reads values and notes what is wrong with them. */
class Reader {
  constructor() {
    /** @type {string[]} */
    this.problems = [];
  }

  /** @param {string} name @param {string} text @param {number} least @param {number} [most] */
  numbers(name, text, least, most = least) {
    const parts = text.split(',');
    const values = parts.map((part) => part.trim() === '' ? NaN : Number(part));
    if (values.length < least || values.length > most || !values.every(Number.isFinite)) {
      const count = least === most ? `${least}` : `${least} to ${most}`;
      this.problems.push(`${name}=${text.slice(0, 60)} of this link was left out: it needs ${count} numbers with commas ` +
        'between them.');
      return null;
    }
    return values;
  }

  /** @param {string} name @param {string} text */
  vec(name, text) {
    const v = this.numbers(name, text, 3);
    return v && { x: v[0], y: v[1], z: v[2] };
  }

  /** @param {string} name @param {string} text @param {number} [alpha] */
  color(name, text, alpha = 1) {
    const named = colorFromText(text, alpha);
    if (named) {
      return named;
    }
    if (!text.includes(',')) {
      this.problems.push(`${name}=${text.slice(0, 60)} of this link was left out: a colour is a name of CSS, #RRGGBB, or ` +
        'three numbers from 0 to 1 with commas between them.');
      return null;
    }
    const v = this.numbers(name, text, 3, 4);
    return v && { red: v[0], green: v[1], blue: v[2], alpha: v[3] ?? alpha };
  }
}

/** Words that mean something without a value. */
const ALONE = ['caps', 'ambient-occlusion', 'silhouette'];

/**
 * Returns the state of the part of an address after '#', and a sentence for each part that is wrong
 * and left out. A word with the value null, or without a required value, counts as absent.
 * @param {string} hash @returns {{state: FrameRequest, problems: string[]}}
 */
export function stateFromHash(hash) {
  const reader = new Reader();
  /** @type {FrameRequest} */
  const state = {};
  /** @type {any} */
  const camera = {};
  /** @type {any[]} */
  const colorings = [];
  // The appearance of surfaces without a colour of their own.
  /** @type {any} */
  let plain = null;
  /** @type {Record<string, (value: string) => void>} */
  const words = {
    dataset: (value) => { state.dataset = value; },
    surface: (value) => {
      const [level, color, opacity] = value.split(':');
      const isovalue = reader.numbers('surface', level, 1);
      const alpha = opacity === undefined ? [1] : reader.numbers('surface', opacity, 1);
      const mixed = color === undefined ? undefined : reader.color('surface', color, alpha?.[0]);
      if (isovalue && alpha && mixed !== null) {
        (state.surfaces ??= []).push(mixed ? { isovalue: isovalue[0], color: mixed } : { isovalue: isovalue[0] });
      }
    },
    isovalue: (value) => {
      for (const isovalue of reader.numbers('isovalue', value, 1, 16) ?? []) {
        (state.surfaces ??= []).push({ isovalue });
      }
    },
    color: (value) => { plain = reader.color('color', value); },
    field: (value) => {
      const chosen = fieldFromWord(value);
      if (!chosen.field || chosen.component === '') {
        reader.problems.push(`field=${value.slice(0, 60)} of this link was left out: it is NAME or NAME:COMPONENT.`);
        return;
      }
      state.selection = { ...state.selection, ...chosen };
    },
    component: (value) => { state.selection = { ...state.selection, component: value }; },
    step: (value) => {
      const number = value === 'first' ? 0 : value === 'last' ? -1 : Number(value);
      if (!Number.isInteger(number) || value.trim() === '' || number < -1 || number >= 2 ** 31) {
        reader.problems.push(`step=${value.slice(0, 60)} of this link was left out: it is the number of a time step, from ` +
          '0, or first or last.');
        return;
      }
      state.selection = { ...state.selection, timeStep: number };
    },
    time: (value) => {
      const time = reader.numbers('time', value, 1);
      if (time) {
        state.selection = { ...state.selection, time: time[0] };
      }
    },
    'color-by': (value) => {
      const [first, ...rest] = value.split(':');
      const isField = first !== 'none' && !QUANTITIES[first];
      // The word after a field is its component, unless it is a map.
      const component = isField && rest.length > 0 && !COLOR_MAPS.includes(rest[0]) ? rest.shift() : undefined;
      const [map, ends, opacities] = rest;
      if (first === '' || component === '' || map && !COLOR_MAPS.includes(map)) {
        reader.problems.push(`color-by=${value.slice(0, 60)} of this link was left out: it is x, y, z, normal, gradient, ` +
          `none or a field, then one of ${COLOR_MAPS.join(', ')}.`);
        return;
      }
      const range = ends ? reader.numbers('color-by', ends, 2) : null;
      const opacity = opacities ? reader.numbers('color-by', opacities, 2) : null;
      colorings.push(first === 'none' ? null : {
        ...(isField ? { quantity: 'QUANTITY_FIELD', field: first, ...(component ? { component } : {}) } : { quantity: QUANTITIES[first] }),
        ...(map ? { colorMap: colorMapToJson(map) } : {}),
        ...(range ? { range: { min: range[0], max: range[1] } } : {}),
        ...(opacity ? { opacity: { atMin: opacity[0], atMax: opacity[1] } } : {}) });
    },
    caps: (value) => {
      const [map, ends] = value.split(':');
      const range = ends ? reader.numbers('caps', ends, 2) : null;
      if (map && !COLOR_MAPS.includes(map)) {
        reader.problems.push(`caps=${value.slice(0, 60)} of this link was left out: it is empty or one of ${COLOR_MAPS.join(', ')}.`);
        return;
      }
      state.caps = { ...(map ? { colorMap: colorMapToJson(map) } : {}), ...(map && range ? { range: { min: range[0], max: range[1] } } : {}) };
    },
    eye: (value) => { camera.eye = reader.vec('eye', value); },
    target: (value) => { camera.target = reader.vec('target', value); },
    up: (value) => { camera.up = reader.vec('up', value); },
    'fov-y': (value) => {
      const angle = reader.numbers('fov-y', value, 1);
      camera.perspective = angle && { fovYDegrees: angle[0] };
    },
    'orthographic-height': (value) => {
      const height = reader.numbers('orthographic-height', value, 1);
      camera.orthographic = height && { height: height[0] };
    },
    fit: (value) => { state.cameraFit = value === 'surface' ? 'CAMERA_FIT_SURFACE' : undefined; },
    'clip-plane': (value) => {
      const v = reader.numbers('clip-plane', value, 4);
      if (v) {
        ((state.clip ??= {}).halfSpaces ??= []).push({ normal: { x: v[0], y: v[1], z: v[2] }, offset: v[3] });
      }
    },
    'clip-box': (value) => {
      const v = reader.numbers('clip-box', value, 6);
      if (v) {
        (state.clip ??= {}).box = { min: { x: v[0], y: v[2], z: v[4] }, max: { x: v[1], y: v[3], z: v[5] } };
      }
    },
    light: (value) => {
      const [direction, strength, color] = value.split(':');
      const to = reader.vec('light', direction);
      const intensity = strength === undefined ? [1] : reader.numbers('light', strength, 1);
      const tint = color === undefined ? undefined : reader.color('light', color);
      if (to && intensity && tint !== null) {
        (state.lights ??= []).push({ direction: to, intensity: intensity[0], ...(tint ? { color: tint } : {}) });
      }
    },
    'light-space': () => {},
    samples: (value) => {
      const samples = reader.numbers('samples', value, 1);
      if (samples && [1, 4, 9, 16].includes(samples[0])) {
        state.samples = samples[0];
      }
    },
    'ambient-occlusion': (value) => {
      const v = value ? reader.numbers('ambient-occlusion', value, 1, 2) : [32];
      if (v) {
        state.ambientOcclusion = { radiusPx: Math.round(v[0]), ...(v.length > 1 ? { strength: v[1] } : {}) };
      }
    },
    silhouette: (value) => {
      const [width, color] = value.split(':');
      const widthPx = width ? reader.numbers('silhouette', width, 1) : [2];
      const tint = color === undefined ? undefined : reader.color('silhouette', color);
      if (widthPx && tint !== null) {
        state.silhouette = { widthPx: Math.round(widthPx[0]), ...(tint ? { color: tint } : {}) };
      }
    },
    'max-layers': (value) => {
      const layers = reader.numbers('max-layers', value, 1);
      state.maxLayers = layers ? Math.round(layers[0]) : undefined;
    },
    background: (value) => { state.backgroundColor = reader.color('background', value) ?? undefined; },
  };

  const search = new URLSearchParams(hash.replace(/^#/, ''));
  for (const [name, value] of search) {
    if (Object.hasOwn(words, name)) {
      if (value !== 'null' && (value !== '' || ALONE.includes(name))) {
        words[name](value);
      }
    } else {
      reader.problems.push(`${name.slice(0, 40)} of this link was left out: this page does not know it.`);
    }
  }
  if (camera.eye && camera.target) {
    state.camera = Object.fromEntries(Object.entries(camera).filter(([, value]) => value));
  }
  if (search.get('light-space') === 'world') {
    state.lights?.forEach((/** @type {any} */ light) => { light.space = 'SPACE_WORLD'; });
  }
  if (state.selection?.timeStep !== undefined && state.selection.time !== undefined) {
    reader.problems.push('time of this link was left out: it has a step, too.');
    delete state.selection.time;
  }
  (state.surfaces ?? []).forEach((/** @type {any} */ surface, /** @type {number} */ i) => {
    if (plain) {
      surface.color ??= { ...plain };
    }
    const coloring = colorings.length === 1 ? colorings[0] : colorings[i];
    if (coloring) {
      surface.colorBy = coloring;
    }
  });
  for (const key of Object.keys(state)) {
    if (state[key] === undefined) {
      delete state[key];
    }
  }
  return { state, problems: reader.problems };
}
