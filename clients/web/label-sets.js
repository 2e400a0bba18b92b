// Surfaces of labels in a view's state: sets of values as text, their colours and names, and which are shown.
// Pure: no element, no view.
//
// A state has its surfaces of isovalues first, as the command line has them. A picture without any
// surface can't be asked for: a surface of a label that no sample has stands for it (`nothingOf`).
// @ts-check

/** @typedef {{value?: number, name?: string, color?: any}} Label Of a dataset, as JSON. */

export const MAX_SURFACES = 128;
const MAX_VALUES = 256;

/** Of labels without a colour in the dataset, by the value; those of docs/labels.md. */
export const LABEL_COLORS = ['#fe8677', '#2a89e2', '#d0dc51', '#ec83d4', '#0a999d', '#fec493', '#a4a2fe', '#339f46',
  '#febdc7', '#18bdfa', '#9f840d', '#ebbdfd', '#0cc9af', '#d35e2e', '#bad1ff', '#94bf41'];

/** @param {any} surface */
export const isOfLabels = (surface) => (surface?.labels ?? []).length > 0;
/** @param {any} dataset @returns {Label[]} */
export const labelsOf = (dataset) => dataset?.labels ?? [];

/**
 * Those of isovalues, then those of labels.
 * @param {any[]} surfaces
 */
export const inOrder = (surfaces) => [...surfaces.filter((one) => !isOfLabels(one)), ...surfaces.filter(isOfLabels)];

/** @param {any} dataset @param {number} value */
const labelOf = (dataset, value) => labelsOf(dataset).find((label) => (label.value ?? 0) === value);

/**
 * The colour of a label, with the bits that the command line gives it.
 * @param {any} dataset @param {number} value @param {number} [alpha]
 */
export function colorOfLabel(dataset, value, alpha = 1) {
  const { color } = labelOf(dataset, value) ?? {};
  if (color) {
    return { red: color.red ?? 0, green: color.green ?? 0, blue: color.blue ?? 0, alpha };
  }
  const hex = LABEL_COLORS[((Math.floor(value) % 16) + 16) % 16];
  /** @param {number} at */
  const channel = (at) => Number((parseInt(hex.slice(at, at + 2), 16) / 255).toPrecision(9));
  return { red: channel(1), green: channel(3), blue: channel(5), alpha };
}

/**
 * "left lung", or "label 3"; of a set with commas between.
 * @param {any} dataset @param {number[]} values
 */
export const nameOfLabels = (dataset, values) =>
  values.map((value, i) => labelOf(dataset, value)?.name || (i === 0 ? `label ${value}` : String(value))).join(', ');

/**
 * "3,7-9", as --label takes it.
 * @param {number[]} values ascending
 */
export function textOfValues(values) {
  /** @type {string[]} */
  const parts = [];
  for (let i = 0; i < values.length;) {
    let end = i;
    while (Number.isInteger(values[i]) && values[i] >= 0 && values[end + 1] === values[end] + 1) {
      end += 1;
    }
    // A range of two is as long as both.
    parts.push(...(end > i + 1 ? [`${values[i]}-${values[end]}`] : values.slice(i, end + 1).map(String)));
    i = end + 1;
  }
  return parts.join();
}

/** @param {Label[]} labels @param {string} name */
function valueOfName(labels, name) {
  const same = labels.filter((label) => label.name === name);
  const like = labels.filter((label) => label.name && label.name.toLowerCase() === name.toLowerCase());
  const found = same.length > 0 ? same : like;
  return name && found.length === 1 ? found[0].value ?? 0 : null;
}

/**
 * Reads "3,7-9,left lung"; null if a part is neither a number, a range nor a name, or if there are too many.
 * @param {string} text @param {Label[]} labels @returns {number[] | null} ascending, each once
 */
