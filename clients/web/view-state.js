// The state of the view as words of the command line: `surface=60:0.9,0.8,0.7:1&eye=...`. It is the
// part of the page's address after '#', the query of GET .../render, and the flags of `isoscope
// render`. Numbers keep their bits. Written states have only numbers; states to read may also use
// CSS colour names.
// @ts-check

import { colorFromText } from './css-colors.js';
import { MAX_SURFACES, areSmooth, inOrder, indexOfLabel, isOfLabels, listedLabels, textOfValues, valuesOfText, withSmooth } from './label-sets.js';
import { textOfLimits, limitsOfText } from './levels.js';
import { COLOR_MAPS, EFFECTS, FIRST_LOOK } from './parameters.js';

/** @typedef {Record<string, any>} FrameRequest RenderIsosurfaceRequest as JSON. */

/** @type {Record<string, string>} */
const QUANTITIES = {
  x: 'QUANTITY_POSITION_X', y: 'QUANTITY_POSITION_Y', z: 'QUANTITY_POSITION_Z', normal: 'QUANTITY_NORMAL',
  gradient: 'QUANTITY_GRADIENT_MAGNITUDE',
};

/** @param {string} name */
export const colorMapToJson = (name) => `COLOR_MAP_${name.toUpperCase().replace('-', '_')}`;
/** @param {string | undefined} json */
export const colorMapFromJson = (json) => (json ?? 'COLOR_MAP_VIRIDIS').replace('COLOR_MAP_', '').toLowerCase().replace('_', '-');
/**
 * The colour of missing samples, unless a state has one: purple beside maps that have this grey.
 * @param {string | undefined} json of the map
 */
export const defaultNanColor = (json) => ['grey', 'cividis'].includes(colorMapFromJson(json)) ? '#800080' : '#808080';
/** @param {string | undefined} json */
export const quantityFromJson = (json) => Object.keys(QUANTITIES).find((name) => QUANTITIES[name] === json) ?? 'none';
/** @param {string} name */
export const quantityToJson = (name) => QUANTITIES[name];

/** The highest level that any dataset may have. */
const MAX_LEVEL = 23;

/** The window of the samples on cuts that clients ask for: percentiles of the samples inside. */
export const CAP_WINDOW = { percentiles: { low: 2, high: 98 } };

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

/**
 * ":0.5,0.25,1:0.4", or '' without a colour.
 * @param {any} color
 */
function paintToWords(color) {
  const alpha = color?.alpha ?? 0;
  return color ? `:${rgb(color)}${alpha === 1 ? '' : `:${alpha}`}` : '';
}

/**
 * The values of an effect, "32,0.5" or "2:1,0,0": those at the end that it does not have are left out.
 * @param {import('./parameters.js').Effect} effect @param {any} message
 */
const effectToWords = ({ values }, message) => values.reduceRight((words, { json, kind, initial }, i) => {
  const value = kind === 'color' ? message[json] && rgb(message[json]) : kind === 'whole' ? message[json] || null : message[json];
  return value == null && words === '' && i > 0 ? '' : `${i === 0 ? '' : kind === 'color' ? ':' : ','}${value ?? initial}${words}`;
}, '');

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

/** @type {Record<string, string>} */
const FIT_WORDS = { CAMERA_FIT_SURFACE: 'surface', CAMERA_FIT_CELLS: 'cells' };

// ---- the first look ----

/** @param {any} surface */
const isSoft = ({ material }) => JSON.stringify(material) === JSON.stringify(FIRST_LOOK.material);
/**
 * Gives a material to surfaces that have none.
 * @param {any[]} surfaces @param {any} material
 */
export const withMaterial = (surfaces, material) => surfaces.map((one) => one.material ? one : { ...one, material: { ...material } });
/**
 * Gives new surfaces the material of the others, if each of those has one. In a mix a surface without one is meant so.
 * @param {any[]} surfaces @param {any[]} others
 */
export const withMaterialOf = (surfaces, others) =>
  others.length > 0 && others.every(({ material }) => material) ? withMaterial(surfaces, others[0].material) : surfaces;
/**
 * Whether a state says nothing of the camera.
 * @param {FrameRequest} state
 */
