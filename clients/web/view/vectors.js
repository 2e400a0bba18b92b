// Vectors of three numbers.
// @ts-check

/** @typedef {import('./types.js').Vec3} Vec3 */
/** @typedef {import('./types.js').Vec3Json} Vec3Json */

/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
export const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
/** @param {Vec3} a @param {number} s @returns {Vec3} */
export const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
/** @param {Vec3} a @param {Vec3} b */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @param {Vec3} a */
export const length = (a) => Math.hypot(a[0], a[1], a[2]);
/** @param {Vec3} a @returns {Vec3} */
export const normalize = (a) => scale(a, 1 / length(a));
/**
 * Rotates `v` about the unit vector `axis`, right-handed.
 * @param {Vec3} v @param {Vec3} axis @param {number} radians @returns {Vec3}
 */
export function rotate(v, axis, radians) {
  const c = Math.cos(radians);
  return add(add(scale(v, c), scale(cross(axis, v), Math.sin(radians))),
    scale(axis, dot(axis, v) * (1 - c)));
}

/** @param {Vec3Json | undefined} v @returns {Vec3} */
export const vecFromJson = (v) => [Number(v?.x ?? 0), Number(v?.y ?? 0), Number(v?.z ?? 0)];
/** @param {Vec3} v @returns {Vec3Json} */
export const vecToJson = (v) => ({ x: v[0], y: v[1], z: v[2] });