export function valuesOfText(text, labels) {
  const whole = valueOfName(labels, text.trim());
  if (whole !== null) {
    return [whole];
  }
  /** @type {Set<number>} */
  const values = new Set();
  for (const part of text.split(',').map((one) => one.trim())) {
    const named = valueOfName(labels, part);
    const number = part === '' ? NaN : Number(part);
    const [, first, last] = /^(\d+)-(\d+)$/.exec(part) ?? [];
    if (named !== null) {
      values.add(named);
    } else if (Number.isFinite(number)) {
      values.add(number + 0);  // -0 is 0
    } else if (first !== undefined && Number(first) <= Number(last) && Number(last) - Number(first) < MAX_VALUES) {
      for (let value = Number(first); value <= Number(last); ++value) {
        values.add(value);
      }
    } else {
      return null;
    }
  }
  return values.size > MAX_VALUES ? null : [...values].sort((a, b) => a - b);
}

// ---- which are shown ----

/**
 * A surface that is nowhere, for pictures of nothing.
 * @param {{min?: any}} [range] of the samples
 */
export const nothingOf = (range) => ({ labels: [Math.floor(Number(range?.min ?? 0)) - 1], color: { red: 0, green: 0, blue: 0, alpha: 1 } });
/** @param {any} surface @param {{min?: any}} [range] */
export const isNothing = (surface, range) => isOfLabels(surface) && surface.labels.length === 1 && surface.labels[0] === nothingOf(range).labels[0];

/**
 * The place of the surface of this label alone; -1 if there is none.
 * @param {any[]} surfaces @param {number} value
 */
export const indexOfLabel = (surfaces, value) => surfaces.findIndex((one) => isOfLabels(one) && one.labels.length === 1 && one.labels[0] === value);

/**
 * A list of surfaces that may be sent: in order, with something in it.
 * @param {any[]} surfaces @param {{min?: any}} [range]
 */
export function asShown(surfaces, range) {
  const some = inOrder(surfaces.filter((one) => !isNothing(one, range)));
  return some.length > 0 ? some : [nothingOf(range)];
}

/**
 * Adds the surface of a set, behind the others.
 * @param {any[]} surfaces @param {number[]} values @param {any} dataset @param {{min?: any}} [range]
 */
export const withLabels = (surfaces, values, dataset, range) =>
  asShown([...surfaces, { labels: values, color: colorOfLabel(dataset, values[0]) }], range);

/**
 * The surfaces of all labels but 0, alone.
 * @param {any} dataset @param {Label[]} [labels] default: those that the dataset names
 */
export const allLabels = (dataset, labels = labelsOf(dataset)) => labels.map((label) => label.value ?? 0).filter((value) => value !== 0)
  .map((value) => ({ labels: [value], color: colorOfLabel(dataset, value) }));

/**
 * The place of the surface that a label is in, alone or in a set; -1 if there is none.
 * @param {any[]} surfaces @param {number} value
 */
export const indexWithLabel = (surfaces, value) => {
  const alone = indexOfLabel(surfaces, value);
  return alone >= 0 ? alone : surfaces.findIndex((one) => isOfLabels(one) && one.labels.includes(value));
};

/**
 * Of the surfaces of labels only the one at a place.
 * @param {any[]} surfaces @param {number} index
 */
export const onlyLabel = (surfaces, index) => [...surfaces.filter((one) => !isOfLabels(one)), surfaces[index]];

/** The opacity of the labels around a highlighted one. */
const DIM = 0.15;
/**
 * Lets all surfaces that have a colour show through, but the one at a place.
 * @param {any[]} surfaces @param {number} index @param {any} dataset
 */
export const withHighlight = (surfaces, index, dataset) => surfaces.map((one, i) => {
  const color = one.color ?? (isOfLabels(one) ? colorOfLabel(dataset, one.labels[0]) : null);
  return color ? { ...one, color: { ...color, alpha: i === index ? 1 : Math.min(color.alpha ?? 0, DIM) } } : one;
});

