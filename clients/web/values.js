// Numbers, sizes and colours as the page writes them. Pure: no element, no view.
// @ts-check

/** @param {number} value @param {number} [digits] */
export const format = (value, digits = 5) => Number(value.toPrecision(digits)).toLocaleString('en', { maximumSignificantDigits: digits });
// Significant digits that tell places of a volume of this size apart, to a ten-thousandth of it: far from the origin
// more than near it.
/** @param {number} value @param {number} size */
export const digitsAt = (value, size) => Math.max(5, Math.min(15, Math.ceil(Math.log10(Math.max(1, Math.abs(value) / size))) + 5));
// A coordinate; `size` is that of the volume, above 0.
/** @param {number} value @param {number} size */
export const formatAt = (value, size) => format(value, digitsAt(value, size));
/** @param {number} bytes */
export function formatBytes(bytes) {
  const power = Math.min(4, Math.floor(Math.log2(Math.max(bytes, 1)) / 10));
  return `${format(bytes / 1024 ** power, 3)} ${['B', 'KiB', 'MiB', 'GiB', 'TiB'][power]}`;
}
/** @param {string} text of a protobuf Duration; milliseconds */
export const milliseconds = (text) => 1000 * (parseFloat(text) || 0);
/** @param {any} color */
export const toHex = (color) => `#${['red', 'green', 'blue'].map((name) => Math.round(255 * (color?.[name] ?? 0)).toString(16).padStart(2, '0')).join('')}`;
/** @param {string} hex @param {number} [alpha] */
export const fromHex = (hex, alpha = 1) => {
  /** @param {number} at */
  const channel = (at) => Math.round(parseInt(hex.slice(at, at + 2), 16) / 255 * 1e4) / 1e4;
  return { red: channel(1), green: channel(3), blue: channel(5), alpha };
};
/** Of surfaces of isovalues, in this order: bone, then colours that colour-blind people tell apart (Okabe and Ito 2008). */
export const PALETTE = ['#dcc8b4', '#56b4e9', '#d55e00', '#009e73', '#cc79a7', '#f0e442', '#0072b2', '#e69f00'];

/**
 * The first colour of the row that none of these has; once all are used, it begins anew.
 * @param {string[]} used
 */
export const nextColor = (used) => PALETTE.find((one) => !used.includes(one)) ?? PALETTE[used.length % PALETTE.length];

/**
 * Gives each surface of an isovalue that has no colour one of its own, so that they are told apart; the first one needs none.
 * @param {any[]} surfaces @returns {any[]}
 */
export function paintedApart(surfaces) {
  const used = surfaces.filter(({ color }) => color).map(({ color }) => toHex(color));
  return surfaces.map((surface) => {
    if (surface.color || (surface.labels ?? []).length > 0) {
      return surface;
    }
    const color = nextColor(used);
    used.push(color);
    // The first of the row is about the server's own.
    return color === PALETTE[0] ? surface : { ...surface, color: fromHex(color) };
  });
}

/**
 * Rounds a value to so many digits of a range: to 0.1 in a range of 255, to 1 in one of 4095.
 * @param {number} value @param {number} span of the range; without one, digits of the value count
 * @param {number} [digits]
 */
export function tidy(value, span, digits = 4) {
  const decimals = digits - 1 - Math.floor(Math.log10(span));
  if (!Number.isFinite(decimals) || decimals > 100) {
    return Number(value.toPrecision(digits));
  }
  const step = 10 ** -decimals;
  return decimals >= 0 ? Number(value.toFixed(decimals)) : Math.round(value / step) * step;
}

/**
 * The least range with few digits around another one.
 * @param {{min: number, max: number}} range
 */
export function tidyRange({ min, max }) {
  const span = max - min;
  const step = 10 ** (Math.floor(Math.log10(span)) - 3);
  const [low, high] = [tidy(min, span), tidy(max, span)];
  return span > 0 ? { min: low > min ? tidy(low - step, span) : low, max: high < max ? tidy(high + step, span) : high } : { min, max };
}
/**
 * The least range around others; null without any.
 * @param {{min: number, max: number}[]} ranges
 */
export const unitedRange = (ranges) => ranges.length === 0 ? null
  : { min: Math.min(...ranges.map(({ min }) => min)), max: Math.max(...ranges.map(({ max }) => max)) };
/**
 * Whether two ranges have the same ends, but for errors of rounding.
 * @param {{min: number, max: number} | null | undefined} a @param {{min: number, max: number} | null | undefined} b
 */
export const isSameRange = (a, b) => a != null && b != null && [a.min - b.min, a.max - b.max].every((off) => Math.abs(off) <= 1e-9 * (b.max - b.min));

/**
 * The ends of the chart of a histogram, and of the values on it: bins of integers have edges beyond the last one.
 * @param {any[]} bins as JSON; without them the chart ends with the values
 * @param {{min?: number | string, max?: number | string} | undefined} finite range of the samples, as JSON has it
 */
export function rangesOfChart(bins, finite) {
  const edges = bins.length > 0 ? { min: Number(bins[0].min ?? 0), max: Number(bins[bins.length - 1].max ?? 0) } : null;
  const told = { min: Number(finite?.min ?? 0), max: Number(finite?.max ?? (finite ? 0 : 1)) };
  // Older coordinators tell infinite samples as the range.
  const values = Number.isFinite(told.max - told.min) && finite ? told : edges ?? { min: 0, max: 1 };
  const { min, max } = edges ?? values;
  return { values, edges: max > min ? { min, max } : { min: min - 0.5, max: min + 0.5 } };
}

export const BACKGROUNDS = { dark: '#0b0e14', light: '#ffffff' };

/**
 * Why an isovalue has no surface, where that is seen by the range of the samples; '' if it may have one.
 * @param {number} isovalue @param {{min?: number | string, max?: number | string} | undefined} range of all samples, as JSON has it
 * @param {string} [unit]
 */
export function whyBeyond(isovalue, range, unit = '') {
  const [min, max] = [Number(range?.min ?? 0), Number(range?.max ?? 0)];
  if (!range || isovalue > min && isovalue <= max) {
    return '';
  }
  return `Isovalue ${format(isovalue)} has no surface: the samples are from ${format(min)} to ${`${format(max)} ${unit}`.trimEnd()}.`;
}

/** @param {number} share */
export const percent = (share) => `${Math.round(100 * share)} %`;

/** @param {number} value */
export const format12 = (value) => String(Number(value.toPrecision(12)));
