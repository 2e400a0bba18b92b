// An interactive view of a surface: a module without dependencies, for the page of the gateway,
// for other pages (`mount`), and for notebooks (the default export is an anywidget module).
//
// From a change of the view to its picture:
//
// 1. The view sends its state whenever it changes. The server answers with quick frames, and with
//    the exact one when no state has come for 120 ms.
// 2. A worker holds the WebSocket, parses messages and decodes pictures. Each frame carries its
//    camera and a coarse grid of depths.
// 3. Until the next frame arrives, the last one is drawn as a relief of that grid from the camera
//    of the pointer, in the animation frame after the move.
// 4. A frame whose camera is the current one is drawn unchanged, pixel by pixel.
//
// The parts are the modules of view/. They import each other by name and export by `export` before a
// declaration, and their names differ, also from those of the page: so _viewer_module.py of the Python client can make
// one module of all, for a notebook cell and for the gateway's page.
//
// Angles are radians, lengths world units, pixels those of the device, unless a name says otherwise.
// @ts-check

/** @typedef {import('./view/types.js').Vec3} Vec3 */
/** @typedef {import('./view/types.js').Camera} Camera */
/** @typedef {import('./view/types.js').Box} Box */
/** @typedef {import('./view/types.js').FrameRequest} FrameRequest */
/** @typedef {import('./view/types.js').DatasetJson} DatasetJson */
/** @typedef {import('./view/types.js').DepthGrid} DepthGrid */
/** @typedef {import('./view/connection.js').Transport} Transport */
/** @typedef {import('./view/loop.js').Options} Options */

export { add, cross, dot, length, normalize, rotate, scale, sub } from './view/vectors.js';
export { basisOf, cameraFromJson, cameraToJson, halfHeightOf, isSameCamera, project, unproject } from './view/camera.js';
export { NAMED_VIEWS, PATIENT_VIEWS, WORLD_VIEWS, axisNamesOf, boxOfDataset, defaultCamera, framedAgain, lengthUnitOf, namedCamera,
  patientDirection } from './view/named-views.js';
export { fillView, pan, turn, zoomTo } from './view/moves.js';
export { gridDepth, jumpOf, makeWarp } from './view/relief.js';
export { parseMessage, workerMain } from './view/worker.js';
export { hasFastWebGl } from './view/gl-screen.js';
export { roundLength } from './view/overlay.js';
export { untilShown, whileShown } from './view/tab.js';
export { Announcer } from './view/notices.js';
export { Client } from './view/client.js';
export { View, mount } from './view/view.js';
export { default } from './view/notebook.js';
