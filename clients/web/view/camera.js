// Cameras: as JSON, their axes, and what they project where.
// @ts-check

import { add, cross, dot, length, normalize, scale, sub, vecFromJson, vecToJson } from './vectors.js';

/** @typedef {import('./types.js').Vec3} Vec3 */
/** @typedef {import('./types.js').Camera} Camera */
/** @typedef {import('./types.js').CameraJson} CameraJson */
/** @typedef {import('./types.js').Basis} Basis */

/**
 * Returns the camera, or null if a server would refuse it.
 * @param {any} json @returns {Camera | null}
 */
export function cameraFromJson(json) {
  if (!json || typeof json !== 'object' || !json.eye && !json.target) {
    return null;
  }
  const up = json.up ? vecFromJson(json.up) : /** @type {Vec3} */ ([0, 1, 0]);
  const camera = {
    eye: vecFromJson(json.eye), target: vecFromJson(json.target), up,
    fovYDegrees: Number(json.perspective?.fovYDegrees ?? 30),
    height: Number(json.orthographic?.height ?? 0),
  };
  const forward = sub(camera.target, camera.eye);
  const sine = length(cross(forward, up)) / (length(forward) * length(up));
  const isFinite = [...camera.eye, ...camera.target, ...up, camera.fovYDegrees, camera.height]
    .every(Number.isFinite);
  const isAngle = camera.fovYDegrees > 0 && camera.fovYDegrees < 180;
  return isFinite && sine >= 1e-6 && isAngle && camera.height >= 0 ? camera : null;
}

/** @param {Camera} camera @returns {CameraJson} */
export function cameraToJson(camera) {
  const projection = camera.height > 0 ? { orthographic: { height: camera.height } }
    : { perspective: { fovYDegrees: camera.fovYDegrees } };
  return { eye: vecToJson(camera.eye), target: vecToJson(camera.target), up: vecToJson(camera.up),
    ...projection };
}

/** @param {Camera} camera @returns {Basis} */
export function basisOf(camera) {
  const toTarget = sub(camera.target, camera.eye);
  const forward = normalize(toTarget);
  const right = normalize(cross(forward, camera.up));
  return { right, up: cross(right, forward), forward, distance: length(toTarget) };
}

/**
 * Half the height of the picture in world units: perspective, at the distance 1.
 * @param {Camera} camera
 */
export function halfHeightOf(camera) {
  return camera.height > 0 ? camera.height / 2 : Math.tan(camera.fovYDegrees * Math.PI / 360);
}

/**
 * World units of one half height of the picture, at a distance along the view axis.
 * @param {Camera} camera @param {number} distance
 */
export const spanAt = (camera, distance) => halfHeightOf(camera) * (camera.height > 0 ? 1 : distance);

/** @param {Camera} a @param {Camera} b */
export function isSameCamera(a, b) {
  const size = length(sub(a.target, a.eye));
  /** @param {Vec3} u @param {Vec3} v @param {number} s */
  const near = (u, v, s) => length(sub(u, v)) <= 1e-9 * s;
  return near(a.eye, b.eye, size) && near(a.target, b.target, size) && near(a.up, b.up, length(a.up)) &&
    Math.abs(a.fovYDegrees - b.fovYDegrees) < 1e-9 && Math.abs(a.height - b.height) <= 1e-9 * a.height;
}

/**
 * Projects a point: x to the right and y up, -1 to 1 at the picture's borders, and the distance along
 * the view axis. In perspective, only distances above 0 are in front of the eye.
 * @param {Camera} camera @param {number} aspect width / height @param {Vec3} p
 * @returns {{x: number, y: number, distance: number}}
 */
export function project(camera, aspect, p) {
  const { right, up, forward } = basisOf(camera);
  const q = sub(p, camera.eye);
  const distance = dot(q, forward);
  const span = spanAt(camera, distance);
  return { x: dot(q, right) / (span * aspect), y: dot(q, up) / span, distance };
}

/**
 * Returns the point that project takes to (x, y, distance).
 * @param {Camera} camera @param {number} aspect @param {number} x @param {number} y
 * @param {number} distance @returns {Vec3}
 */
export function unproject(camera, aspect, x, y, distance) {
  const { right, up, forward } = basisOf(camera);
  const span = spanAt(camera, distance);
  return add(camera.eye, add(scale(forward, distance),
    add(scale(right, x * span * aspect), scale(up, y * span))));
}
