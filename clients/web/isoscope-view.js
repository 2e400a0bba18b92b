// An interactive view of a surface: one module without dependencies, for the page of the gateway,
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
// Angles are radians, lengths world units, pixels those of the device, unless a name says otherwise.
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
 */

// ---- vectors ----

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
const vecFromJson = (v) => [Number(v?.x ?? 0), Number(v?.y ?? 0), Number(v?.z ?? 0)];
/** @param {Vec3} v @returns {Vec3Json} */
const vecToJson = (v) => ({ x: v[0], y: v[1], z: v[2] });

// ---- cameras ----

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
const spanAt = (camera, distance) => halfHeightOf(camera) * (camera.height > 0 ? 1 : distance);

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

// ---- moves of the pointer ----

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

// ---- warping a frame to another camera ----

/** Two neighbours of the grid are of one surface up to this many cells of depth between them. */
const JUMP_CELLS = 6;

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

// ---- messages and the worker ----

/**
 * Parses a message of the gateway: u32 length of JSON, JSON, picture, depths (docs/gateway.md). Throws
 * an Error that describes the fault. Self-contained: the worker is made from its source.
 * @param {ArrayBuffer} buffer
 * @returns {{header: any, image: Uint8Array, depths: Uint16Array}}
 */
export function parseMessage(buffer) {
  /** @param {string} why @returns {never} */
  const fail = (why) => {
    throw new Error(`The server sent a message of ${buffer.byteLength} bytes that is no frame: ${why}.`);
  };
  if (buffer.byteLength < 4) {
    fail('it is too short');
  }
  const view = new DataView(buffer);
  const jsonBytes = view.getUint32(0, true);
  if (jsonBytes > buffer.byteLength - 4) {
    fail(`its header says that it has ${jsonBytes} bytes`);
  }
  /** @type {any} */
  let header = null;
  try {
    header = JSON.parse(new TextDecoder('utf-8', { fatal: true }).decode(new Uint8Array(buffer, 4, jsonBytes)));
  } catch {
    fail('its header is no JSON');
  }
  if (header === null || typeof header !== 'object' || Array.isArray(header)) {
    fail('its header is no object');
  }
  const imageBytes = header.image?.bytes ?? 0;
  const depthBytes = header.depthBytes ?? 0;
  for (const count of [imageBytes, depthBytes]) {
    if (!Number.isSafeInteger(count) || count < 0) {
      fail(`a size in its header is ${JSON.stringify(count)}`);
    }
  }
  if (4 + jsonBytes + imageBytes + depthBytes !== buffer.byteLength) {
    fail(`its parts have ${4 + jsonBytes + imageBytes + depthBytes} bytes`);
  }
  if (imageBytes > 0 && header.image.type !== 'image/jpeg' && header.image.type !== 'image/png') {
    fail(`the type of its picture is ${JSON.stringify(header.image.type)}`);
  }
  const number = Number(header.frameNumber ?? 0);
  if (!Number.isSafeInteger(number) || number < 0) {
    fail(`its frame number is ${JSON.stringify(header.frameNumber)}`);
  }
  const grid = header.depthGrid;
  if (depthBytes > 0 && !(grid && grid.width > 0 && grid.height > 0 && grid.width <= 4096 &&
      2 * grid.width * grid.height === depthBytes)) {
    fail(`its grid of depths has ${depthBytes} bytes`);
  }
  const start = 4 + jsonBytes;
  const depths = new Uint16Array(buffer.slice(start + imageBytes, start + imageBytes + depthBytes));
  if (new Uint8Array(new Uint16Array([1]).buffer)[0] === 0) {  // a big-endian machine
    const source = new DataView(depths.buffer);
    depths.forEach((_, i) => { depths[i] = source.getUint16(2 * i, true); });
  }
  return { header, image: new Uint8Array(buffer, start, imageBytes), depths };
}

/**
 * Owns socket and decoding. One picture is decoded at a time, one waits. A third replaces the
 * waiting one, which is reported to the server. Self-contained: it is started from its source.
 * @param {{postMessage: (message: any, transfer?: any[]) => void,
 *   onmessage: ((event: {data: any}) => void) | null}} scope
 * @param {typeof parseMessage} parse
 */
export function workerMain(scope, parse) {
  /** @type {WebSocket | null} */
  let socket = null;
  let generation = 0;
  let isDecoding = false;
  /** @type {{buffer: ArrayBuffer, receivedAt: number} | null} */
  let waiting = null;

  /** @param {string} text */
  const send = (text) => {
    if (socket && socket.readyState === 1) {
      socket.send(text);
    } else {
      scope.postMessage({ kind: 'outgoing', text });
    }
  };

  /** @param {ArrayBuffer} buffer */
  const drop = (buffer) => {
    try {
      const { header } = parse(buffer);
      scope.postMessage({ kind: 'dropped', sequence: Number(header.sequenceNumber ?? 0), bytes: buffer.byteLength });
      if (header.frameNumber) {
        send(JSON.stringify({ frameShown: { frameNumber: String(header.frameNumber) } }));
      }
    } catch (error) {
      scope.postMessage({ kind: 'bad', sentence: String(/** @type {Error} */ (error).message) });
    }
  };

  /** @param {ArrayBuffer} buffer @param {number} receivedAt */
  const decode = async (buffer, receivedAt) => {
    const mine = generation;
    const startedAt = performance.now();
    try {
      const { header, image, depths } = parse(buffer);
      /** @type {ImageBitmap | null} */
      let bitmap = null;
      if (image.byteLength > 0) {
        const blob = new Blob([image], { type: header.image.type });
        try {
          // A JPEG has neither alpha nor profile; requesting them would cost a pass over its
          // pixels.
          bitmap = await (header.image.type === 'image/jpeg' ? createImageBitmap(blob)
            : createImageBitmap(blob, { premultiplyAlpha: 'none', colorSpaceConversion: 'none' }));
        } catch {
          throw new Error(`The browser cannot decode the ${header.image.type} picture that the server sent.`);
        }
      }
      if (mine !== generation) {
        bitmap?.close();
        return;
      }
      const now = performance.now();
      scope.postMessage({
        kind: 'frame', header, bitmap, depths, bytes: buffer.byteLength, generation: mine,
        receivedAt: performance.timeOrigin + receivedAt, decodeMs: now - startedAt,
      }, bitmap ? [bitmap, depths.buffer] : [depths.buffer]);
    } catch (error) {
      scope.postMessage({ kind: 'bad', sentence: String(/** @type {Error} */ (error).message) });
    }
  };

  /** @param {ArrayBuffer} buffer */
  const receive = async (buffer) => {
    const receivedAt = performance.now();
    if (isDecoding) {
      if (waiting) {
        drop(waiting.buffer);
      }
      waiting = { buffer, receivedAt };
      return;
    }
    isDecoding = true;
    /** @type {{buffer: ArrayBuffer, receivedAt: number} | null} */
    let next = { buffer, receivedAt };
    while (next) {
      await decode(next.buffer, next.receivedAt);
      next = waiting;
      waiting = null;
    }
    isDecoding = false;
  };

  const close = () => {
    ++generation;
    waiting = null;
    if (socket) {
      socket.onopen = socket.onmessage = socket.onclose = null;
      socket.close();
      socket = null;
    }
  };

  /** @param {string} url @param {string[]} protocols */
  const open = (url, protocols) => {
    close();
    try {
      socket = new WebSocket(url, protocols);
    } catch (error) {
      scope.postMessage({ kind: 'closed', code: 0, reason: String(/** @type {Error} */ (error).message) });
      return;
    }
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => scope.postMessage({ kind: 'open', generation });
    socket.onmessage = (event) => {
      if (event.data instanceof ArrayBuffer) {
        receive(event.data);
      } else {
        scope.postMessage({ kind: 'bad', sentence: 'The server sent text where a frame was expected.' });
      }
    };
    socket.onclose = (event) => {
      close();
      scope.postMessage({ kind: 'closed', code: event.code, reason: event.reason });
    };
  };

  scope.onmessage = ({ data }) => {
    switch (data.kind) {
      case 'open': open(data.url, data.protocols); break;
      case 'send': send(data.text); break;
      case 'data': receive(data.buffer); break;
      case 'shown':
        if (data.generation === generation) {
          send(JSON.stringify({ frameShown: { frameNumber: String(data.frameNumber),
            decodeDuration: `${(data.decodeMs / 1000).toFixed(6)}s` } }));
        }
        break;
      case 'close': close(); break;
    }
  };
}

/**
 * Starts workerMain in a worker, or in the page if the page allows no worker.
 * @param {(message: any) => void} receive @returns {{post: (message: any, transfer?: any[]) => void,
 *   stop: () => void, isWorker: boolean}}
 */
function startWorker(receive) {
  const inPage = () => {
    /** @type {{postMessage: (m: any) => void, onmessage: ((e: {data: any}) => void) | null}} */
    const scope = { postMessage: (message) => queueMicrotask(() => receive(message)), onmessage: null };
    workerMain(scope, parseMessage);
    return scope;
  };
  /** @type {ReturnType<typeof inPage> | null} */
  let page = null;
  /** @type {Worker | null} */
  let worker = null;
  /** @type {any[]} */
  const unanswered = [];
  try {
    const source = `const parse = ${parseMessage};\n(${workerMain})(self, parse);`;
    const url = URL.createObjectURL(new Blob([source], { type: 'text/javascript' }));
    worker = new Worker(url);
    worker.onmessage = (event) => {
      unanswered.length = 0;
      receive(event.data);
    };
    // A content security policy reports only here.
    worker.onerror = () => {
      if (!page && unanswered.length > 0) {
        page = inPage();
        worker?.terminate();
        for (const message of unanswered.splice(0)) {
          page.onmessage?.({ data: message });
        }
      }
    };
  } catch {
    page = inPage();
  }
  return {
    get isWorker() { return page === null; },
    post(message, transfer = []) {
      if (page) {
        page.onmessage?.({ data: message });
      } else {
        if (message.kind === 'open') {
          unanswered.push(message);
        }
        worker?.postMessage(message, transfer);
      }
    },
    stop() {
      page?.onmessage?.({ data: { kind: 'close' } });
      worker?.terminate();
    },
  };
}

// ---- screens ----

