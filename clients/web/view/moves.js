// Cameras that follow a pointer or a key, and the one that fits a surface into the picture.
// @ts-check

import { basisOf, project, spanAt, unproject } from './camera.js';
import { gridDepth } from './relief.js';
import { add, dot, normalize, rotate, scale, sub } from './vectors.js';

/** @typedef {import('./types.js').Vec3} Vec3 */
/** @typedef {import('./types.js').Camera} Camera */
/** @typedef {import('./types.js').DepthGrid} DepthGrid */

/**
 * Turns the scene under the pointer about the target, as a trackball does. (dx, dy) is the move in
 * halves of the picture's height, y up; one half is 90 degrees.
 * @param {Camera} camera @param {number} dx @param {number} dy @param {number} [roll] counter-clockwise
 * @returns {Camera}
 */
export function turn(camera, dx, dy, roll = 0) {
  const { right, up } = basisOf(camera);
  const angle = Math.hypot(dx, dy) * Math.PI / 2;
  const toEye = sub(camera.eye, camera.target);
  let turned = { ...camera, up };
  if (angle > 0) {
    const axis = normalize(add(scale(up, -dx), scale(right, dy)));
    turned = { ...camera, eye: add(camera.target, rotate(toEye, axis, angle)),
      up: normalize(rotate(up, axis, angle)) };
  }
  return roll === 0 ? turned : { ...turned, up: normalize(rotate(turned.up, basisOf(turned).forward, roll)) };
}

/**
 * Moves the scene so that a point at `distance` follows the pointer: (dx, dy) as for turn.
 * @param {Camera} camera @param {number} dx @param {number} dy @param {number} distance
 * @returns {Camera}
 */
export function pan(camera, dx, dy, distance) {
  const { right, up } = basisOf(camera);
  const span = spanAt(camera, distance);
  const move = add(scale(right, -dx * span), scale(up, -dy * span));
  return { ...camera, eye: add(camera.eye, move), target: add(camera.target, move) };
}

/**
 * Scales the scene by `factor` (above 1: nearer); the point under the pointer stays there.
 * @param {Camera} camera @param {number} factor @param {Vec3} point @returns {Camera}
 */
export function zoomTo(camera, factor, point) {
  if (camera.height > 0) {
    const { forward } = basisOf(camera);
    const move = scale(sub(point, camera.eye), 1 - 1 / factor);
    const inPlane = sub(move, scale(forward, dot(move, forward)));
    return { ...camera, eye: add(camera.eye, inPlane), target: add(camera.target, inPlane),
      height: camera.height / factor };
  }
  /** @param {Vec3} p @returns {Vec3} */
  const towards = (p) => add(point, scale(sub(p, point), 1 / factor));
  return { ...camera, eye: towards(camera.eye), target: towards(camera.target) };
}

/**
 * Returns the camera moved so that the frame's surface is in the middle and fills most of the
 * picture; specks of less than 0.3 % of it are ignored. The server's own fit is to a sphere, which
 * leaves room around most surfaces.
 * @param {Camera} camera of the frame @param {DepthGrid} grid of the frame @param {number} aspect
 * @returns {Camera}
 */
export function fillView(camera, grid, aspect) {
  /** @type {Vec3[]} */
  const points = [];
  for (let j = 0; j < grid.height; ++j) {
    for (let i = 0; i < grid.width; ++i) {
      const depth = gridDepth(grid, i, j);
      if (depth >= 0) {
        points.push(unproject(camera, aspect, 2 * (i + 0.5) / grid.width - 1, 1 - 2 * (j + 0.5) / grid.height, depth));
      }
    }
  }
  if (points.length < 8) {
    return camera;
  }
  /** @param {Camera} candidate */
  const reach = (candidate) => {
    const places = points.map((p) => project(candidate, aspect, p));
    const specks = Math.floor(0.003 * places.length);
    const ends = [places.map((at) => at.x), places.map((at) => at.y)].flatMap((values) => {
      values.sort((a, b) => a - b);
      return [values[specks], values[values.length - 1 - specks]];
    });
    const isInFront = candidate.height > 0 || places.every((at) => at.distance > 0);
    return { x: (ends[0] + ends[1]) / 2, y: (ends[2] + ends[3]) / 2,
      most: isInFront ? Math.max(ends[1] - ends[0], ends[3] - ends[2]) / 2 : Infinity };
  };
  let filled = camera;
  let [low, high] = [0.5, 8];
  for (let round = 0; round < 10; ++round) {
    const factor = Math.sqrt(low * high);
    let candidate = zoomTo(camera, factor, camera.target);
    const { x, y } = reach(candidate);
    candidate = pan(candidate, -x * aspect, -y, basisOf(candidate).distance);
    if (reach(candidate).most <= 0.86) {
      filled = candidate;
      low = factor;
    } else {
      high = factor;
    }
  }
  return filled;
}
