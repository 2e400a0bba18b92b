// The figures of picked points: rows of the panel, and a table as CSV. Pure: no element, no view.
// @ts-check

import { axisNamesOf, lengthUnitOf } from './isoscope-view.js';
import { choiceOf, valuesOf } from './series.js';
import { format } from './values.js';

/** @typedef {import('./isoscope-view.js').Vec3} Vec3 */
/**
 * @typedef {{position: Vec3, isovalue: number, point: any, selection: any, of: string}} Pick `selection`: of the frame;
 *   `of`: the surface and step that it lies on
 */
/** @typedef {{name: string, text: string, className: string}} Figure */

const AXES = ['x', 'y', 'z'];

/** @param {any} dataset @param {any} selection */
const valueUnitOf = (dataset, selection) => choiceOf(dataset, selection)?.field.unit ?? '';

/** @param {any} dataset @param {any} selection */
function gradientUnitOf(dataset, selection) {
  const [value, length] = [valueUnitOf(dataset, selection), lengthUnitOf(dataset)];
  return length ? `${value || '1'}/${length}` : value;
}

/** @param {any} point @returns {number | null} */
const steepnessOf = ({ gradient }) => gradient ? Math.hypot(...AXES.map((axis) => gradient[axis] ?? 0)) : null;

/**
 * "left lung (3)".
 * @param {any} point
 */
export const textOfLabel = ({ label, labelName }) => labelName ? `${labelName} (${label})` : String(label);

/** @param {string} text @param {string} unit */
const withUnit = (text, unit) => `${text} ${unit}`.trimEnd();

/**
 * @param {Pick} pick @param {any} dataset @param {(position: Vec3) => string[]} textsOf of coordinates
 * @returns {Figure[]}
 */
export function figuresOf({ position, isovalue, point, selection }, dataset, textsOf) {
  const { normal, label } = point;
  const steepness = steepnessOf(point);
  /** @type {Figure[]} */
  const figures = [{ name: axisNamesOf(dataset).join(', '), text: withUnit(textsOf(position).join(', '), lengthUnitOf(dataset)), className: 'position' }];
  figures.push(label === undefined
    ? { name: 'value', text: withUnit(format(isovalue), valueUnitOf(dataset, selection)), className: 'value' }
    : { name: 'label', text: textOfLabel(point), className: 'label' });
  figures.push(...valuesOf(point, dataset, format).map((one) => ({ ...one, className: 'field' })));
  if (normal) {
    figures.push({ name: 'normal', text: AXES.map((axis) => (normal[axis] ?? 0).toFixed(3)).join(', '), className: 'normal' });
  }
  if (steepness !== null) {
    figures.push({ name: 'gradient', text: withUnit(format(steepness, 4), gradientUnitOf(dataset, selection)), className: 'gradient' });
  }
  return figures;
}

/**
 * A cell of a table. A name of a file that begins as a formula does would be one in a spreadsheet.
 * @param {string | number} value
 */
function cellOf(value) {
  const text = typeof value === 'string' && /^[=+\-@\t\r]/.test(value) ? `'${value}` : String(value);
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/** @param {string} name @param {string} unit */
const titleOf = (name, unit) => unit ? `${name} (${unit})` : name;

/**
 * The cells of a point, by the titles of their columns. Numbers have all their digits.
 * @param {Pick} pick @param {string} name @param {any} dataset @returns {[string, string | number][]}
 */
function cellsOf({ position, isovalue, point, selection }, name, dataset) {
  const axes = axisNamesOf(dataset);
  const steepness = steepnessOf(point);
  return [['point', name], ...position.map((value, axis) => /** @type {[string, number]} */ ([titleOf(axes[axis], lengthUnitOf(dataset)), value])),
    ...(point.label === undefined ? /** @type {[string, number][]} */ ([[titleOf('value', valueUnitOf(dataset, selection)), isovalue]])
      : /** @type {[string, string | number][]} */ ([['label', point.label], ['label name', point.labelName ?? '']])),
    ...(point.fieldValues ?? []).map((/** @type {any} */ { field, component = '', unit = '', value = 0 }) =>
      [titleOf(`${field} ${component}`.trim(), unit), value]),
    ...(point.normal ? AXES.map((axis, i) => /** @type {[string, number]} */ ([`normal ${axes[i]}`, point.normal[axis] ?? 0])) : []),
    ...(steepness !== null ? /** @type {[string, number][]} */ ([[titleOf('gradient', gradientUnitOf(dataset, selection)), steepness]]) : [])];
}

/**
 * A table of the points, with a line of titles.
 * @param {Pick[]} picks @param {any} dataset @returns {string}
 */
export function csvOf(picks, dataset) {
  const rows = picks.map((pick, i) => new Map(cellsOf(pick, 'AB'[i], dataset)));
  const titles = [...new Set(rows.flatMap((row) => [...row.keys()]))];
  return [titles, ...rows.map((row) => titles.map((title) => row.get(title) ?? ''))]
    .map((cells) => `${cells.map(cellOf).join(',')}\r\n`).join('');
}