const VERTEX_SHADER = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
uniform usampler2D depths;
uniform ivec2 grid;
uniform vec4 depthRange;  // near, far, jump, jump for each unit of depth
uniform mat3 turn;
uniform vec3 offset;
uniform vec4 spans;       // of the frame, of the canvas
uniform bvec3 mode;       // flat, frame in perspective, canvas in perspective
uniform vec2 flatScale;
uniform vec2 clipPlanes;  // near, far
out vec2 place;

float depthAt(ivec2 at) {
  if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, grid))) return -1.0;
  uint value = texelFetch(depths, at, 0).r;
  return value == 65535u ? -1.0 : mix(depthRange.x, depthRange.y, float(value) / 65534.0);
}

void main() {
  ivec2 corner = ivec2(gl_VertexID & 1, gl_VertexID >> 1);
  if (mode.x) {
    place = vec2(corner);
    gl_Position = vec4((2.0 * place.x - 1.0) * flatScale.x, (1.0 - 2.0 * place.y) * flatScale.y, 0.0, 1.0);
    return;
  }
  ivec2 cell = ivec2(gl_InstanceID % grid.x, gl_InstanceID / grid.x);
  place = vec2(cell + corner) / vec2(grid);
  float own = depthAt(cell);
  for (int k = 0; own < 0.0 && k < 1; ++k) {
    for (int n = 0; n < 9; ++n) own = max(own, depthAt(cell + ivec2(n % 3 - 1, n / 3 - 1)));
  }
  if (own < 0.0) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    return;
  }
  float sum = 0.0;
  float count = 0.0;
  for (int k = 0; k < 4; ++k) {
    float depth = depthAt(cell + corner - 1 + ivec2(k & 1, k >> 1));
    if (depth >= 0.0 && abs(depth - own) <= depthRange.z + depthRange.w * min(depth, own)) {
      sum += depth;
      count += 1.0;
    }
  }
  float depth = count > 0.0 ? sum / count : own;
  float s = mode.y ? depth : 1.0;
  vec3 p = turn * vec3((2.0 * place.x - 1.0) * spans.x * s, (1.0 - 2.0 * place.y) * spans.y * s, depth) + offset;
  float n = clipPlanes.x;
  float f = clipPlanes.y;
  gl_Position = mode.z ? vec4(p.xy / spans.zw, ((f + n) * p.z - 2.0 * f * n) / (f - n), p.z)
                       : vec4(p.xy / spans.zw, (2.0 * p.z - f - n) / (f - n), 1.0);
}`;

const FRAGMENT_SHADER = `#version 300 es
precision highp float;
uniform sampler2D picture;
in vec2 place;
out vec4 color;
void main() { color = texture(picture, place); }`;

/**
 * @typedef {{width: number, height: number, camera: Camera, grid: DepthGrid | null, isExact: boolean,
 *   background: number[]}} ShownFrame
 * @typedef {{name: string, canvas: HTMLCanvasElement, isWarping: boolean, show: (bitmap: ImageBitmap, frame: ShownFrame) => void,
 *   draw: (camera: Camera) => boolean, finish: () => void, resize: (width: number, height: number) => void,
 *   destroy: () => void}} Screen show takes the bitmap over and closes it; draw says whether it warped;
 *   finish waits until it is drawn.
 */

/** @param {string} className */
function makeCanvas(className) {
  const canvas = document.createElement('canvas');
  canvas.className = className;
  return canvas;
}

/**
 * Draws on WebGL2; null where there is none.
 * @param {(why: string) => void} lost called when the context is lost @returns {Screen | null}
 */
function makeGlScreen(lost) {
  const canvas = makeCanvas('picture');
  const gl = canvas.getContext('webgl2', { antialias: false, alpha: false, preserveDrawingBuffer: false });
  if (!gl) {
    return null;
  }
  const program = /** @type {WebGLProgram} */ (gl.createProgram());
  for (const [type, source] of /** @type {[number, string][]} */ (
    [[gl.VERTEX_SHADER, VERTEX_SHADER], [gl.FRAGMENT_SHADER, FRAGMENT_SHADER]])) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(type));
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) {
      console.warn(`isoscope: a shader does not compile here: ${gl.getShaderInfoLog(shader)}`);
      return null;
    }
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    return null;
  }
  gl.useProgram(program);
  /** @param {string} name */
  const uniform = (name) => gl.getUniformLocation(program, name);
  const at = {
    depths: uniform('depths'), picture: uniform('picture'), grid: uniform('grid'),
    depthRange: uniform('depthRange'), turn: uniform('turn'), offset: uniform('offset'),
    spans: uniform('spans'), mode: uniform('mode'), flatScale: uniform('flatScale'),
    clipPlanes: uniform('clipPlanes'),
  };
  gl.uniform1i(at.picture, 0);
  gl.uniform1i(at.depths, 1);
  const textures = [gl.createTexture(), gl.createTexture()];
  textures.forEach((texture, unit) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    for (const [name, value] of [[gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
      [gl.TEXTURE_MIN_FILTER, gl.NEAREST], [gl.TEXTURE_MAG_FILTER, gl.NEAREST]]) {
      gl.texParameteri(gl.TEXTURE_2D, name, value);
    }
  });
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
  canvas.addEventListener('webglcontextlost', (event) => {
    event.preventDefault();
    lost('the graphics driver took the canvas away');
  });
  /** @type {ShownFrame | null} */
  let frame = null;

  return {
    name: 'webgl2',
    canvas,
    isWarping: true,
    show(bitmap, shown) {
      gl.activeTexture(gl.TEXTURE0);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, bitmap);
      bitmap.close();
      if (shown.grid) {
        gl.activeTexture(gl.TEXTURE1);
        gl.texImage2D(gl.TEXTURE_2D, 0, gl.R16UI, shown.grid.width, shown.grid.height, 0,
          gl.RED_INTEGER, gl.UNSIGNED_SHORT, shown.grid.values);
      }
      frame = shown;
    },
    resize(width, height) {
      canvas.width = width;
      canvas.height = height;
    },
    draw(camera) {
      if (!frame || canvas.width === 0 || canvas.height === 0) {
        return false;
      }
      const aspect = canvas.width / canvas.height;
      const frameAspect = frame.width / frame.height;
      const isFlat = isSameCamera(frame.camera, camera) || !frame.grid;
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.clearColor(frame.background[0], frame.background[1], frame.background[2], 1);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      const isPixelByPixel = isFlat && frame.width === canvas.width && frame.height === canvas.height;
      gl.activeTexture(gl.TEXTURE0);
      for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
        gl.texParameteri(gl.TEXTURE_2D, name, isPixelByPixel ? gl.NEAREST : gl.LINEAR);
      }
      gl.uniform3i(at.mode, isFlat ? 1 : 0, frame.camera.height > 0 ? 0 : 1, camera.height > 0 ? 0 : 1);
      if (isFlat || !frame.grid) {
        gl.disable(gl.DEPTH_TEST);
        // The picture has the height of the view; it may be wider or narrower.
        gl.uniform2f(at.flatScale, frameAspect / aspect, 1);
        gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
        return false;
      }
      const warp = makeWarp(frame.camera, frameAspect, camera, aspect);
      const jump = jumpOf(frame.camera, frame.grid.height);
      gl.enable(gl.DEPTH_TEST);
      gl.uniform2i(at.grid, frame.grid.width, frame.grid.height);
      gl.uniformMatrix3fv(at.turn, false, warp.matrix);
      gl.uniform3f(at.offset, warp.offset[0], warp.offset[1], warp.offset[2]);
      gl.uniform4f(at.spans, warp.fromSpan[0], warp.fromSpan[1], warp.toSpan[0], warp.toSpan[1]);
      const reach = frame.grid.far + length(sub(frame.camera.eye, camera.eye)) + frame.grid.far - frame.grid.near;
      gl.uniform2f(at.clipPlanes, camera.height > 0 ? -reach : reach * 1e-3, reach * 2);
      // First without cuts, which fills hidden parts from their surroundings; then with cuts, on
      // top.
      for (const [any, perDepth] of [[1e30, 0], [jump.jump, jump.jumpPerDepth]]) {
        gl.clear(gl.DEPTH_BUFFER_BIT);
        gl.uniform4f(at.depthRange, frame.grid.near, frame.grid.far, any, perDepth);
        gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, frame.grid.width * frame.grid.height);
      }
      return true;
    },
    finish() {
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    },
    destroy() {
      frame = null;
      gl.getExtension('WEBGL_lose_context')?.loseContext();
      canvas.remove();
    },
  };
}

/**
 * Shows pictures as they come, without WebGL. If the processor emulates WebGL, this takes half of
 * its time.
 * @returns {Screen}
 */
function makeBitmapScreen() {
  const canvas = makeCanvas('picture plain');
  const context = /** @type {ImageBitmapRenderingContext} */ (canvas.getContext('bitmaprenderer', { alpha: false }));
  return {
    name: 'bitmaprenderer',
    canvas,
    isWarping: false,
    show(bitmap, shown) {
      if (canvas.width !== shown.width || canvas.height !== shown.height) {
        canvas.width = shown.width;
        canvas.height = shown.height;
      }
      context.transferFromImageBitmap(bitmap);
      bitmap.close();
    },
    resize() {},
    draw: () => false,
    finish() {},
    destroy() {
      context.transferFromImageBitmap(null);
      canvas.remove();
    },
  };
}

/** Says whether WebGL2 is there and not done by the processor. */
export function hasFastWebGl() {
  const canvas = document.createElement('canvas');
  const gl = canvas.getContext('webgl2');
  if (!gl) {
    return false;
  }
  const info = gl.getExtension('WEBGL_debug_renderer_info');
  const name = String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  gl.getExtension('WEBGL_lose_context')?.loseContext();
  return !/swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

// ---- what lies over the picture ----

/**
 * Returns the largest of 1, 2 and 5 times a power of ten that is at most `limit`.
 * @param {number} limit above 0
 */
export function roundLength(limit) {
  const power = 10 ** Math.floor(Math.log10(limit));
  return [5, 2, 1].map((digit) => digit * power).find((value) => value <= limit * (1 + 1e-9)) ?? power;
}

/** The side of the picture of the axes, and the most that a scale bar takes, in CSS pixels. */
const AXES_PX = 92;
const SCALE_BAR_PX = 160;
const AXIS_COLORS = ['#ff6b6b', '#5fd08a', '#6aa8ff'];

/**
 * @typedef {{camera: Camera, frame: ShownFrame | null, box: Box | null, clipBox: Box | null,
 *   patientFrame: string, pins: {position: Vec3, label?: string}[], ink: string, halo: string,
 *   showBox: boolean}} Scene
 */

/**
 * Says whether the frame's relief hides a point.
 * @param {ShownFrame | null} frame @param {Vec3} p
 */
function isHidden(frame, p) {
  if (!frame?.grid) {
    return false;
  }
  const at = project(frame.camera, frame.width / frame.height, p);
  const i = Math.floor((at.x + 1) / 2 * frame.grid.width);
  const j = Math.floor((1 - at.y) / 2 * frame.grid.height);
  const depth = gridDepth(frame.grid, i, j);
  return depth >= 0 && at.distance > depth + 2 * jumpOf(frame.camera, frame.grid.height).jumpPerDepth / JUMP_CELLS * depth;
}

/**
 * @param {CanvasRenderingContext2D} context @param {string} text @param {number} x @param {number} y
 * @param {string} color @param {string} halo
 */
function drawLabel(context, text, x, y, color, halo) {
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  context.font = '600 12px system-ui, sans-serif';
  context.lineWidth = 3;
  context.strokeStyle = halo;
  context.lineJoin = 'round';
  context.strokeText(text, x, y);
  context.fillStyle = color;
  context.fillText(text, x, y);
}

/**
 * Draws a line through points.
 * @param {CanvasRenderingContext2D} context @param {string} color @param {number} width
 * @param {[number, number][]} points
 */
function drawLine(context, color, width, points) {
  context.strokeStyle = color;
  context.lineWidth = width;
  context.beginPath();
  points.forEach(([x, y]) => context.lineTo(x, y));
  context.stroke();
}

/**
 * Draws boxes and pins, which are part of the scene.
 * @param {CanvasRenderingContext2D} context @param {number} width @param {number} height in CSS pixels
 * @param {Scene} scene
 */
function drawOverlay(context, width, height, scene) {
  const aspect = width / height;
  /** @param {Vec3} p */
  const toScreen = (p) => {
    const at = project(scene.camera, aspect, p);
    return { x: (at.x + 1) / 2 * width, y: (1 - at.y) / 2 * height,
      isSeen: scene.camera.height > 0 || at.distance > 0 };
  };
  /** @param {Box} box @param {string} color */
  const drawBox = (box, color) => {
    for (let edge = 0; edge < 12; ++edge) {
      const axis = edge >> 2;
      /** @type {Vec3} */
      const begin = [...box.min];
      begin[(axis + 1) % 3] = edge & 1 ? box.max[(axis + 1) % 3] : box.min[(axis + 1) % 3];
      begin[(axis + 2) % 3] = edge & 2 ? box.max[(axis + 2) % 3] : box.min[(axis + 2) % 3];
      const pieces = 48;
      let previous = toScreen(begin);
      for (let k = 1; k <= pieces; ++k) {
        /** @type {Vec3} */
        const p = [...begin];
        p[axis] = box.min[axis] + (box.max[axis] - box.min[axis]) * k / pieces;
        const at = toScreen(p);
        if (previous.isSeen && at.isSeen) {
          context.globalAlpha = isHidden(scene.frame, p) ? 0.12 : 0.75;
          drawLine(context, color, 1.25, [[previous.x, previous.y], [at.x, at.y]]);
        }
        previous = at;
      }
    }
    context.globalAlpha = 1;
  };

  context.clearRect(0, 0, width, height);
  context.lineCap = 'round';
  if (scene.showBox && scene.box) {
    drawBox(scene.box, scene.ink);
  }
  if (scene.showBox && scene.clipBox) {
    drawBox(scene.clipBox, '#ffb454');
  }

  if (scene.pins.length === 2) {
    const [a, b] = scene.pins.map((pin) => toScreen(pin.position));
    context.setLineDash([5, 4]);
    drawLine(context, '#ffb454', 1.5, [[a.x, a.y], [b.x, b.y]]);
    context.setLineDash([]);
  }
  for (const pin of scene.pins) {
    const at = toScreen(pin.position);
    if (at.isSeen) {
      context.beginPath();
      context.arc(at.x, at.y, 5, 0, 2 * Math.PI);
      context.fillStyle = '#ffb454';
      context.fill();
      context.lineWidth = 2;
      context.strokeStyle = '#1a1206';
      context.stroke();
      if (pin.label) {
        drawLabel(context, pin.label, at.x, at.y - 15, '#ffb454', scene.halo);
      }
    }
  }
}

/**
 * Draws the directions of the world, on a square of AXES_PX.
 * @param {CanvasRenderingContext2D} context @param {Scene} scene
 */
function drawAxes(context, scene) {
  context.clearRect(0, 0, AXES_PX, AXES_PX);
  context.lineCap = 'round';
  const { right, up, forward } = basisOf(scene.camera);
  const center = { x: AXES_PX / 2, y: AXES_PX / 2 };
  const arm = 26;
  const axes = [0, 1, 2].map((axis) => ({
    x: right[axis], y: up[axis], depth: forward[axis], color: AXIS_COLORS[axis],
    label: scene.patientFrame[axis] ?? 'XYZ'[axis],
  })).sort((a, b) => b.depth - a.depth);
  for (const axis of axes) {
    const end = { x: center.x + arm * axis.x, y: center.y - arm * axis.y };
    drawLine(context, scene.halo, 5, [[center.x, center.y], [end.x, end.y]]);
    drawLine(context, axis.color, 2.5, [[center.x, center.y], [end.x, end.y]]);
    const reach = Math.hypot(axis.x, axis.y);
    const away = reach > 0.2 ? (arm * reach + 10) / reach : arm;
    drawLabel(context, axis.label, center.x + away * axis.x, center.y - away * axis.y, axis.color, scene.halo);
  }
}

/**
 * The unit of world space, for people; '' if it is unknown. Files that know the patient are in millimetres.
 * @param {DatasetJson | null} dataset @returns {string}
 */
export function lengthUnitOf(dataset) {
  return dataset?.lengthUnit ? String(dataset.lengthUnit).slice(0, 12) : dataset?.patientFrame ? 'mm' : '';
}

/**
 * Returns the scale bar: its length in CSS pixels, and its text.
 * @param {Camera} camera @param {number} width @param {number} height of the view in CSS pixels
 */
function scaleBarOf(camera, width, height) {
  const span = spanAt(camera, basisOf(camera).distance) * 2 / height;
  const reach = roundLength(span * Math.min(SCALE_BAR_PX, width / 4));
  return { px: reach / span, text: String(Number(reach.toPrecision(6))) };
}

/**
 * Draws a scale bar that ends at the right of its canvas.
 * @param {CanvasRenderingContext2D} context @param {{px: number, text: string}} bar
 * @param {{ink: string, halo: string}} colors
 */
function drawScaleBar(context, bar, { ink, halo }) {
  const x = SCALE_BAR_PX + 20;
  const y = 34;
  context.clearRect(0, 0, x + 4, y + 4);
  context.lineCap = 'round';
  /** @type {[number, number][]} */
  const points = [[x - bar.px, y - 4], [x - bar.px, y], [x, y], [x, y - 4]];
  drawLine(context, halo, 4, points);
  drawLine(context, ink, 2, points);
  drawLabel(context, bar.text, x - bar.px / 2, y - 14, ink, halo);
}

// ---- the view ----

/** The last of many numbers, and their percentiles. */
class Samples {
  constructor() {
    /** @type {number[]} */
    this.values = [];
  }

  /** @param {number} value */
  add(value) {
    this.values.push(value);
    if (this.values.length > 512) {
      this.values.shift();
    }
  }

  summary() {
    const sorted = [...this.values].sort((a, b) => a - b);
    /** @param {number} share */
    const at = (share) => sorted.length === 0 ? null : sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
    return { count: sorted.length, p50: at(0.5), p95: at(0.95) };
  }
}

/** Refusals are asked again for so long. */
const RETRY_MS = 30000;

/**
 * Waits; throws the reason of a signal that aborts before the end.
 * @param {number} ms @param {AbortSignal | null} [signal] @returns {Promise<void>}
 */
function sleep(ms, signal) {
  return new Promise((resolve, reject) => {
    const abort = () => {
      clearTimeout(timer);
      reject(signal?.reason);
    };
    const timer = setTimeout(() => {
      signal?.removeEventListener('abort', abort);
      resolve();
    }, ms);
    if (signal?.aborted) {
      abort();
    } else {
      signal?.addEventListener('abort', abort, { once: true });
    }
  });
}

/** @param {() => void} changed called when the tab is hidden or shown @returns {() => void} ends that */
function watchTab(changed) {
  document.addEventListener('visibilitychange', changed);
  return () => document.removeEventListener('visibilitychange', changed);
}

/** Waits until the tab is shown. A hidden tab asks for nothing. @returns {Promise<void>} */
export async function untilShown() {
  if (globalThis.document?.hidden) {
    await new Promise((resolve) => {
      const stop = watchTab(() => {
        if (!document.hidden) {
          stop();
          resolve(undefined);
        }
      });
    });
  }
}

/**
 * Calls `ask` every `ms` while the tab is shown, and at once when it is shown again.
 * @param {() => void} ask @param {number} ms @returns {() => void} ends it
 */
export function whileShown(ask, ms) {
  let timer = document.hidden ? undefined : setInterval(ask, ms);
  const stop = watchTab(() => {
    clearInterval(timer);
    timer = undefined;
    if (!document.hidden) {
      ask();
      timer = setInterval(ask, ms);
    }
  });
  return () => {
    clearInterval(timer);
    stop();
  };
}

/** Screen readers get at most one sentence in this time. */
const SPEECH_MS = 2000;

/**
 * Passes sentences to a screen reader, one at a time. Of those that come within SPEECH_MS of the
 * last one, the newest is spoken after that time.
 */
export class Announcer {
  /**
   * @param {(sentence: string) => void} write @param {(action: () => void, ms: number) => void} [later]
   */
  constructor(write, later = (action, ms) => { setTimeout(action, ms); }) {
    this.write = write;
    this.later = later;
    this.isResting = false;
    /** @type {string | null} */
    this.next = null;
  }

  /** @param {string} sentence */
  say(sentence) {
    if (this.isResting) {
      this.next = sentence;
      return;
    }
    this.isResting = true;
    this.write(sentence);
    this.later(() => {
      this.isResting = false;
      const { next } = this;
      this.next = null;
      if (next !== null) {
        this.say(next);
      }
    }, SPEECH_MS);
  }
}

/** The protocol of the gateway's WebSocket, and one whose name carries the token: browsers give it no header. */
const PROTOCOL = 'isoscope';
const BEARER_PROTOCOL = 'isoscope.bearer.';

/**
 * The HTTP side of a gateway. Every error is an Error with a sentence, `code` and `status`. The
 * token is sent in headers, never in an address. A token in the address of the surrounding page,
 * such as a notebook's, is not touched.
 */
export class Client {
  /**
   * @param {string} [url] of the gateway, maybe with `?token=`; default: the page's own folder
   * @param {string} [token]
   */
  constructor(url = '', token = '') {
    this.base = new URL(url || './', document.baseURI);
    if (!this.base.pathname.endsWith('/')) {
      this.base.pathname = this.base.pathname.replace(/[^/]*$/, '');
    }
    this.token = token || this.base.searchParams.get('token') || '';
    this.base.search = '';
    this.base.hash = '';
  }

  /** @param {string} path */
  address(path) {
    return new URL(path, this.base).href;
  }

  get socketAddress() {
    return this.address('v1/interact').replace(/^http/, 'ws');
  }

  /** The protocols that the WebSocket offers. The gateway chooses the first one. */
  get socketProtocols() {
    const text = String.fromCharCode(...new TextEncoder().encode(this.token));
    const coded = btoa(text).replaceAll('+', '-').replaceAll('/', '_').replaceAll('=', '');
    return coded ? [PROTOCOL, BEARER_PROTOCOL + coded] : [];
  }

  /**
   * Retries after the delay of a refusal, within RETRY_MS. Waits while the tab is hidden.
   * @param {string} path @param {RequestInit} [init] @returns {Promise<Response>}
   */
  async request(path, init) {
    const start = performance.now();
    for (;;) {
      await untilShown();
      try {
        return await this.requestOnce(path, init);
      } catch (error) {
        const delay = /** @type {{retryDelay?: number}} */ (error).retryDelay;
        if (delay === undefined || performance.now() - start + delay > RETRY_MS) {
          throw error;
        }
        await sleep(delay, init?.signal);
      }
    }
  }

  /** @param {string} path @param {RequestInit} [init] @returns {Promise<Response>} */
  async requestOnce(path, init) {
    let response;
    try {
      const headers = { ...init?.headers, ...(this.token ? { Authorization: `Bearer ${this.token}` } : {}) };
      response = await fetch(this.address(path), { ...init, headers });
    } catch (error) {
      if (/** @type {Error} */ (error).name === 'AbortError') {
        throw error;
      }
      throw Object.assign(new Error(`The gateway at ${this.base.href} does not answer. Is isoscope-gateway (or ` +
        '`isoscope view`) still running, and is the network up?'), { code: 'UNAVAILABLE', status: 0 });
    }
    if (!response.ok) {
      let body = { code: '', message: '', retry_delay_ms: /** @type {number | undefined} */ (undefined) };
      try {
        body = await response.json();
      } catch {
        // Not from the gateway: a proxy's page.
      }
      const delay = body.retry_delay_ms;
      throw Object.assign(new Error(body.message || `The gateway answered with HTTP status ${response.status}.`),
        { code: body.code || 'UNKNOWN', status: response.status,
          retryDelay: typeof delay === 'number' && delay >= 0 ? delay : undefined });
    }
    return response;
  }

  /** @param {string} path @returns {Promise<any>} */
  async get(path) {
    return (await this.request(path)).json();
  }

  /** @param {string} path @param {any} body @param {AbortSignal} [signal] @returns {Promise<Response>} */
  post(path, body, signal) {
    return this.request(path, { method: 'POST', body: JSON.stringify(body), signal,
      headers: { 'Content-Type': 'application/json' } });
  }
}

const STYLE = `
:host { display: block; position: relative; }
.view { position: absolute; inset: 0; overflow: hidden; outline: none; touch-action: none; cursor: grab;
  background: #000; user-select: none; -webkit-user-select: none; }
.view:active { cursor: grabbing; }
.view:focus-visible { box-shadow: inset 0 0 0 2px #6aa8ff; }
canvas { position: absolute; inset: 0; width: 100%; height: 100%; display: block; }
canvas.plain { object-fit: contain; }
canvas.overlay { pointer-events: none; }
canvas.axes { inset: auto auto 0 0; width: ${AXES_PX}px; height: ${AXES_PX}px; }
canvas.scale-bar { inset: auto 20px 20px auto; width: ${SCALE_BAR_PX + 24}px; height: 38px; }
canvas[hidden] { display: none; }
.notice { position: absolute; left: 50%; bottom: 26px; transform: translateX(-50%); box-sizing: border-box;
  width: max-content; max-width: min(620px, calc(100% - 32px)); padding: 10px 16px; border-radius: 10px;
  font: 14px/1.45 system-ui, sans-serif; color: #e6ecf5; background: rgba(22, 28, 38, .92);
  border: 1px solid rgba(255, 255, 255, .14); box-shadow: 0 8px 30px rgba(0, 0, 0, .35);
  user-select: text; -webkit-user-select: text; cursor: auto; white-space: pre-line; }
.notice[hidden] { display: none; }
.notice.error { border-color: #ff7b72; }
.notice.error::before { content: ''; display: inline-block; width: 8px; height: 8px; margin-right: 10px;
  border-radius: 50%; background: #ff7b72; }
.notice.busy::before { content: ''; display: inline-block; width: 10px; height: 10px; margin-right: 10px;
  border-radius: 50%; border: 2px solid #6aa8ff; border-right-color: transparent; box-sizing: border-box;
  animation: spin .8s linear infinite; vertical-align: -1px; }
@keyframes spin { to { transform: rotate(360deg); } }
@media (prefers-reduced-motion: reduce) { .notice.busy::before { animation: none; } }
.speech { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); }
.cross { position: absolute; left: 50%; top: 50%; width: 17px; height: 17px; transform: translate(-50%, -50%);
  pointer-events: none; display: none; filter: drop-shadow(0 0 1px #000); background:
  linear-gradient(#fff, #fff) center / 100% 1px no-repeat, linear-gradient(#fff, #fff) center / 1px 100% no-repeat; }
.view:focus-visible > .cross { display: block; }
`;

/** So many warps are timed; if they take longer than this in the middle, WebGL is left. */
const MEASURED_WARPS = 7;
/** States of a pointer that moves are sent at once if the last one is so old, else in the next animation frame. */
const SEND_EVERY_MS = 8;
const SLOW_WARP_MS = 25;
/** A press that moves less than this is a click, in CSS pixels. */
const CLICK_PX = 4;
const CODES = ['OK', 'CANCELLED', 'UNKNOWN', 'INVALID_ARGUMENT', 'DEADLINE_EXCEEDED', 'NOT_FOUND', 'ALREADY_EXISTS',
  'PERMISSION_DENIED', 'RESOURCE_EXHAUSTED', 'FAILED_PRECONDITION', 'ABORTED', 'OUT_OF_RANGE', 'UNIMPLEMENTED',
  'INTERNAL', 'UNAVAILABLE', 'DATA_LOSS', 'UNAUTHENTICATED'];

/**
 * @typedef {object} Transport A way to the server besides the gateway's WebSocket.
 * @property {string} name
 * @property {(receive: (message: ArrayBuffer) => void) => void} open
 * @property {(text: string) => void} send
 * @property {() => void} close
 *
 * @typedef {object} Options
 * @property {string} [url] address of the gateway; default: the page's own folder
 * @property {string} [token] where the gateway asks for one
 * @property {FrameRequest} [state] what to show, as setState takes it; default: nothing until that is called
 * @property {'auto' | 'webgl2' | 'bitmaprenderer'} [renderer] default: auto, WebGL2 with a GPU
 * @property {number} [targetFramesPerSecond] 1 to 120, default 30
 * @property {number} [maxSide] the largest side of a picture in pixels; default 2048
 * @property {boolean} [axes] @property {boolean} [scaleBar] default: both shown
 * @property {boolean} [box] default: not shown
 * @property {'always' | 'focused'} [wheel] when the wheel zooms; default: always
 * @property {string} [label] what the view is, for screen readers
 * @property {(sentence: string) => void} [announce] takes what screen readers should say; default: the view has a live
 *   region of its own
 * @property {Transport} [transport] used where the gateway cannot be reached
 */

/**
 * A picture that a pointer moves. Events (`detail`): 'frame' {header, isExact, width, height, decodeMs,
 * roundTripMs, latencyMs}; 'state' {state, isMoving} when state or camera changed; 'click' {x, y, width, height} in
 * pixels of the picture, of the pointer, or of the middle when Enter was pressed;
 * 'status' {kind: 'connecting' | 'open' | 'closed', sentence}; 'notice' {sentence, isError}; 'dataset'.
 */
export class View extends EventTarget {
  /** @param {HTMLElement} element @param {Options} [options] */
  constructor(element, options = {}) {
    super();
    this.options = options;
    this.client = new Client(options.url, options.token);
    this.element = element;
    /** @type {FrameRequest} */
    this.state = {};
    /** @type {Camera | null} */
    this.camera = null;
    /** @type {DatasetJson | null} */
    this.dataset = null;
    /** @type {{position: Vec3, label?: string}[]} */
    this.pins = [];
    this.decorations = { axes: options.axes ?? true, scaleBar: options.scaleBar ?? true, box: options.box ?? false };
    /** @type {ShownFrame | null} */
    this.frame = null;
    /** @type {{grid: DepthGrid, camera: Camera, scene: string} | null} */
    this.lastGrid = null;
    this.isDestroyed = false;

    // State of the connection.
    this.isOpen = false;
    this.wasOpen = false;
    this.attempt = 0;
    this.isByTransport = false;
    this.generation = 0;
    this.sequence = 0;
    // By sequence number. `causedAt` is the time of the newest input in the state; without input,
    // the time of its sending.
    /** @type {Map<number, {scene: string, sentAt: number, causedAt: number, isByInput: boolean, isAnswered: boolean,
     *   isShown: boolean}>} */
    this.sent = new Map();
    /** Responses from this state on have the camera that the server chose; 0: none is awaited. */
    this.cameraFrom = 0;
    this.hasState = false;
    this.isDirty = false;
    this.lastSentAt = 0;
    // Time of the first move since the last animation frame.
    /** @type {number | null} */
    this.answeredAt = null;
    // Time of the newest input without a sent state.
    /** @type {number | null} */
    this.inputAt = null;
    // Latency of the frame on the screen: from its own input, or its own sending, to its display.
    /** @type {number | null} */
    this.shownLatencyMs = null;
    /** The sentence of the lost connection, until there is one again. */
    this.lost = '';
    this.errorSequence = -1;
    /** @type {Record<string, ReturnType<typeof setTimeout> | undefined>} */
    this.timers = {};
    this.animation = 0;
    /** @type {any} */
    this.arrived = null;

    this.background = '';
    this.counts = { framesShown: 0, exactShown: 0, framesDropped: 0, warpsDrawn: 0, bytesReceived: 0,
      bitmapsMade: 0, bitmapsClosed: 0, reconnects: 0, statesSent: 0 };
    this.latency = new Samples();
    this.roundTrip = new Samples();
    this.decode = new Samples();
    this.localResponse = new Samples();
    /** @type {number[]} */
    this.shownTimes = [];

    this.width = 1;
    this.height = 1;
    this.ratio = 0;
    this.cssWidth = 0;
    this.cssHeight = 0;
    this.shownSequence = 0;
    /** @type {number[]} */
    this.warpTimes = [];
    this.host = document.createElement('div');
    this.root = document.createElement('div');
    this.overlay = makeCanvas('overlay');
    // Small canvases of their own: anything drawn over the whole picture is composited with it
    // again at each change.
    this.axes = makeCanvas('overlay axes');
    this.scaleBar = makeCanvas('overlay scale-bar');
    // The content of each canvas, so that it is drawn only when that changes.
    /** @type {Map<HTMLCanvasElement, string>} */
    this.drawn = new Map();
    this.noticeElement = document.createElement('div');
    this.speech = document.createElement('div');
    this.cross = document.createElement('div');
    const announcer = new Announcer((sentence) => { this.speech.textContent = sentence; });
    /** @type {(sentence: string) => void} */
    this.announce = options.announce ?? ((sentence) => announcer.say(sentence));
    this.unwatch = watchTab(() => this.#schedule());
    /** @type {Screen} */
    this.screen = this.#makeScreen();
    this.#build();
    this.worker = startWorker((message) => this.#receive(message));
    this.resizer = new ResizeObserver(() => this.#resize());
    this.resizer.observe(this.root);
    this.#resize();
    if (options.state) {
      this.setState(options.state);
    }
    this.#connect();
  }

  // ---- what others call ----

  /** What is shown: a RenderIsosurfaceRequest as JSON, with the camera of the pointer. */
  getState() {
    const state = structuredClone(this.state);
    // Until the server has chosen a camera, the state has the inputs of its choice.
    if (this.camera && !this.cameraFrom) {
      state.camera = cameraToJson(this.camera);
    }
    return state;
  }

  /**
   * Replaces the state. Without a camera, the server chooses one. `isMoving`: more states follow,
   * as from a slider; quick frames come first.
   * @param {FrameRequest} state @param {{isMoving?: boolean}} [how]
   */
  setState(state, how = {}) {
    const isMoving = how.isMoving ?? false;
    const { viewport, output, ...rest } = structuredClone(state);
    for (const key of Object.keys(rest)) {
      if (rest[key] === undefined || rest[key] === null) {
        delete rest[key];
      }
    }
    const isOther = (rest.dataset ?? '') !== (this.state.dataset ?? '');
    this.state = rest;
    this.hasState = true;
    const camera = cameraFromJson(rest.camera);
    if (rest.camera && !camera) {
      this.#problem('The camera of this view is no camera: the default one is used.');
      delete rest.camera;
    }
    const isFitted = rest.cameraFit === 'CAMERA_FIT_SURFACE';
    if (camera && !isFitted) {
      this.camera = camera;
      this.cameraFrom = 0;
    } else {
      // The server's answer to this state, or a newer one, has the camera.
      this.cameraFrom = this.sequence + 1;
    }
    if (isOther || !this.dataset) {
      this.dataset = null;
      this.#describe();
    }
    this.inputAt = performance.now();
    this.#change(isMoving, null);
  }

  /**
   * Changes parts of the state; the camera stays, unless it is given. Null and undefined remove a
   * part.
   * @param {FrameRequest} part @param {{isMoving?: boolean}} [how]
   */
  update(part, how) {
    this.setState({ ...this.getState(), ...part }, how);
  }

  /** @param {Camera} camera */
  setCamera(camera) {
    this.#move(camera, performance.now());
  }

  /**
   * Views the surface from a side, as large as it fits: 'front' ... 'inferior'.
   * @param {string} name @returns {boolean} false if the dataset has no such side, or is not known yet
   */
  lookFrom(name) {
    const box = boxOfDataset(this.dataset);
    const camera = box && namedCamera(name, box, this.dataset?.patientFrame);
    if (!camera) {
      return false;
    }
    this.update({ camera: cameraToJson(camera), cameraFit: 'CAMERA_FIT_SURFACE' });
    return true;
  }

  /** Lets the server choose the camera again. */
  reset() {
    this.update({ camera: undefined, cameraFit: 'CAMERA_FIT_SURFACE' });
  }

  /** @param {{axes?: boolean, scaleBar?: boolean, box?: boolean}} decorations */
  decorate(decorations) {
    Object.assign(this.decorations, decorations);
    this.#schedule();
  }

  /**
   * Marks points of the scene.
   * @param {{position: Vec3, label?: string}[]} pins
   */
  setPins(pins) {
    this.pins = pins;
    this.#schedule();
  }

  /** Whether the exact frame of the current state is on the screen. */
  get isExact() {
    return this.frame !== null && this.frame.isExact && !this.isDirty && this.shownSequence === this.sequence;
  }

  /**
   * Figures for users and tests; times in milliseconds. `shownLatencyMs` is that of the frame on
   * the screen, `latencyMs` that of the last frames that an input caused.
   */
  stats() {
    const now = performance.now();
    return {
      ...this.counts,
      bitmapsOpen: this.counts.bitmapsMade - this.counts.bitmapsClosed,
      framesPerSecond: this.shownTimes.filter((time) => now - time < 1000).length,
      shownLatencyMs: this.shownLatencyMs,
      latencyMs: this.latency.summary(),
      localResponseMs: this.localResponse.summary(),
      roundTripMs: this.roundTrip.summary(),
      decodeMs: this.decode.summary(),
      isExact: this.isExact,
      isConnected: this.isOpen,
      transport: this.isByTransport ? this.options.transport?.name ?? '' : 'gateway',
      renderer: this.screen.name,
      isInWorker: this.worker.isWorker,
      width: this.frame?.width ?? 0,
      height: this.frame?.height ?? 0,
      notice: this.noticeElement.hidden ? '' : this.noticeElement.textContent ?? '',
    };
  }

  /** Ends the connection, frees all pictures and removes the view from its element. */
  destroy() {
    this.isDestroyed = true;
    Object.values(this.timers).forEach((timer) => clearTimeout(timer));
    cancelAnimationFrame(this.animation);
    this.resizer.disconnect();
    this.unwatch();
    this.#closeArrived();
    this.options.transport?.close();
    this.worker.stop();
    this.screen.destroy();
    this.host.remove();
  }

  // ---- elements ----

  #makeScreen() {
    const renderer = this.options.renderer ?? 'auto';
    const isGl = renderer === 'webgl2' || renderer === 'auto' && hasFastWebGl();
    return (isGl ? makeGlScreen((why) => this.#leaveGl(why)) : null) ?? makeBitmapScreen();
  }

  #build() {
    this.host.className = 'isoscope-view';
    this.host.style.position = 'absolute';
    this.host.style.inset = '0';
    if (getComputedStyle(this.element).position === 'static') {
      this.element.style.position = 'relative';
    }
    const shadow = this.host.attachShadow({ mode: 'open' });
    // Unlike a style element, this needs no permission of the page's content security policy.
    const sheet = new CSSStyleSheet();
    sheet.replaceSync(STYLE);
    shadow.adoptedStyleSheets = [sheet];
    this.root.className = 'view';
    this.root.tabIndex = 0;
    this.root.setAttribute('role', 'application');
    this.root.setAttribute('aria-label', this.options.label ?? 'Isosurface. Arrow keys turn it, plus and minus ' +
      'zoom, with Shift arrow keys move it, 0 shows all of it, Enter picks the point in the middle.');
    // It changes with each attempt to connect; `announce` gets the important changes.
    this.noticeElement.className = 'notice';
    this.noticeElement.hidden = true;
    this.speech.className = 'speech';
    this.cross.className = 'cross';
    shadow.append(this.root);
    if (!this.options.announce) {
      this.speech.setAttribute('role', 'status');
      shadow.append(this.speech);
    }
    this.root.append(this.overlay, this.axes, this.scaleBar, this.cross, this.noticeElement);
    this.element.append(this.host);
    this.root.prepend(this.screen.canvas);
    this.#listen();
  }

  /**
   * Some drivers emulate WebGL without reporting it, so the first warps are timed.
   * @param {number} startedAt
   */
  #measureWarp(startedAt) {
    if ((this.options.renderer ?? 'auto') !== 'auto' || this.warpTimes.length >= MEASURED_WARPS) {
      return;
    }
    this.screen.finish();
    this.warpTimes.push(performance.now() - startedAt);
    const middle = [...this.warpTimes].sort((a, b) => a - b)[MEASURED_WARPS >> 1];
    if (this.warpTimes.length === MEASURED_WARPS && middle > SLOW_WARP_MS) {
      this.#leaveGl(`a warp takes ${Math.round(middle)} ms`);
    }
  }

  /** @param {string} why */
  #leaveGl(why) {
    if (this.isDestroyed || this.screen.name !== 'webgl2') {
      return;
    }
    console.warn(`isoscope: goes on without WebGL: ${why}`);
    this.screen.canvas.remove();
    this.screen = makeBitmapScreen();
    this.root.prepend(this.screen.canvas);
    this.#change(false, null);
  }

  #resize() {
    const ratio = globalThis.devicePixelRatio || 1;
    const { clientWidth, clientHeight } = this.root;
    const limit = this.options.maxSide ?? 2048;
    const shrink = Math.min(1, limit / (Math.max(clientWidth, clientHeight, 1) * ratio));
    const width = Math.max(1, Math.round(clientWidth * ratio * shrink));
    const height = Math.max(1, Math.round(clientHeight * ratio * shrink));
    if (this.width === width && this.height === height && this.ratio === ratio && this.cssWidth === clientWidth &&
        this.cssHeight === clientHeight) {
      return;
    }
    this.width = width;
    this.height = height;
    this.ratio = ratio;
    [this.cssWidth, this.cssHeight] = [clientWidth, clientHeight];
    this.screen.resize(width, height);
    this.drawn.clear();
    this.#change(true, null);
    this.#draw();
  }

  // ---- pointer and keys ----

  /**
   * Returns the point of the scene under a point of the view; at the target's distance if there is
   * none.
   * @param {number} x @param {number} y of the view, -1 to 1, y up
   */
  #pointAt(x, y) {
    const camera = /** @type {Camera} */ (this.camera);
    const { frame } = this;
    const aspect = this.aspect;
    if (frame?.grid && isSameCamera(frame.camera, camera)) {
      const i = Math.floor((x * aspect * frame.height / frame.width + 1) / 2 * frame.grid.width);
      const j = Math.floor((1 - y) / 2 * frame.grid.height);
      const depth = gridDepth(frame.grid, i, j);
      if (depth > 0) {
        return unproject(camera, aspect, x, y, depth);
      }
    }
    return unproject(camera, aspect, x, y, basisOf(camera).distance);
  }

  get aspect() {
    return this.width / this.height;
  }

  #listen() {
    const { root } = this;
    /** @type {Map<number, {x: number, y: number}>} */
    const pointers = new Map();
    /** @type {{x: number, y: number, time: number, button: number} | null} */
    let press = null;
    let panDistance = 1;
    /** @param {{clientX: number, clientY: number}} event */
    const place = (event) => {
      const box = root.getBoundingClientRect();
      return { x: event.clientX - box.left, y: event.clientY - box.top };
    };
    /** @param {{x: number, y: number}} p @returns {[number, number]} */
    const toView = (p) => [2 * p.x / root.clientWidth - 1, 1 - 2 * p.y / root.clientHeight];
    /** @param {number} pixels */
    const toHalves = (pixels) => 2 * pixels / Math.max(1, root.clientHeight);
    /** @param {{x: number, y: number}} p */
    const grab = (p) => {
      if (this.camera) {
        panDistance = dot(sub(this.#pointAt(...toView(p)), this.camera.eye), basisOf(this.camera).forward);
      }
    };

    root.addEventListener('pointerdown', (event) => {
      try {
        root.setPointerCapture(event.pointerId);
      } catch {
        // The pointer is released already.
      }
      root.focus({ preventScroll: true });
      const p = place(event);
      pointers.set(event.pointerId, p);
      press = pointers.size === 1 ? { ...p, time: event.timeStamp, button: event.button } : null;
      grab(p);
      event.preventDefault();
    });
    root.addEventListener('pointermove', (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) {
        return;
      }
      const p = place(event);
      const others = [...pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      if (press && Math.hypot(p.x - press.x, p.y - press.y) < CLICK_PX) {
        return;
      }
      press = null;
      pointers.set(event.pointerId, p);
      const { camera } = this;
      if (!camera) {
        return;
      }
      const dx = toHalves(p.x - before.x);
      const dy = -toHalves(p.y - before.y);
      if (others.length === 1) {
        // Both fingers keep their points: their middle pans, their distance zooms, their angle
        // rolls.
        const [other] = others;
        const old = { x: before.x - other.x, y: before.y - other.y };
        const now = { x: p.x - other.x, y: p.y - other.y };
        const middle = { x: (p.x + other.x) / 2, y: (p.y + other.y) / 2 };
        const factor = Math.hypot(now.x, now.y) / Math.max(1, Math.hypot(old.x, old.y));
        const angle = Math.atan2(old.x * now.y - old.y * now.x, old.x * now.x + old.y * now.y);
        let moved = pan(camera, dx / 2, dy / 2, panDistance);
        moved = this.#zoomed(moved, factor, unproject(moved, this.aspect, ...toView(middle), panDistance));
        this.#move(turn(moved, 0, 0, angle), event.timeStamp);
      } else if (event.ctrlKey || event.metaKey) {
        this.#move(this.#zoomed(camera, Math.exp(dy * 1.5), camera.target), event.timeStamp);
      } else if (event.buttons & 6 || event.shiftKey) {
        this.#move(pan(camera, dx, dy, panDistance), event.timeStamp);
      } else {
        this.#move(turn(camera, dx, dy), event.timeStamp);
      }
    });
    /** @param {PointerEvent} event */
    const release = (event) => {
      if (!pointers.delete(event.pointerId)) {
        return;
      }
      if (press && press.button === 0 && event.type === 'pointerup' && event.timeStamp - press.time < 500) {
        this.#click(press.x / root.clientWidth, press.y / root.clientHeight);
      }
      press = null;
    };
    root.addEventListener('pointerup', release);
    root.addEventListener('pointercancel', release);
    root.addEventListener('contextmenu', (event) => event.preventDefault());
    root.addEventListener('dblclick', (event) => {
      if (this.camera) {
        const move = sub(this.#pointAt(...toView(place(event))), this.camera.target);
        this.#move({ ...this.camera, eye: add(this.camera.eye, move), target: add(this.camera.target, move) },
          event.timeStamp);
      }
    });
    root.addEventListener('wheel', (event) => {
      const isFocused = this.host?.shadowRoot?.activeElement === root;
      if (this.options.wheel === 'focused' && !isFocused) {
        return;
      }
      event.preventDefault();
      if (this.camera) {
        const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
        const factor = Math.exp(-Math.max(-240, Math.min(240, event.deltaY * lines)) * 0.0016);
        this.#move(this.#zoomed(this.camera, factor, this.#pointAt(...toView(place(event)))), event.timeStamp);
      }
    }, { passive: false });
    root.addEventListener('keydown', (event) => this.#key(event));
  }

  /** @param {Camera} camera @param {number} factor @param {Vec3} point */
  #zoomed(camera, factor, point) {
    const zoomed = zoomTo(camera, factor, point);
    const box = boxOfDataset(this.dataset);
    const size = box ? length(sub(box.max, box.min)) : basisOf(camera).distance;
    const reach = zoomed.height > 0 ? zoomed.height : basisOf(zoomed).distance;
    return reach > size * 1e-4 && reach < size * 100 ? zoomed : camera;
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    const { camera } = this;
    if (!camera || event.altKey || event.ctrlKey || event.metaKey) {
      return;
    }
    const step = 5 / 90;
    /** @type {Record<string, [number, number]>} */
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const arrow = arrows[event.key];
    const views = this.dataset?.patientFrame ? PATIENT_VIEWS : WORLD_VIEWS;
    if (arrow && event.shiftKey) {
      this.#move(pan(camera, arrow[0] * 0.1, arrow[1] * 0.1, basisOf(camera).distance), event.timeStamp);
    } else if (arrow) {
      this.#move(turn(camera, arrow[0] * step, arrow[1] * step), event.timeStamp);
    } else if (event.key === ',' || event.key === '.') {
      this.#move(turn(camera, 0, 0, (event.key === ',' ? 5 : -5) * Math.PI / 180), event.timeStamp);
    } else if (event.key === '+' || event.key === '=' || event.key === '-') {
      this.#move(this.#zoomed(camera, event.key === '-' ? 1 / 1.15 : 1.15, camera.target), event.timeStamp);
    } else if (event.key === '0' || event.key === 'Home') {
      this.reset();
    } else if (event.key >= '1' && event.key <= '6') {
      this.lookFrom(views[Number(event.key) - 1]);
    } else if (event.key === 'p') {
      const { distance } = basisOf(camera);
      const height = camera.height > 0 ? 0 : 2 * spanAt({ ...camera, height: 0 }, distance);
      this.#move({ ...camera, height }, event.timeStamp);
    } else if (event.key === 'b') {
      this.decorate({ box: !this.decorations.box });
    } else if (event.key === 'Enter' && !event.repeat) {
      this.#click(0.5, 0.5);
    } else {
      return;
    }
    event.preventDefault();
  }

  /** @param {number} u @param {number} v from the top left, 0 to 1 */
  #click(u, v) {
    const { width, height } = this;
    const detail = { x: Math.min(width - 1, Math.floor(u * width)), y: Math.min(height - 1, Math.floor(v * height)),
      width, height };
    this.dispatchEvent(new CustomEvent('click', { detail }));
  }

  // ---- state to the server ----

  /** @param {Camera} camera @param {number} time of the event */
  #move(camera, time) {
    this.camera = camera;
    this.cameraFrom = 0;
    delete this.state.cameraFit;
    this.#change(true, time);
  }

  /** @param {boolean} isMoving @param {number | null} time of the event */
  #change(isMoving, time) {
    this.isDirty = true;
    this.inputAt = time ?? this.inputAt;
    this.answeredAt ??= time;
    // The server begins at once; a state that comes before the last picture is shown waits for the
    // next one.
    if (time !== null && performance.now() - this.lastSentAt >= SEND_EVERY_MS) {
      this.#send();
    }
    this.#schedule();
    this.dispatchEvent(new CustomEvent('state', { detail: { state: this.getState(), isMoving } }));
  }

  #send() {
    if (!this.isOpen || !this.isDirty || !this.hasState || document.hidden) {
      return;
    }
    this.isDirty = false;
    const now = performance.now();
    this.lastSentAt = now;
    this.sequence += 1;
    const frame = this.getState();
    frame.viewport = { widthPx: this.width, heightPx: this.height };
    // Never at rest. The server sends the exact frame by itself 120 ms after the last state. The
    // quick frame before it has the depths that the next move needs.
    const viewState = { sequenceNumber: String(this.sequence), frame,
      targetFramesPerSecond: this.options.targetFramesPerSecond ?? 30 };
    const scene = JSON.stringify({ ...frame, camera: null, viewport: null });
    this.sent.set(this.sequence, { scene, sentAt: performance.timeOrigin + now, causedAt: this.inputAt ?? now,
      isByInput: this.inputAt !== null, isAnswered: false, isShown: false });
    for (const number of this.sent.keys()) {
      if (number < this.sequence - 256) {
        this.sent.delete(number);
      }
    }
    this.inputAt = null;
    this.counts.statesSent += 1;
    this.worker.post({ kind: 'send', text: JSON.stringify({ viewState }) });
    clearTimeout(this.timers.slow);
    this.timers.slow = setTimeout(() => this.#sayWaiting(1), 1000);
  }

  /** @param {number} seconds */
  #sayWaiting(seconds) {
    if (this.isOpen && this.noticeElement.hidden) {
      this.#notice('Drawing the picture …', 'busy');
    }
    if (this.isOpen && seconds === 1) {
      this.timers.slow = setTimeout(() => {
        const sentence = 'No picture for 10 s. The first one of a large dataset can take long; if none comes, see the ' +
          'log of isoscope-coordinator.';
        this.#notice(sentence, 'busy');
        this.announce(sentence);
      }, 9000);
    }
  }

  // ---- connection ----

  async #connect() {
    await untilShown();
    if (this.isDestroyed || this.isOpen) {
      return;
    }
    this.#status('connecting', '');
    if (this.options.transport && !this.options.url) {
      this.#useTransport(this.options.transport);
      return;
    }
    this.worker.post({ kind: 'open', url: this.client.socketAddress, protocols: this.client.socketProtocols });
    clearTimeout(this.timers.open);
    this.timers.open = setTimeout(() => {
      if (this.isOpen || this.isDestroyed) {
        return;
      }
      if (this.options.transport && !this.wasOpen) {
        this.#useTransport(this.options.transport);
      } else {
        this.#notice(`Connecting to ${this.client.base.host} …`, 'busy');
      }
    }, 2000);
  }

  /** @param {Transport} transport */
  #useTransport(transport) {
    this.worker.post({ kind: 'close' });
    this.isByTransport = true;
    transport.open((buffer) => this.worker.post({ kind: 'data', buffer }, [buffer]));
    this.#opened(this.generation);
  }

  /** @param {number} generation */
  #opened(generation) {
    clearTimeout(this.timers.open);
    if (this.wasOpen) {
      this.counts.reconnects += 1;
    }
    // A connection that soon ends again is retried at increasing intervals.
    clearTimeout(this.timers.steady);
    this.timers.steady = setTimeout(() => { this.attempt = 0; }, 5000);
    this.isOpen = true;
    this.wasOpen = true;
    this.generation = generation;
    this.sent.clear();
    this.#notice('', '');
    if (this.lost) {
      this.lost = '';
      this.announce('Connected again.');
    }
    this.#status('open', '');
    if (!this.dataset) {
      this.#describe();
    }
    this.#change(false, null);
  }

  /** @param {number} code @param {string} reason */
  #closed(code, reason) {
    if (this.isByTransport || this.isDestroyed) {
      return;
    }
    if (this.options.transport && !this.wasOpen) {
      this.#useTransport(this.options.transport);
      return;
    }
    const wasOpen = this.isOpen;
    this.isOpen = false;
    this.isDirty = true;
    clearTimeout(this.timers.open);
    clearTimeout(this.timers.slow);
    clearTimeout(this.timers.steady);
    const seconds = Math.min(8, 0.5 * 2 ** this.attempt);
    this.attempt += 1;
    const what = reason ? `The connection ended: ${reason.replace(/\.*$/, '')}.`
      : wasOpen || this.wasOpen ? `The connection to ${this.client.base.host} was lost.`
        : `No connection to ${this.client.socketAddress}. Is isoscope-gateway (or \`isoscope ` +
          'view`) running there, and does a proxy in between pass WebSocket connections on?';
    const sentence = `${what} Trying again in ${seconds} s.`;
    this.#notice(sentence, 'error');
    if (!this.lost) {  // once, however often the connection is tried
      this.lost = what;
      this.announce(what);
    }
    this.#status('closed', sentence);
    if (!reason && !this.wasOpen) {
      this.#askWhy();
    }
    clearTimeout(this.timers.retry);
    this.timers.retry = setTimeout(() => this.#connect(), 1000 * seconds * (0.85 + 0.3 * Math.random()));
    void code;
  }

  /** A browser does not tell why a WebSocket was refused. The same gateway says over HTTP if the token is missing. */
  async #askWhy() {
    await untilShown();
    try {
      await this.client.requestOnce('v1/capabilities');
    } catch (error) {
      const { status, message } = /** @type {Error & {status?: number}} */ (error);
      if ((status === 401 || status === 403) && !this.isOpen && !this.isDestroyed) {
        this.#notice(message, 'error');
        this.announce(message);
      }
    }
  }

  /** @param {string} kind @param {string} sentence */
  #status(kind, sentence) {
    this.dispatchEvent(new CustomEvent('status', { detail: { kind, sentence } }));
  }

  /** @param {string} sentence @param {'' | 'busy' | 'error'} kind */
  #notice(sentence, kind) {
    if (sentence === '' && this.noticeElement.hidden) {
      return;
    }
    this.noticeElement.textContent = sentence;
    this.noticeElement.className = `notice ${kind}`;
    this.noticeElement.hidden = sentence === '';
    this.dispatchEvent(new CustomEvent('notice', { detail: { sentence, isError: kind === 'error' } }));
  }

  /**
   * Shows a problem, and announces it unless it is shown already.
   * @param {string} sentence
   */
  #problem(sentence) {
    if (this.noticeElement.hidden || this.noticeElement.textContent !== sentence) {
      this.announce(sentence);
    }
    this.#notice(sentence, 'error');
  }

  /** Learns the box and the patient frame of the dataset, for the box, the axes and the named views. */
  async #describe() {
    const name = this.state.dataset ?? '';
    if (this.options.transport && !this.options.url) {
      return;
    }
    try {
      const dataset = name ? await this.client.get(`v1/datasets/${encodeURIComponent(name)}`)
        : (await this.client.get('v1/datasets')).datasets?.[0];
      if (name === (this.state.dataset ?? '') && !this.isDestroyed && dataset) {
        this.dataset = dataset.dataset ?? dataset;
        this.dispatchEvent(new CustomEvent('dataset', { detail: this.dataset }));
        this.#schedule();
      }
    } catch {
      // The frame reports a problem of the dataset; a lost gateway is asked again once it is back.
    }
  }

  // ---- frames from the server ----

  /** @param {any} message of the worker */
  #receive(message) {
    if (message.kind === 'frame' && message.bitmap) {
      this.counts.bitmapsMade += 1;
    }
    if (this.isDestroyed) {
      message.bitmap?.close();
      return;
    }
    switch (message.kind) {
      case 'open': this.#opened(message.generation); break;
      case 'closed': this.#closed(message.code, message.reason); break;
      case 'outgoing':
        if (this.isByTransport) {
          this.options.transport?.send(message.text);
        }
        break;
      case 'dropped':
        this.counts.framesDropped += 1;
        this.counts.bytesReceived += message.bytes;
        break;
      case 'bad': this.#problem(`${message.sentence} Do server and page have the same version?`); break;
      case 'frame': this.#frame(message); break;
    }
  }

  /** @param {any} message */
  #frame(message) {
    const { header } = message;
    const sequence = Number(header.sequenceNumber ?? 0);
    this.counts.bytesReceived += message.bytes;
    this.decode.add(message.decodeMs);
    const sent = this.sent.get(sequence);
    if (sent && !sent.isAnswered) {  // the exact frame waits for rest besides
      sent.isAnswered = true;
      this.roundTrip.add(message.receivedAt - sent.sentAt);
    }
    if (header.error || !message.bitmap) {
      message.bitmap?.close();
      this.counts.bitmapsClosed += message.bitmap ? 1 : 0;
      this.#failed(header.error ?? { code: 13, message: 'the server sent a frame without a picture' }, sequence);
      this.#acknowledge(message);
      return;
    }
    if (!cameraFromJson(header.frame?.camera) && !this.camera) {
      this.#problem('The server sent a picture without the camera that it shows. Do server and page have the same ' +
        'version?');
    }
    this.#closeArrived();
    this.arrived = message;
    const grid = this.#gridOf(message);
    const camera = cameraFromJson(header.frame?.camera);
    if (grid && camera) {
      this.lastGrid = { grid, camera, scene: sent?.scene ?? '' };
    }
    this.#schedule();
  }

  /** @param {any} message @returns {DepthGrid | null} */
  #gridOf({ header, depths }) {
    return depths.length > 0 ? { width: header.depthGrid.width, height: header.depthGrid.height,
      near: Number(header.depthGrid.near ?? 0), far: Number(header.depthGrid.far ?? 0), values: depths } : null;
  }

  /** Drops a frame that was decoded and not shown, and says so. */
  #closeArrived() {
    if (this.arrived) {
      this.arrived.bitmap.close();
      this.counts.bitmapsClosed += 1;
      this.counts.framesDropped += 1;
      this.#acknowledge(this.arrived);
      this.arrived = null;
    }
  }

  /** @param {any} message */
  #acknowledge(message) {
    if (message.header.frameNumber) {
      this.worker.post({ kind: 'shown', generation: message.generation, frameNumber: message.header.frameNumber,
        decodeMs: message.decodeMs });
    }
  }

  /** @param {{code?: number, message?: string}} error @param {number} sequence */
  #failed(error, sequence) {
    clearTimeout(this.timers.slow);
    this.errorSequence = sequence;
    const text = (error.message ?? '').trim() || 'the server gives no reason';
    const sentence = text[0].toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? '' : '.');
    const code = Number(error.code ?? 2);
    // These errors are temporary: an agent restarts, a queue empties.
    const isPassing = [4, 8, 9, 14].includes(code);
    this.#problem(`${sentence} (${CODES[code] ?? code})${isPassing ? ' Trying again.' : ''}`);
    clearTimeout(this.timers.again);
    if (isPassing) {
      // A hidden tab sends it once it is shown.
      this.timers.again = setTimeout(() => this.#change(false, null), 2000);
    }
  }

  // ---- animation frames ----

  #schedule() {
    if (!this.animation && !this.isDestroyed) {
      this.animation = requestAnimationFrame(() => {
        this.animation = 0;
        this.#tick();
      });
    }
  }

  #tick() {
    const movedAt = this.answeredAt;
    this.answeredAt = null;
    // The state is sent first: the server works while this draws.
    this.#send();
    if (this.arrived) {
      this.#show();
    }
    this.#draw();
    if (movedAt !== null) {
      this.localResponse.add(performance.now() - movedAt);
    }
  }

  #show() {
    const message = this.arrived;
    this.arrived = null;
    const { header, bitmap } = message;
    const sequence = Number(header.sequenceNumber ?? 0);
    const camera = cameraFromJson(header.frame?.camera) ?? this.camera;
    if (camera && (!this.camera || this.cameraFrom && sequence >= this.cameraFrom)) {
      this.camera = camera;
      this.cameraFrom = 0;
      const isFitted = this.state.cameraFit === 'CAMERA_FIT_SURFACE';
      delete this.state.cameraFit;
      if (isFitted) {
        this.#fill(camera, this.#gridOf(message) ?? this.#gridOfPicture(camera, bitmap), bitmap.width / bitmap.height);
      }
      this.dispatchEvent(new CustomEvent('state', { detail: { state: this.getState(), isMoving: false } }));
    }
    const scene = this.sent.get(sequence)?.scene ?? '';
    let grid = this.#gridOf(message);
    const last = this.lastGrid;
    if (!grid && camera && last && scene !== '' && scene === last.scene && isSameCamera(camera, last.camera)) {
      // The exact frame may have no depths: those of the quick one before it are the same.
      grid = last.grid;
    }
    const isExact = header.isExact === true;
    const { red = 0, green = 0, blue = 0 } = this.state.backgroundColor ?? {};
    const { width, height } = bitmap;
    if (camera) {
      this.frame = { width, height, camera, grid, isExact, background: [red, green, blue] };
      this.screen.show(bitmap, this.frame);
    } else {
      bitmap.close();
    }
    this.counts.bitmapsClosed += 1;
    this.counts.framesShown += 1;
    this.counts.exactShown += isExact ? 1 : 0;
    this.shownSequence = sequence;
    const now = performance.now();
    this.shownTimes = [...this.shownTimes.filter((time) => now - time < 1000), now];
    const sent = this.sent.get(sequence);
    this.shownLatencyMs = sent ? now - sent.causedAt : null;
    if (sent?.isByInput && !sent.isShown) {
      this.latency.add(now - sent.causedAt);
    }
    if (sent) {
      sent.isShown = true;
    }
    this.#acknowledge(message);
    if (sequence > this.errorSequence || isExact) {
      clearTimeout(this.timers.slow);
      this.#notice('', '');
    }
    const background = `rgb(${[red, green, blue].map((c) => Math.round(255 * c)).join(' ')})`;
    if (background !== this.background) {
      this.background = background;
      this.root.style.background = background;
    }
    this.dispatchEvent(new CustomEvent('frame', { detail: { header, isExact, width, height, decodeMs: message.decodeMs,
      roundTripMs: sent ? message.receivedAt - sent.sentAt : null, latencyMs: this.shownLatencyMs } }));
  }

  /** @param {Camera} camera @param {DepthGrid} grid @param {number} aspect */
  #fill(camera, grid, aspect) {
    const filled = fillView(camera, grid, aspect);
    if (!isSameCamera(filled, camera)) {
      this.camera = filled;
      this.#change(false, null);
    }
  }

  /**
   * For a frame without depths: pixels that differ from the background get the target's distance.
   * @param {Camera} camera @param {ImageBitmap} bitmap @returns {DepthGrid}
   */
  #gridOfPicture(camera, bitmap) {
    const canvas = document.createElement('canvas');
    canvas.width = 128;
    canvas.height = Math.max(1, Math.round(128 * bitmap.height / bitmap.width));
    const { width, height } = canvas;
    const values = new Uint16Array(width * height).fill(65535);
    const context = canvas.getContext('2d');
    if (context) {
      context.drawImage(bitmap, 0, 0, width, height);
      const { data } = context.getImageData(0, 0, width, height);
      const { red = 0, green = 0, blue = 0 } = this.state.backgroundColor ?? {};
      const background = [red, green, blue].map((channel) => 255 * channel);
      for (let i = 0; i < values.length; ++i) {
        if (background.some((channel, k) => Math.abs(data[4 * i + k] - channel) > 8)) {
          values[i] = 0;
        }
      }
    }
    const { distance } = basisOf(camera);
    return { width, height, near: distance, far: distance, values };
  }

  #draw() {
    if (!this.camera) {
      return;
    }
    const startedAt = performance.now();
    if (this.screen.draw(this.camera)) {
      this.counts.warpsDrawn += 1;
      this.#measureWarp(startedAt);
    }
    this.#drawDecorations();
  }

  #drawDecorations() {
    // An unwarped picture is late, and its overlay must be equally late.
    const camera = this.screen.isWarping ? this.camera : this.frame?.camera ?? this.camera;
    if (!camera || this.cssWidth === 0 || this.cssHeight === 0) {
      return;
    }
    const { red = 0, green = 0, blue = 0 } = this.state.backgroundColor ?? {};
    const isLight = 0.3 * red + 0.59 * green + 0.11 * blue > 0.55;
    const ink = isLight ? '#1b2430' : '#e8eef7';
    const halo = isLight ? 'rgba(255,255,255,.75)' : 'rgba(0,0,0,.6)';
    const { cssWidth, cssHeight, decorations, pins } = this;
    const clip = this.state.clip?.box;
    const patientFrame = this.dataset?.patientFrame ?? '';
    const bar = scaleBarOf(camera, cssWidth, cssHeight);
    bar.text += ` ${lengthUnitOf(this.dataset)}`.trimEnd();
    /** @type {Scene} */
    const scene = { camera, frame: this.frame, box: boxOfDataset(this.dataset),
      clipBox: clip ? { min: vecFromJson(clip.min), max: vecFromJson(clip.max) } : null, patientFrame, pins, ink, halo,
      showBox: decorations.box };
    this.#drawOn(this.axes, AXES_PX, AXES_PX, decorations.axes ? [sub(camera.target, camera.eye), camera.up, patientFrame, ink] : null,
      (context) => drawAxes(context, scene));
    this.#drawOn(this.scaleBar, SCALE_BAR_PX + 24, 38, decorations.scaleBar ? [bar.px.toFixed(1), bar.text, ink] : null,
      (context) => drawScaleBar(context, bar, scene));
    this.#drawOn(this.overlay, cssWidth, cssHeight, decorations.box || pins.length > 0
      ? [camera, this.counts.framesShown, scene.box, scene.clipBox, pins, decorations.box, ink] : null,
    (context) => drawOverlay(context, cssWidth, cssHeight, scene));
  }

  /**
   * Draws on a canvas if its content has changed; hides it if there is none (null).
   * @param {HTMLCanvasElement} canvas @param {number} width @param {number} height in CSS pixels
   * @param {any[] | null} what @param {(context: CanvasRenderingContext2D) => void} draw
   */
  #drawOn(canvas, width, height, what, draw) {
    const words = JSON.stringify(what);
    if (this.drawn.get(canvas) === words) {
      return;
    }
    this.drawn.set(canvas, words);
    // A hidden canvas holds no pixels.
    const [across, down] = what === null ? [0, 0] : [Math.round(width * this.ratio), Math.round(height * this.ratio)];
    if (canvas.width !== across || canvas.height !== down) {
      canvas.width = across;
      canvas.height = down;
    }
    canvas.hidden = what === null;
    const context = what === null ? null : canvas.getContext('2d');
    if (context) {
      context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      draw(context);
    }
  }
}

