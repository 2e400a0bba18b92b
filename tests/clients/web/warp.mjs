// The warp as the vertex shader of isoscope-view.js draws it, without a GPU: what the tests compare with the truth.
import { gridDepth } from '../../../clients/web/isoscope-view.js';

/**
 * Returns the depth of a cell: of its own point; where that is background, of the farthest neighbour,
 * so that the rim of a surface keeps its pixels.
 * @param {DepthGrid} grid @param {number} i @param {number} j
 */
function cellDepth(grid, i, j) {
  let depth = gridDepth(grid, i, j);
  if (depth < 0) {
    for (let k = 0; k < 9; ++k) {
      depth = Math.max(depth, gridDepth(grid, i + k % 3 - 1, j + Math.floor(k / 3) - 1));
    }
  }
  return depth;
}

/**
 * Returns the depth at corner (a, b), each 0 or 1, of cell (i, j); below 0 if the cell shows nothing.
 * Neighbours that are connected meet at one depth; others are cut.
 * @param {DepthGrid} grid @param {number} i @param {number} j @param {number} a @param {number} b
 * @param {number} jumpPerDepth @param {number} jump the greatest step between neighbours of one
 *   surface is jump + jumpPerDepth * the lesser depth
 */
export function cornerDepth(grid, i, j, a, b, jumpPerDepth, jump) {
  const own = cellDepth(grid, i, j);
  if (own < 0) {
    return -1;
  }
  let sum = 0;
  let count = 0;
  for (let k = 0; k < 4; ++k) {
    const depth = gridDepth(grid, i + a - 1 + k % 2, j + b - 1 + (k >> 1));
    if (depth >= 0 && Math.abs(depth - own) <= jump + jumpPerDepth * Math.min(depth, own)) {
      sum += depth;
      ++count;
    }
  }
  return count > 0 ? sum / count : own;
}

/**
 * Takes a point of the frame, u and v in [0, 1] from its top left corner, and its depth to the other
 * camera's picture, as project does.
 * @param {ReturnType<typeof makeWarp>} warp @param {number} u @param {number} v @param {number} depth
 */
export function warpPoint(warp, u, v, depth) {
  const s = warp.isFromPerspective ? depth : 1;
  const p = [(2 * u - 1) * warp.fromSpan[0] * s, (1 - 2 * v) * warp.fromSpan[1] * s, depth];
  const m = warp.matrix;
  /** @param {number} row */
  const at = (row) => m[row] * p[0] + m[3 + row] * p[1] + m[6 + row] * p[2] + warp.offset[row];
  const distance = at(2);
  const t = warp.isToPerspective ? distance : 1;
  return { x: at(0) / (warp.toSpan[0] * t), y: at(1) / (warp.toSpan[1] * t), distance };
}

/**
 * Takes a point of the frame to the other camera by the grid alone, as the shader draws it: null where
 * the relief has nothing.
 * @param {DepthGrid} grid @param {ReturnType<typeof makeWarp>} warp @param {number} u
 * @param {number} v @param {{jumpPerDepth: number, jump: number}} jump
 */
export function warpByGrid(grid, warp, u, v, jump) {
  const i = Math.min(Math.floor(u * grid.width), grid.width - 1);
  const j = Math.min(Math.floor(v * grid.height), grid.height - 1);
  const fx = u * grid.width - i;
  const fy = v * grid.height - j;
  let depth = 0;
  for (let k = 0; k < 4; ++k) {
    const a = k % 2;
    const b = k >> 1;
    const corner = cornerDepth(grid, i, j, a, b, jump.jumpPerDepth, jump.jump);
    if (corner < 0) {
      return null;
    }
    depth += corner * (a ? fx : 1 - fx) * (b ? fy : 1 - fy);
  }
  return warpPoint(warp, u, v, depth);
}