export const asksFirstLook = (state) => !state.camera && !state.cameraFit;
/**
 * Fills in what every client asks for where people ask for no camera. Older coordinators choose their default camera.
 * @param {FrameRequest} state with surfaces @param {string} fitKind the fit that the view may ask for
 * @returns {FrameRequest}
 */
export function withFirstLook(state, fitKind) {
  return { ...state, samples: state.samples ?? FIRST_LOOK.samples, surfaces: withMaterial(state.surfaces, FIRST_LOOK.material),
    ...(fitKind === 'CAMERA_FIT_CELLS' ? { cameraFit: fitKind } : {}) };
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
  surface: ({ surfaces }) => (surfaces ?? []).filter((/** @type {any} */ one) => !isOfLabels(one))
    .map((/** @type {any} */ { isovalue, color }) => `${isovalue ?? 0}${paintToWords(color)}`),
  label: ({ surfaces }) => (surfaces ?? []).filter(isOfLabels)
    .map((/** @type {any} */ { labels, color }) => `${textOfValues(labels)}${paintToWords(color)}`),
  'smooth-labels': ({ surfaces }) => areSmooth(surfaces ?? []) ? [''] : [],
  'color-by': ({ surfaces }) => (surfaces ?? []).some((/** @type {any} */ surface) => surface.colorBy)
    ? inOrder(surfaces).map((/** @type {any} */ surface) => colorByToWords(surface.colorBy)) : [],
  eye: ({ camera }) => camera ? [vec(camera.eye)] : [],
  target: ({ camera }) => camera ? [vec(camera.target)] : [],
  up: ({ camera }) => camera ? [vec(camera.up)] : [],
  'fov-y': ({ camera }) => camera && !camera.orthographic ? [String(camera.perspective?.fovYDegrees ?? 30)] : [],
  'orthographic-height': ({ camera }) => camera?.orthographic ? [String(camera.orthographic.height ?? 0)] : [],
  fit: ({ cameraFit }) => FIT_WORDS[cameraFit] ? [FIT_WORDS[cameraFit]] : [],
  'clip-plane': ({ clip }) => (clip?.halfSpaces ?? []).map((/** @type {any} */ plane) => `${vec(plane.normal)},${plane.offset ?? 0}`),
  'clip-box': ({ clip }) => clip?.box
    ? [['x', 'y', 'z'].map((axis) => `${clip.box.min?.[axis] ?? 0},${clip.box.max?.[axis] ?? 0}`).join()] : [],
  caps: ({ caps }) => {
    const { colorMap, range } = caps ?? {};
    const hasEnds = range && !range.percentiles;
    return !caps ? [] : colorMap ? [`${colorMapFromJson(colorMap)}${hasEnds ? `:${range.min ?? 0},${range.max ?? 0}` : ''}`] : [''];
  },
  // The command has a window by itself, unless it names one. A link has none.
  'cap-window': ({ caps }) => {
    const { colorMap, range } = caps ?? {};
    return !colorMap || (range && !range.percentiles) ? []
      : [range ? `${range.percentiles.low ?? 0},${range.percentiles.high ?? 0}` : 'none'];
  },
  // Only where it means something: `isoscope render` refuses it elsewhere.
  'nan-color': ({ nanColor, caps, surfaces }) => nanColor && (caps?.colorMap ||
    (surfaces ?? []).some((/** @type {any} */ { colorBy }) => colorBy?.quantity === 'QUANTITY_FIELD')) ? [rgb(nanColor)] : [],
  light: ({ lights }) => (lights ?? []).map((/** @type {any} */ { direction, intensity, color }) =>
    `${vec(direction)}:${intensity ?? 1}${color ? `:${rgb(color)}` : ''}`),
  'light-space': ({ lights }) => lights?.[0]?.space === 'SPACE_WORLD' ? ['world'] : [],
  material: ({ surfaces }) => (surfaces ?? []).length > 0 && surfaces.every(isSoft) ? ['soft'] : [],
  samples: ({ samples }) => samples > 1 ? [String(samples)] : [],
  ...Object.fromEntries(EFFECTS.map((effect) => [effect.flag, (/** @type {FrameRequest} */ state) =>
    state[effect.json] ? [effectToWords(effect, state[effect.json])] : []])),
  'max-layers': ({ maxLayers }) => maxLayers ? [String(maxLayers)] : [],
  level: ({ level }) => level?.level == null ? [] : [String(level.level)],
  'max-spacing': ({ level }) => level?.maxSpacingPx ? [String(level.maxSpacingPx)] : [],
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

/** @param {[string, string][]} words */
const toHash = (words) => words.map(([name, value]) =>
  `${name}=${encodeURIComponent(value).replace(/%2C/g, ',').replace(/%3A/g, ':')}`).join('&');

/** @param {FrameRequest} state the part of an address after '#', and the query of the gateway's pictures and meshes */
export const stateToHash = (state) => toHash(stateToWords(state));

/**
 * A shorter one for links: labels with the colours of the dataset are one word, `labels=1-45`, which only pages
 * read, as they do `exact-limit=60,none`: where the exact picture may cost more or less than pages let it by themselves.
 * @param {FrameRequest} state @param {any} dataset @param {import('./levels.js').Limits} [limits]
 */
export function stateToLink(state, dataset, limits) {
  const limit = textOfLimits(limits);
  const link = surfacesToLink(state, dataset);
  return limit ? `${link}${link && '&'}exact-limit=${limit}` : link;
}

/** @param {FrameRequest} state @param {any} dataset */
function surfacesToLink(state, dataset) {
  const surfaces = state.surfaces ?? [];
  const { listed, rest } = listedLabels(surfaces.filter(isOfLabels), dataset);
  const words = stateToWords(state).filter(([name]) => name !== 'label');
  const first = words.findIndex(([name]) => !['dataset', 'field', 'step', 'time', 'surface'].includes(name));
  const labels = stateToWords({ surfaces: rest }).filter(([name]) => name === 'label');
  words.splice(first < 0 ? words.length : first, 0, ...listed.map((value) => /** @type {[string, string]} */ (['labels', value])), ...labels);
  return toHash(words);
}

/**
 * The token of a link with access: a word that no state has. '' without one.
 * @param {string} hash
 */
export const tokenOfHash = (hash) => new URLSearchParams(hash.replace(/^#/, '').replaceAll('+', '%2B')).get('token') ?? '';

/**
 * The token of what people paste: alone, or in an address.
 * @param {string} text
 */
export function tokenOfText(text) {
  const [, word] = /[?&#]token=([^&#\s]*)/.exec(text) ?? [];
  try {
    return word === undefined ? text.trim() : decodeURIComponent(word);
  } catch {
    return word;
  }
}

/**
 * The same link without it, in its very letters.
 * @param {string} hash
 */
export const withoutToken = (hash) => hash.replace(/^#/, '').split('&').filter((word) => !word.startsWith('token=')).join('&');

/**
 * What the gateway, or the command, draws over a picture: words of both.
 * @typedef {{axes?: boolean, scaleBar?: boolean, legend?: boolean, caption?: string}} Drawn
 */
/** @param {Drawn} drawn @returns {[string, string][]} */
export function drawnToWords({ axes, scaleBar, legend, caption }) {
  /** @type {[string, string | undefined | false][]} */
  const words = [['axes', axes && ''], ['scale-bar', scaleBar && ''], ['legend', legend && ''], ['caption', caption || undefined]];
  return /** @type {[string, string][]} */ (words.filter(([, value]) => value === '' || value));
}

/**
 * The address of a posted picture: with what is drawn over it, and a record of how it was made.
 * @param {string} dataset @param {Drawn} drawn @param {boolean} hasRecord
 */
export function pictureAddress(dataset, drawn, hasRecord) {
  const words = [...drawnToWords(drawn), ...(hasRecord ? [['record', '']] : [])];
  const query = words.map(([name, value]) => value === '' ? name : `${name}=${encodeURIComponent(value)}`).join('&');
  return `v1/datasets/${encodeURIComponent(dataset)}/render${query ? `?${query}` : ''}`;
}

/**
 * The address of a lossless WebP, which is not posted. The request has its size, a camera and no fit.
 * @param {FrameRequest} request @param {Drawn} drawn
 */
export function webpAddress({ dataset, viewport, ...state }, drawn) {
  const words = [...stateToWords(state), ['width', String(viewport.widthPx)], ['height', String(viewport.heightPx)], ['format', 'webp'], ...drawnToWords(drawn)];
  return `v1/datasets/${encodeURIComponent(dataset ?? '')}/render?${toHash(/** @type {[string, string][]} */ (words))}`;
}

/** The formats of meshes that the gateway has, and what each is for. @type {[string, string][]} */
export const MESH_FORMATS = [['glb', 'GLB: viewers, slides'], ['stl', 'STL: printing, no colours'], ['ply', 'PLY: MeshLab, Blender'],
  ['obj', 'OBJ: any program'], ['vtp', 'VTP: ParaView']];

/**
 * What of a state a mesh shows. Meshes are opaque, and STL has no colours. A level is named by its number.
 * @param {FrameRequest} state @param {string} format @returns {FrameRequest}
 */
export function stateOfMesh({ selection, surfaces = [], clip, level }, format) {
  const shown = surfaces.map((/** @type {any} */ { isovalue, labels, smoothLabels, color }) => ({ isovalue, labels, smoothLabels,
    color: color && format !== 'stl' ? { ...color, alpha: 1 } : undefined }));
  return { selection, surfaces: shown, clip, level: level?.level > 0 ? { level: level.level } : undefined };
}

/** @param {FrameRequest} state @param {string} format */
export const meshAddress = (state, format) =>
  `v1/datasets/${encodeURIComponent(state.dataset ?? '')}/mesh.${format}?${stateToHash(stateOfMesh(state, format))}`;

/** A link that is read: its state so far, and a sentence for each part that is wrong and left out. */
class Link {
  /** @type {FrameRequest} */
  state = {};
  /** @type {string[]} */
  problems = [];
  /** @type {any} */
  camera = {};
  /** @type {any[]} */
  colorings = [];
  /**
   * The percentiles of the samples that caps with a map show.
   * @type {any}
   */
  capWindow = null;
  /**
   * The appearance of surfaces without a colour of their own.
   * @type {any}
   */
  plain = null;
  /**
   * Labels of the word `labels`, which a word `label` gives another colour.
   * @type {Set<number>}
   */
  listed = new Set();
  /** Whether surfaces have the material of the first look. */
  isSoft = false;
  /**
   * What the exact picture may cost, if the link says so.
   * @type {import('./levels.js').Limits | null}
   */
  limits = null;
  /** How many surfaces are beyond those that a picture may have. */
  leftOutCount = 0;

  /**
   * Adds surfaces, as many as a picture may have: a link has no end of its own.
   * @param {any[]} surfaces
   */
  addSurfaces(surfaces) {
    const all = this.state.surfaces ??= [];
    const taken = surfaces.slice(0, MAX_SURFACES - all.length);
    all.push(...taken);
    this.leftOutCount += surfaces.length - taken.length;
  }

  /** @param {Record<string, any>} part of the field and time that are shown */
  select(part) {
    this.state.selection = { ...this.state.selection, ...part };
  }

  /** @param {string} name @param {string} text @param {{level: number} | {maxSpacingPx: number}} choice */
  chooseLevel(name, text, choice) {
    if (this.state.level) {
      this.refuse(name, text, 'the link has another word that chooses the level.');
    } else {
      this.state.level = choice;
    }
  }

  /** @param {string} name @param {string} text @param {string} why */
  refuse(name, text, why) {
    this.problems.push(`${name}=${text.slice(0, 60)} of this link was left out: ${why}`);
  }

  /** @param {string} name @param {string} text @param {number} least @param {number} [most] */
  numbers(name, text, least, most = least) {
    const parts = text.split(',');
    const values = parts.map((part) => part.trim() === '' ? NaN : Number(part));
    if (values.length < least || values.length > most || !values.every(Number.isFinite)) {
      const count = least === most ? `${least}` : `${least} to ${most}`;
      this.refuse(name, text, `it needs ${count} numbers with commas between them.`);
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
      this.refuse(name, text, 'a colour is a name of CSS, #RRGGBB, or three numbers from 0 to 1 with commas between them.');
      return null;
    }
    const v = this.numbers(name, text, 3, 4);
    return v && { red: v[0], green: v[1], blue: v[2], alpha: v[3] ?? alpha };
  }
}

/**
 * Reads the values of an effect: numbers with commas between them, then a colour after ':'.
 * @param {import('./parameters.js').Effect} effect @param {Link} link @param {string} value
 */
function readEffect({ flag, json, values }, link, value) {
  const tinted = values.find(({ kind }) => kind === 'color');
  const counted = values.filter((one) => one !== tinted);
  const [text, color] = tinted ? value.split(':') : [value];
  const numbers = text ? link.numbers(flag, text, 1, counted.length) : [Number(counted[0].initial)];
  const tint = color === undefined ? undefined : link.color(flag, color);
  if (numbers && tint !== null) {
    const given = numbers.map((number, i) => [counted[i].json, counted[i].kind === 'whole' ? Math.round(number) : number]);
    link.state[json] = { ...Object.fromEntries(given), ...(tinted && tint ? { [tinted.json]: tint } : {}) };
  }
}

/**
 * Reads a value of each word into a link.
 * @type {Record<string, (link: Link, value: string) => void>}
 */
const WORDS = {
  dataset: (link, value) => { link.state.dataset = value; },
  surface: (link, value) => {
    const [level, color, opacity] = value.split(':');
    const isovalue = link.numbers('surface', level, 1);
    const alpha = opacity === undefined ? [1] : link.numbers('surface', opacity, 1);
    const mixed = color === undefined ? undefined : link.color('surface', color, alpha?.[0]);
    if (isovalue && alpha && mixed !== null) {
      link.addSurfaces([mixed ? { isovalue: isovalue[0], color: mixed } : { isovalue: isovalue[0] }]);
    }
  },
  isovalue: (link, value) => {
    const isovalues = link.numbers('isovalue', value, 1, MAX_SURFACES);
    if (isovalues) {
      link.addSurfaces(isovalues.map((isovalue) => ({ isovalue })));
    }
  },
  label: (link, value) => {
    const [set, color, opacity] = value.split(':');
    const labels = valuesOfText(set, []);
    if (!labels) {
      link.refuse('label', value, 'it needs values of labels, or ranges as 3-7, with commas between them, at most 256.');
      return;
    }
    const alpha = opacity === undefined ? [1] : link.numbers('label', opacity, 1);
    const mixed = color ? link.color('label', color, alpha?.[0]) : undefined;
    if (alpha && mixed !== null) {
      // The page knows the colours of the dataset, the link does not.
      const surface = { labels, ...(mixed ? { color: mixed } : opacity === undefined ? {} : { color: { alpha: alpha[0] } }) };
      const { surfaces = [] } = link.state;
      if (labels.length !== 1 || !link.listed.has(labels[0])) {
        link.addSurfaces([surface]);
        return;
      }
      const listed = indexOfLabel(surfaces, labels[0]);
      if (listed >= 0) {  // else it is beyond those that a picture may have
        surfaces[listed] = surface;
      }
    }
  },
  labels: (link, value) => {
    const [set, opacity] = value.split(':');
    const labels = valuesOfText(set, []);
    const alpha = opacity === undefined ? [1] : link.numbers('labels', opacity, 1);
    if (!labels) {
      link.refuse('labels', value, 'it needs values of labels, or ranges as 3-7, with commas between them, at most 256.');
    } else if (alpha) {
      link.addSurfaces(labels.map((label) => ({ labels: [label], ...(opacity === undefined ? {} : { color: { alpha: alpha[0] } }) })));
      labels.forEach((label) => link.listed.add(label));
    }
  },
  'smooth-labels': () => {},
  color: (link, value) => { link.plain = link.color('color', value); },
  field: (link, value) => {
    const chosen = fieldFromWord(value);
    if (!chosen.field || chosen.component === '') {
      link.refuse('field', value, 'it is NAME or NAME:COMPONENT.');
      return;
    }
    link.select(chosen);
  },
  component: (link, value) => { link.select({ component: value }); },
  step: (link, value) => {
    const number = value === 'first' ? 0 : value === 'last' ? -1 : Number(value);
    if (!Number.isInteger(number) || value.trim() === '' || number < -1 || number >= 2 ** 31) {
      link.refuse('step', value, 'it is the number of a time step, from 0, or first or last.');
      return;
    }
    link.select({ timeStep: number });
  },
  time: (link, value) => {
    const time = link.numbers('time', value, 1);
    if (time) {
      link.select({ time: time[0] });
    }
  },
  'color-by': (link, value) => {
    const [first, ...rest] = value.split(':');
    const isField = first !== 'none' && !QUANTITIES[first];
    // The word after a field is its component, unless it is a map.
    const component = isField && rest.length > 0 && !COLOR_MAPS.includes(rest[0]) ? rest.shift() : undefined;
    const [map, ends, opacities] = rest;
    if (first === '' || component === '' || map && !COLOR_MAPS.includes(map)) {
      link.refuse('color-by', value, `it is x, y, z, normal, gradient, none or a field, then one of ${COLOR_MAPS.join(', ')}.`);
      return;
    }
    const range = ends ? link.numbers('color-by', ends, 2) : null;
    const opacity = opacities ? link.numbers('color-by', opacities, 2) : null;
    link.colorings.push(first === 'none' ? null : {
      ...(isField ? { quantity: 'QUANTITY_FIELD', field: first, ...(component ? { component } : {}) } : { quantity: QUANTITIES[first] }),
      ...(map ? { colorMap: colorMapToJson(map) } : {}),
      ...(range ? { range: { min: range[0], max: range[1] } } : {}),
      ...(opacity ? { opacity: { atMin: opacity[0], atMax: opacity[1] } } : {}) });
  },
  caps: (link, value) => {
    const [map, ends] = value.split(':');
    const range = ends ? link.numbers('caps', ends, 2) : null;
    if (map && !COLOR_MAPS.includes(map)) {
      link.refuse('caps', value, `it is empty or one of ${COLOR_MAPS.join(', ')}.`);
      return;
    }
    link.state.caps = { ...(map ? { colorMap: colorMapToJson(map) } : {}), ...(map && range ? { range: { min: range[0], max: range[1] } } : {}) };
  },
  'cap-window': (link, value) => {
    const ends = value === 'none' ? null : link.numbers('cap-window', value, 2);
    if (ends && !(ends[0] >= 0 && ends[0] < ends[1] && ends[1] <= 100)) {
      link.refuse('cap-window', value, 'it needs two percentages, from 0 to 100, the lower one first, or none.');
    } else if (ends) {
      link.capWindow = { low: ends[0], high: ends[1] };
    }
  },
  eye: (link, value) => { link.camera.eye = link.vec('eye', value); },
  target: (link, value) => { link.camera.target = link.vec('target', value); },
  up: (link, value) => { link.camera.up = link.vec('up', value); },
  'fov-y': (link, value) => {
    const angle = link.numbers('fov-y', value, 1);
    link.camera.perspective = angle && { fovYDegrees: angle[0] };
  },
  'orthographic-height': (link, value) => {
    const height = link.numbers('orthographic-height', value, 1);
    link.camera.orthographic = height && { height: height[0] };
  },
  fit: (link, value) => { link.state.cameraFit = Object.keys(FIT_WORDS).find((fit) => FIT_WORDS[fit] === value); },
  'clip-plane': (link, value) => {
    const v = link.numbers('clip-plane', value, 4);
    if (v) {
      ((link.state.clip ??= {}).halfSpaces ??= []).push({ normal: { x: v[0], y: v[1], z: v[2] }, offset: v[3] });
    }
  },
  'clip-box': (link, value) => {
    const v = link.numbers('clip-box', value, 6);
    if (v) {
      (link.state.clip ??= {}).box = { min: { x: v[0], y: v[2], z: v[4] }, max: { x: v[1], y: v[3], z: v[5] } };
    }
  },
  light: (link, value) => {
    const [direction, strength, color] = value.split(':');
    const to = link.vec('light', direction);
    const intensity = strength === undefined ? [1] : link.numbers('light', strength, 1);
    const tint = color === undefined ? undefined : link.color('light', color);
    if (to && intensity && tint !== null) {
      (link.state.lights ??= []).push({ direction: to, intensity: intensity[0], ...(tint ? { color: tint } : {}) });
    }
  },
  'light-space': () => {},
  material: (link, value) => {
    if (value === 'soft') {
      link.isSoft = true;
    } else if (value !== 'glossy') {
      link.refuse('material', value, 'it is glossy or soft.');
    }
  },
  samples: (link, value) => {
    const samples = link.numbers('samples', value, 1);
    if (samples && [1, 4, 9, 16].includes(samples[0])) {
      link.state.samples = samples[0];
    }
  },
  ...Object.fromEntries(EFFECTS.map((effect) => [effect.flag, (/** @type {Link} */ link, /** @type {string} */ value) =>
    readEffect(effect, link, value)])),
  'max-layers': (link, value) => {
    const layers = link.numbers('max-layers', value, 1);
    link.state.maxLayers = layers ? Math.round(layers[0]) : undefined;
  },
  level: (link, value) => {
    const level = value.trim() === '' ? NaN : Number(value);
    if (Number.isInteger(level) && level >= 0 && level <= MAX_LEVEL) {
      link.chooseLevel('level', value, { level });
    } else {
      link.refuse('level', value, `it is the number of a level, from 0, which is exact, to ${MAX_LEVEL}.`);
    }
  },
  'max-spacing': (link, value) => {
    const spacing = link.numbers('max-spacing', value, 1);
    if (spacing && spacing[0] > 0) {
      link.chooseLevel('max-spacing', value, { maxSpacingPx: spacing[0] });
    } else if (spacing) {
      link.refuse('max-spacing', value, 'it needs a number of pixels above 0.');
    }
  },
  'exact-limit': (link, value) => {
    link.limits = limitsOfText(value);
    if (!link.limits) {
      link.refuse('exact-limit', value, 'it needs seconds and gigabytes above 0, each a number or none, with a comma between them.');
    }
  },
  'nan-color': (link, value) => {
    const color = link.color('nan-color', value);
    link.state.nanColor = color ? { ...color, alpha: 1 } : undefined;
  },
  background: (link, value) => { link.state.backgroundColor = link.color('background', value) ?? undefined; },
};

/** Words that mean something without a value. */
const ALONE = ['caps', 'smooth-labels', ...EFFECTS.map(({ flag }) => flag)];

/**
 * Returns the state of the part of an address after '#', and a sentence for each part that is wrong
 * and left out. A word with the value null, or without a required value, counts as absent.
 * @param {string} hash @returns {{state: FrameRequest, problems: string[], limits?: import('./levels.js').Limits}} with limits only where the link has some
 */
export function stateFromHash(hash) {
  const link = new Link();
  const { state, problems, camera, colorings } = link;
  const search = new URLSearchParams(hash.replace(/^#/, ''));
  for (const [name, value] of search) {
    if (Object.hasOwn(WORDS, name)) {
      if (value !== 'null' && (value !== '' || ALONE.includes(name))) {
        WORDS[name](link, value);
      }
    } else {
      problems.push(`${name.slice(0, 40)} of this link was left out: this page does not know it.`);
    }
  }
  if (link.leftOutCount > 0) {
    const which = link.leftOutCount === 1 ? 'The last surface' : `The last ${link.leftOutCount.toLocaleString('en')} surfaces`;
    problems.unshift(`${which} of this link ${link.leftOutCount === 1 ? 'was' : 'were'} left out: a picture has at most ${MAX_SURFACES}.`);
  }
  if (camera.eye && camera.target) {
    state.camera = Object.fromEntries(Object.entries(camera).filter(([, value]) => value));
  }
  if (link.capWindow && state.caps?.colorMap && !state.caps.range) {
    state.caps.range = { percentiles: link.capWindow };
  }
  if (search.get('light-space') === 'world') {
    state.lights?.forEach((/** @type {any} */ light) => { light.space = 'SPACE_WORLD'; });
  }
  if (state.selection?.timeStep !== undefined && state.selection.time !== undefined) {
    problems.push('time of this link was left out: it has a step, too.');
    delete state.selection.time;
  }
  if (state.surfaces) {
    state.surfaces = inOrder(state.surfaces);
    if ((search.get('smooth-labels') ?? 'null') !== 'null') {
      state.surfaces = withSmooth(state.surfaces, true);
    }
  }
  (state.surfaces ?? []).forEach((/** @type {any} */ surface, /** @type {number} */ i) => {
    if (link.plain && !isOfLabels(surface)) {
      surface.color ??= { ...link.plain };
    }
    const coloring = colorings.length === 1 ? colorings[0] : colorings[i];
    if (coloring) {
      surface.colorBy = coloring;
    }
  });
  if (state.surfaces && link.isSoft) {
    state.surfaces = withMaterial(state.surfaces, FIRST_LOOK.material);
  }
  for (const key of Object.keys(state)) {
    if (state[key] === undefined) {
      delete state[key];
    }
  }
  return { state, problems, ...(link.limits ? { limits: link.limits } : {}) };
}