/**
 * Shows a view in an element, which must have a height.
 * @param {HTMLElement} element @param {Options} [options] @returns {View}
 */
export function mount(element, options) {
  return new View(element, options);
}

// ---- anywidget ----

/**
 * @typedef {{get: (name: string) => any, set: (name: string, value: any) => void, save_changes: () => void,
 *   on: (event: string, handler: (...args: any[]) => void) => void,
 *   off: (event: string, handler: (...args: any[]) => void) => void,
 *   send: (message: any) => void}} Model
 */

/**
 * Frames through the kernel of a notebook: {type: 'isoscope/interact', text} there, {type:
 * 'isoscope/frame'} with one buffer back, with the content of the WebSocket's messages.
 * @param {Model} model @returns {Transport}
 */
function kernelTransport(model) {
  /** @type {((message: any, buffers: any[]) => void) | null} */
  let handler = null;
  return {
    name: 'kernel',
    open(receive) {
      handler = (message, buffers) => {
        if (message?.type === 'isoscope/frame' && buffers?.length > 0) {
          const view = buffers[0];
          receive(view instanceof ArrayBuffer ? view
            : view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength));
        }
      };
      model.on('msg:custom', handler);
      model.send({ type: 'isoscope/open' });
    },
    send(text) { model.send({ type: 'isoscope/interact', text }); },
    close() {
      if (handler) {
        model.off('msg:custom', handler);
        model.send({ type: 'isoscope/close' });
        handler = null;
      }
    },
  };
}

