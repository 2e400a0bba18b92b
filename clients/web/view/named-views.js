// Where a dataset lies, and the cameras that show it from a side.
// @ts-check

import { add, length, scale, sub, vecFromJson } from './vectors.js';

/** @typedef {import('./types.js').Vec3} Vec3 */
/** @typedef {import('./types.js').Camera} Camera */
/** @typedef {import('./types.js').Box} Box */
/** @typedef {import('./types.js').DatasetJson} DatasetJson */

/** @param {Vec3} center @param {number} radius @param {Vec3} side @param {Vec3} up @returns {Camera} */
function cameraAround(center, radius, side, up) {
  const fovYDegrees = 30;
  const distance = (radius > 0 ? radius : 0.5) / Math.sin(fovYDegrees * Math.PI / 360);
  return { eye: add(center, scale(side, distance)), target: center, up, fovYDegrees, height: 0 };
}

/**
 * Returns the server's default camera of a box: from +z, +y up.
 * @param {Box} box @returns {Camera}
 */
export function defaultCamera(box) {
  return /** @type {Camera} */ (namedCamera('front', box));
}

/**
 * Returns the unit vector that points to a side of the patient: one of L R P A S I.
 * @param {string} frame such as "LPS" @param {string} side @returns {Vec3}
 */
export function patientDirection(frame, side) {
  const opposite = /** @type {Record<string, string>} */ (
    { L: 'R', R: 'L', P: 'A', A: 'P', S: 'I', I: 'S' })[side];
  /** @type {Vec3} */
  const v = [0, 0, 0];
  for (let axis = 0; axis < 3; ++axis) {
    v[axis] = frame[axis] === side ? 1 : frame[axis] === opposite ? -1 : 0;
  }
  return v;
}

/**
 * The rows of core/view/named_views.inc: direction of the eye from the target; up; the patient's
 * sides in the same order.
 * @type {Record<string, [Vec3, Vec3, string]>}
 */
export const NAMED_VIEWS = {
  front: [[0, 0, 1], [0, 1, 0], ''], back: [[0, 0, -1], [0, 1, 0], ''],
  anterior: [[0, 0, 0], [0, 0, 0], 'AS'], posterior: [[0, 0, 0], [0, 0, 0], 'PS'],
  left: [[-1, 0, 0], [0, 1, 0], 'LS'], right: [[1, 0, 0], [0, 1, 0], 'RS'],
  top: [[0, 1, 0], [0, 0, -1], ''], bottom: [[0, -1, 0], [0, 0, 1], ''],
  superior: [[0, 0, 0], [0, 0, 0], 'SA'], inferior: [[0, 0, 0], [0, 0, 0], 'IA'],
};
/** The named views, as the command line has them, and those of a patient. */
export const WORLD_VIEWS = Object.keys(NAMED_VIEWS).filter((name) => length(NAMED_VIEWS[name][0]) > 0);
export const PATIENT_VIEWS = Object.keys(NAMED_VIEWS).filter((name) => NAMED_VIEWS[name][2]);

/**
 * Returns the default camera of a box from another side, as `isoscope render --view` does; null if
 * there is no view of that name, or if it needs a patient frame and there is none.
 * @param {string} name @param {Box} box @param {string} [patientFrame] @returns {Camera | null}
 */
export function namedCamera(name, box, patientFrame) {
  if (!Object.hasOwn(NAMED_VIEWS, name)) {
    return null;
  }
  let [toEye, up, sides] = NAMED_VIEWS[name];
  if (patientFrame && sides) {
    [toEye, up] = [patientDirection(patientFrame, sides[0]), patientDirection(patientFrame, sides[1])];
  }
  return length(up) > 0
    ? cameraAround(scale(add(box.min, box.max), 0.5), length(sub(box.max, box.min)) / 2, toEye, up) : null;
}

/**
 * The names of the axes of the world, wherever one is named: the sides of the patient that they point to, else x y z.
 * @param {DatasetJson | null | undefined} dataset @returns {string[]}
 */
export function axisNamesOf(dataset) {
  return [...(/^[LRPASI]{3}$/.test(dataset?.patientFrame ?? '') ? dataset?.patientFrame : 'xyz')];
}

/**
 * Returns the box around the samples of a dataset in world space; null if it has no geometry.
 * @param {DatasetJson | null | undefined} dataset @returns {Box | null}
 */
export function boxOfDataset(dataset) {
  const geometry = dataset?.geometry;
  if (!geometry?.sampleDims || !geometry.spacing) {
    return null;
  }
  const dims = vecFromJson(geometry.sampleDims);
  const spacing = vecFromJson(geometry.spacing);
  const origin = vecFromJson(geometry.origin);
  /** @type {Vec3[]} */
  const columns = (geometry.directionColumns ?? []).length === 3
    ? geometry.directionColumns.map(vecFromJson) : [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  /** @type {Box} */
  const box = { min: [Infinity, Infinity, Infinity], max: [-Infinity, -Infinity, -Infinity] };
  for (let corner = 0; corner < 8; ++corner) {
    let p = origin;
    for (let axis = 0; axis < 3; ++axis) {
      const at = (corner >> axis & 1) * (dims[axis] - 1) * spacing[axis];
      p = add(p, scale(columns[axis], at));
    }
    for (let axis = 0; axis < 3; ++axis) {
      box.min[axis] = Math.min(box.min[axis], p[axis]);
      box.max[axis] = Math.max(box.max[axis], p[axis]);
    }
  }
  return [...box.min, ...box.max].every(Number.isFinite) ? box : null;
}

/**
 * The unit of world space, for people; '' if it is unknown. Files that know the patient are in millimetres.
 * @param {DatasetJson | null} dataset @returns {string}
 */
export function lengthUnitOf(dataset) {
  return dataset?.lengthUnit ? String(dataset.lengthUnit).slice(0, 12) : dataset?.patientFrame ? 'mm' : '';
}
