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
export const PALETTE = ['#dcc8b4', '#f2e9d8', '#c46a5a', '#6aa3d5', '#8cc08a', '#c9a0dc', '#e5b567', '#7fc4bd'];
export const BACKGROUNDS = { dark: '#0b0e14', light: '#ffffff' };

/** @param {number} share */
export const percent = (share) => `${Math.round(100 * share)} %`;

/** @param {number} value */
export const format12 = (value) => String(Number(value.toPrecision(12)));

/**
 * A range with few digits that holds all of [min, max]: at most a hundredth longer.
 * @param {number} min @param {number} max
 */
export function outwards(min, max) {
  const step = max > min ? 10 ** Math.floor(Math.log10((max - min) / 200)) : 0;
  if (!(step > 0) || !Number.isFinite(max - min)) {
    return { min, max };
  }
  /** @param {number} steps */
  const digits = (steps) => Number((steps * step).toPrecision(12));
  return { min: digits(Math.floor(min / step)), max: digits(Math.ceil(max / step)) };
}