/**
 * The module that anywidget loads. Traits: `url`, `token`, `state` (both ways), `height` (CSS), `stats`
 * and `picked` (from here).
 */
export default {
  /** @param {{model: Model, el: HTMLElement}} context */
  render({ model, el }) {
    const box = document.createElement('div');
    box.style.height = typeof model.get('height') === 'number' ? `${model.get('height')}px` : model.get('height') || '480px';
    box.style.position = 'relative';
    const pill = document.createElement('div');
    Object.assign(pill.style, { position: 'absolute', top: '8px', right: '8px', font: '11px system-ui, sans-serif',
      padding: '2px 8px', borderRadius: '9px', color: '#dbe4f0', background: 'rgba(22,28,38,.7)', pointerEvents: 'none',
      zIndex: '1' });
    el.append(box);
    const state = model.get('state') ?? {};
    const view = mount(box, { url: model.get('url') || undefined, token: model.get('token') || undefined, state,
      wheel: 'focused', transport: kernelTransport(model) });
    box.append(pill);
    let last = JSON.stringify(state);
    const onState = () => {
      const next = model.get('state') ?? {};
      if (JSON.stringify(next) !== last) {
        last = JSON.stringify(next);
        view.setState(next);
      }
    };
    model.on('change:state', onState);
    view.addEventListener('frame', (event) => {
      const { isExact } = /** @type {CustomEvent} */ (event).detail;
      const stats = view.stats();
      pill.textContent = `${isExact ? 'exact' : 'moving'} · ${stats.transport}`;
      if (isExact) {
        const current = view.getState();
        last = JSON.stringify(current);
        model.set('state', current);
        model.set('stats', stats);
        model.save_changes();
      }
    });
    view.addEventListener('click', (event) => {
      model.set('picked', /** @type {CustomEvent} */ (event).detail);
      model.save_changes();
    });
    return () => {
      model.off('change:state', onState);
      view.destroy();
    };
  },
};