/**
 * Whether all surfaces of labels are smooth; false if there are none.
 * @param {any[]} surfaces
 */
export const areSmooth = (surfaces) => surfaces.some(isOfLabels) && surfaces.filter(isOfLabels).every((one) => one.smoothLabels);
/**
 * Makes all surfaces of labels smooth, or none.
 * @param {any[]} surfaces @param {boolean} isSmooth
 */
export const withSmooth = (surfaces, isSmooth) => surfaces.map((one) => {
  const { smoothLabels, ...rest } = one;
  return isSmooth && isOfLabels(one) ? { ...rest, smoothLabels: true } : rest;
});

/**
 * The labels whose name or value has a text in it.
 * @param {Label[]} labels @param {string} text
 */
export function foundLabels(labels, text) {
  const wanted = text.trim().toLowerCase();
  return wanted === '' ? labels
    : labels.filter(({ value = 0, name }) => String(value) === wanted || (name || `label ${value}`).toLowerCase().includes(wanted));
}

// ---- short links ----

/**
 * Whether a surface has the colour that the dataset gives its first label, of any opacity.
 * @param {any} surface @param {any} dataset
 */
function hasOwnColor({ labels, color }, dataset) {
  const own = colorOfLabel(dataset, labels[0]);
  return !color || ((color.red ?? 0) === own.red && (color.green ?? 0) === own.green && (color.blue ?? 0) === own.blue);
}

/**
 * A word can't tell an opacity without a colour.
 * @param {any} surface @param {any} dataset
 */
function withoutOwnColor(surface, dataset) {
  const { color, ...rest } = surface;
  return color?.alpha === 1 && hasOwnColor(surface, dataset) ? rest : surface;
}

/**
 * Splits the surfaces of labels for a link: `listed` are words "1-45,47:0.5", each a run of single labels of one
 * opacity; `rest` have words of their own, those with the colours of the dataset without them. Those of `rest` that `listed`
 * has, too, have another colour.
 * @param {any[]} surfaces of labels @param {any} dataset @returns {{listed: string[], rest: any[]}}
 */
export function listedLabels(surfaces, dataset) {
  const end = surfaces.findIndex((one) => one.labels.length !== 1);
  const singles = end < 0 ? surfaces : surfaces.slice(0, end);
  if (!singles.some((one) => hasOwnColor(one, dataset))) {
    return { listed: [], rest: surfaces.map((one) => withoutOwnColor(one, dataset)) };  // one word for each, not two
  }
  /** @type {{values: number[], alpha: number}[]} */
  const runs = [];
  const others = [];
  for (const one of singles) {
    const [value] = one.labels;
    const hasOwn = hasOwnColor(one, dataset);
    // Another colour makes no new run: its word gives the opacity, too.
    const last = runs.at(-1);
    const alpha = one.color ? one.color.alpha ?? 0 : 1;
    if (last && (last.values.at(-1) ?? 0) < value && last.values.length < MAX_VALUES && (last.alpha === alpha || !hasOwn)) {
      last.values.push(value);
    } else {
      runs.push({ values: [value], alpha });
    }
    if (!hasOwn) {
      others.push(one);
    }
  }
  return { listed: runs.map(({ values, alpha }) => `${textOfValues(values)}${alpha === 1 ? '' : `:${alpha}`}`),
    rest: [...others, ...surfaces.slice(singles.length).map((one) => withoutOwnColor(one, dataset))] };
}

/**
 * Whether a colour is missing that only the dataset knows.
 * @param {any} surface
 */
export const needsColor = (surface) => isOfLabels(surface) && surface.color?.red === undefined;
/**
 * Gives surfaces of labels their colours, and keeps their opacity.
 * @param {any[]} surfaces @param {any} dataset
 */
export const withColors = (surfaces, dataset) => surfaces.map((one) =>
  needsColor(one) ? { ...one, color: colorOfLabel(dataset, one.labels[0], one.color?.alpha ?? 1) } : one);
