// The depths of a frame as a coarse grid, and their way to another camera.
// @ts-check

import { basisOf, halfHeightOf } from './camera.js';
import { dot, sub } from './vectors.js';

/** @typedef {import('./types.js').Camera} Camera */
/** @typedef {import('./types.js').DepthGrid} DepthGrid */

/** Two neighbours of the grid are of one surface up to this many cells of depth between them. */
export const JUMP_CELLS = 6;

/**
 * Returns the depth of a point of the grid; below 0: background, or outside of the grid.
 * @param {DepthGrid} grid @param {number} i @param {number} j
 */
export function gridDepth(grid, i, j) {
  if (i < 0 || j < 0 || i >= grid.width || j >= grid.height) {
    return -1;
  }
  const value = grid.values[j * grid.width + i];
  return value === 65535 ? -1 : grid.near + (grid.far - grid.near) * value / 65534;
}

/**
 * @param {Camera} camera of the frame @param {number} gridHeight
 * @returns {{jumpPerDepth: number, jump: number}}
 */
export function jumpOf(camera, gridHeight) {
  const cell = JUMP_CELLS * 2 * halfHeightOf(camera) / gridHeight;
  return camera.height > 0 ? { jumpPerDepth: 0, jump: cell } : { jumpPerDepth: cell, jump: 0 };
}

/**
 * The transformation from a frame to another camera, for the shader. tests/clients/web/warp.mjs
 * computes the same without it.
 * @param {Camera} from @param {number} fromAspect @param {Camera} to @param {number} toAspect
 */
export function makeWarp(from, fromAspect, to, toAspect) {
  const a = basisOf(from);
  const b = basisOf(to);
  const rows = [b.right, b.up, b.forward];
  const columns = [a.right, a.up, a.forward];
  const h0 = halfHeightOf(from);
  const h1 = halfHeightOf(to);
  return {
    // Column-major, as the shader expects it.
    matrix: columns.flatMap((column) => rows.map((row) => dot(row, column))),
    offset: rows.map((row) => dot(row, sub(from.eye, to.eye))),
    fromSpan: [h0 * fromAspect, h0],
    toSpan: [h1 * toAspect, h1],
    isFromPerspective: !(from.height > 0),
    isToPerspective: !(to.height > 0),
  };
}

/**
 * Stands in for the depths of a frame that has none: pixels that differ from the background are at the camera's target.
 * @param {Camera} camera @param {ImageBitmap} bitmap @param {number[]} background red, green, blue, 0 to 1
 * @returns {DepthGrid}
 */
export function gridOfPicture(camera, bitmap, background) {
  const canvas = document.createElement('canvas');
  canvas.width = 128;
  canvas.height = Math.max(1, Math.round(128 * bitmap.height / bitmap.width));
  const { width, height } = canvas;
  const values = new Uint16Array(width * height).fill(65535);
  const context = canvas.getContext('2d');
  if (context) {
    context.drawImage(bitmap, 0, 0, width, height);
    const { data } = context.getImageData(0, 0, width, height);
    for (let i = 0; i < values.length; ++i) {
      if (background.some((channel, k) => Math.abs(data[4 * i + k] - 255 * channel) > 8)) {
        values[i] = 0;
      }
    }
  }
  const { distance } = basisOf(camera);
  return { width, height, near: distance, far: distance, values };
}
