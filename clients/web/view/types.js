// Types that the modules of the view share, as they are in JSON and in memory. Nothing of it runs.
// @ts-check

/**
 * @typedef {[number, number, number]} Vec3
 * @typedef {{x?: number, y?: number, z?: number}} Vec3Json
 * @typedef {{eye?: Vec3Json, target?: Vec3Json, up?: Vec3Json, perspective?: {fovYDegrees?: number},
 *   orthographic?: {height?: number}}} CameraJson A Camera of proto/isoscope/v1/geometry.proto.
 * @typedef {{eye: Vec3, target: Vec3, up: Vec3, fovYDegrees: number, height: number}} Camera With a
 *   `height` above 0 the projection is orthographic.
 * @typedef {{right: Vec3, up: Vec3, forward: Vec3, distance: number}} Basis
 * @typedef {{min: Vec3, max: Vec3}} Box
 * @typedef {Record<string, any>} FrameRequest RenderIsosurfaceRequest as JSON, without viewport and
 *   output, which are the view's own.
 * @typedef {Record<string, any>} DatasetJson A Dataset of proto/isoscope/v1/dataset.proto.
 * @typedef {{width: number, height: number, near: number, far: number, values: Uint16Array}} DepthGrid
 * @typedef {{level?: number, maxSpacingPx?: number}} DrawnLevelJson
 * @typedef {{width: number, height: number, camera: Camera, grid: DepthGrid | null, isExact: boolean,
 *   background: number[], drawnLevel?: DrawnLevelJson}} ShownFrame The frame on the screen.
 */

export {};
