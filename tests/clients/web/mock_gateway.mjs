// A gateway for tests, without a server behind it: it serves clients/web, answers /v1/... for four
// datasets, one with fields and steps, one with labels, and draws their surface, a sphere with a bump, by casting rays, with exact depths. Its
// pictures are PNG also while the view moves (`isExact` tells). What goes wrong is asked for by POST
// /control.
//
//   node mock_gateway.mjs     prints its port on standard output
//
// POST /control {...}: `fail`: {code, message} for frames | null; `mute`: whether to answer no state;
// `answer`: the sequence number of a state that was not answered, to answer by a quick frame, now or when it comes;
// `raw`: base64 of bytes to send in place of frames | null; `drop`: [code, reason], closes all streams;
// `refuse`: whether new streams are refused; `features`: of /v1/capabilities | null for a gateway without it;
// `maxViewportPx`: of /v1/capabilities; `mostPixels`: exact pictures of more are refused for memory | null;
// `note`: of the first surface, if it is asked for | null; `token`: asked for in /v1/ as the gateway does | null; `name`: of the first
// dataset | null; `steps`: how many the dataset flow has; `hasWebp`: whether pictures may be WebP, of one grey each; `refine`:
// {tiles, bytes, seconds}: what an exact picture costs, and how many of its 12 tiles may come: the picture itself comes after the
// last | null: pictures do not refine; `levels`: how many each dataset has; `unresolved`: blocks, of coarse pictures; `hold`: a regular expression of
// addresses whose answers wait until it is another one | null; `broken`: one of addresses that fail | null; `reset`: whether to forget what was seen. GET /control: {shown: [numbers], states: n, first and last:
// states, picks: n, tiles: of a stream, renders: [requests], targets: [addresses below /v1/], held: [addresses],
// streams: n that are open}.
import { createHash } from 'node:crypto';
import { readFile } from 'node:fs/promises';
import { createServer } from 'node:http';
import { join, normalize } from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';
import { deflateSync, crc32 as zlibCrc32 } from 'node:zlib';

import * as series from '../../../clients/web/series.js';
import * as view from '../../../clients/web/isoscope-view.js';

const folder = fileURLToPath(new URL('../../../clients/web/', import.meta.url));

// ---- PNG ----

const CRC_TABLE = Uint32Array.from({ length: 256 }, (_, n) => {
  let c = n;
  for (let k = 0; k < 8; ++k) {
    c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1;
  }
  return c >>> 0;
});
const crc32 = zlibCrc32 ?? ((bytes) => {
  let c = 0xffffffff;
  for (const byte of bytes) {
    c = CRC_TABLE[(c ^ byte) & 255] ^ (c >>> 8);
  }
  return (c ^ 0xffffffff) >>> 0;
});

function chunk(name, data) {
  const bytes = Buffer.concat([Buffer.from(name, 'latin1'), data]);
  const out = Buffer.alloc(bytes.length + 8);
  out.writeUInt32BE(data.length, 0);
  bytes.copy(out, 4);
  out.writeUInt32BE(crc32(bytes), bytes.length + 4);
  return out;
}

export function encodePng(width, height, rgb) {
  const rows = Buffer.alloc(height * (1 + 3 * width));
  for (let y = 0; y < height; ++y) {
    rgb.copy(rows, y * (1 + 3 * width) + 1, y * 3 * width, (y + 1) * 3 * width);
  }
  const header = Buffer.alloc(13);
  header.writeUInt32BE(width, 0);
  header.writeUInt32BE(height, 4);
  header.set([8, 2, 0, 0, 0], 8);
  return Buffer.concat([Buffer.from([137, 80, 78, 71, 13, 10, 26, 10]), chunk('IHDR', header),
    chunk('IDAT', deflateSync(rows, { level: 1 })), chunk('IEND', Buffer.alloc(0))]);
}

// A lossless WebP of one grey, opaque. Each of its five prefix codes has one symbol, so that no pixel takes a bit (RFC 9649).
export function encodeGreyWebp(width, height, level) {
  const bits = [];
  const put = (value, count) => { for (let k = 0; k < count; ++k) { bits.push(Math.floor(value / 2 ** k) % 2); } };
  put(0x2f, 8);
  put(width - 1, 14);
  put(height - 1, 14);
  put(0, 1 + 3 + 3);  // no alpha, version 0; no transform, no colour cache, one group of codes
  for (const symbol of [level, level, level, 255, 0]) {
    put(1 + 4, 3);  // simple, one symbol, of 8 bits
    put(symbol, 8);
  }
  const image = Buffer.alloc(Math.ceil(bits.length / 8));
  bits.forEach((bit, i) => { image[i >> 3] |= bit << (i & 7); });
  const chunk = Buffer.concat([Buffer.from('VP8L'), Buffer.alloc(4), image, Buffer.alloc(image.length % 2)]);
  chunk.writeUInt32LE(image.length, 4);
  const head = Buffer.from('RIFF....WEBP');
  head.writeUInt32LE(4 + chunk.length, 4);
  return Buffer.concat([head, chunk]);
}

// ---- the scene ----

const DATASETS = ['ball', 'patient'].map((name) => ({
  name, datasetId: name === 'ball' ? '0'.repeat(32) : '1'.repeat(32), source: `${name}.nrrd`,
  geometry: { sampleDims: { x: '101', y: '101', z: '101' }, spacing: { x: 1, y: 1, z: 1 }, origin: {},
    directionColumns: [{ x: 1 }, { y: 1 }, { z: 1 }] },
  sampleType: 'SAMPLE_TYPE_UINT8', valueRange: { max: 100 }, blockCells: { x: '8', y: '8', z: '8' },
  blockCount: '2197', shardCount: 2, patientFrame: name === 'patient' ? 'LPS' : undefined,
}));
// The later the step, the smaller the spheres; velocity has one step less.
const flow = () => ({ ...DATASETS[0], name: 'flow', datasetId: '2'.repeat(32), timeUnit: 's', lengthUnit: 'm',
  timeSteps: Array.from({ length: control.steps }, (_, i) => ({ value: i / 4, number: i })),
  fields: [
    { name: 'pressure', unit: 'Pa', components: [{ sampleType: 'SAMPLE_TYPE_FLOAT32', valueRange: { max: 100 } }],
      timeSteps: Array.from({ length: control.steps }, (_, i) => i) },
    { name: 'velocity', unit: 'm/s', components: ['x', 'y', 'z', 'magnitude'].map((name) => ({ name, sampleType: 'SAMPLE_TYPE_FLOAT32',
      valueRange: { min: -2, max: 50 } })), timeSteps: Array.from({ length: control.steps - 1 }, (_, i) => i) }] });

// Field and step of a request, as the coordinator resolves them; null for the other datasets.
function selectionOf(request) {
  if (request.dataset !== 'flow') {
    return null;
  }
  const choice = series.choiceOf(flow(), request.selection);
  const steps = series.stepsOf(flow(), choice.field);
  return { field: choice.field.name, component: choice.component.name, timeStep: steps[series.indexOfStep(steps, request.selection)].number };
}

// A sphere for each label from 1 to 3, side by side; one of them has its colour.
const ORGANS = { ...DATASETS[0], name: 'organs', datasetId: '3'.repeat(32), valueRange: { max: 3 },
  labels: [{ value: 1, name: 'left lung', color: { red: 1 } }, { value: 2, name: 'right lung' }, { value: 3, name: '<b>heart</b>' }] };
const spheresOfLabels = (labels) => labels.filter((value) => value >= 1 && value <= 3)
  .map((value) => ({ center: [25 * value, 50, 50], radius: 12 }));

const BOX = view.boxOfDataset(DATASETS[0]);

// Two spheres; the greater the isovalue, the smaller they are.
const spheresOf = (isovalue) => {
  const size = Math.max(0, 100 - isovalue) / 50;
  return [{ center: [50, 50, 50], radius: 28 * size }, { center: [68, 60, 76], radius: 9 * size }];
};

const json = (v) => [v?.x ?? 0, v?.y ?? 0, v?.z ?? 0];

function cameraOf(request) {
  const camera = view.cameraFromJson(request.camera) ?? view.defaultCamera(BOX);
  if (['CAMERA_FIT_SURFACE', 'CAMERA_FIT_CELLS'].includes(request.cameraFit)) {
    const center = [50, 50, 50];
    camera.eye = view.add(center, view.scale(view.sub(camera.eye, center), 0.6));
    camera.target = center;
  }
  return camera;
}

function surfacesOf(request) {
  const surfaces = request.surfaces ?? [{ isovalue: request.isovalue ?? 0, color: request.baseColor }];
  const later = 6 * (selectionOf(request)?.timeStep ?? 0);
  return surfaces.map((surface) => ({ ...surface, isovalue: (surface.isovalue ?? 0) + later }));
}

// Returns what the ray through a point of the picture hits first, or null.
function cast(request, camera, basis, aspect, x, y) {
  const span = view.halfHeightOf(camera);
  const across = view.add(view.scale(basis.right, x * span * aspect), view.scale(basis.up, y * span));
  const from = camera.height > 0 ? view.add(camera.eye, across) : camera.eye;
  const ray = camera.height > 0 ? basis.forward : view.add(basis.forward, across);
  const box = request.clip?.box && { min: json(request.clip.box.min), max: json(request.clip.box.max) };
  const planes = (request.clip?.halfSpaces ?? []).map((plane) => [json(plane.normal), plane.offset ?? 0]);
  const isKept = (p) => (!box || p.every((value, axis) => value >= box.min[axis] && value <= box.max[axis])) &&
    planes.every(([normal, offset]) => view.dot(normal, p) >= offset);
  let best = null;
  surfacesOf(request).forEach((surface, index) => {
    for (const { center, radius } of surface.labels ? spheresOfLabels(surface.labels) : spheresOf(surface.isovalue ?? 0)) {
      const q = view.sub(from, center);
      const a = view.dot(ray, ray);
      const b = view.dot(q, ray);
      const root = b * b - a * (view.dot(q, q) - radius * radius);
      for (const sign of root > 0 ? [-1, 1] : []) {
        const depth = (-b + sign * Math.sqrt(root)) / a;
        const position = view.add(from, view.scale(ray, depth));
        if (depth > 0 && (!best || depth < best.depth) && isKept(position)) {
          best = { depth, position, index, normal: view.scale(view.sub(position, center), 1 / radius), surface };
        }
      }
    }
  });
  return best;
}

export function draw(request, { width, height }) {
  const camera = cameraOf(request);
  const basis = view.basisOf(camera);
  const rgb = Buffer.alloc(3 * width * height);
  const depth = new Float64Array(width * height).fill(Infinity);
  const { red = 0, green = 0, blue = 0 } = request.backgroundColor ?? {};
  for (let y = 0; y < height; ++y) {
    for (let x = 0; x < width; ++x) {
      const at = y * width + x;
      const hit = cast(request, camera, basis, width / height, 2 * (x + 0.5) / width - 1, 1 - 2 * (y + 0.5) / height);
      let color = [red, green, blue];
      if (hit) {
        const c = hit.surface.color ?? { red: 0.86, green: 0.78, blue: 0.7 };
        // Stripes, so that a turn shows.
        const stripe = Math.sin(hit.position[0] / 3) * Math.sin(hit.position[1] / 3) > 0 ? 1 : 0.75;
        const light = stripe * (0.15 + 0.85 * Math.abs(view.dot(hit.normal, basis.forward)));
        color = [c.red ?? 0, c.green ?? 0, c.blue ?? 0].map((channel) => channel * light);
        depth[at] = hit.depth;
      }
      color.forEach((channel, k) => { rgb[3 * at + k] = Math.round(255 * Math.min(1, channel)); });
    }
  }
  return { width, height, rgb, depth, camera };
}

export function gridOf(image, columns) {
  const rows = Math.max(1, Math.round(columns * image.height / image.width));
  const depths = [];
  for (let j = 0; j < rows; ++j) {
    for (let i = 0; i < columns; ++i) {
      depths.push(image.depth[Math.floor((j + 0.5) / rows * image.height) * image.width +
        Math.floor((i + 0.5) / columns * image.width)]);
    }
  }
  const finite = depths.filter(Number.isFinite);
  const near = Math.min(...finite, Infinity) === Infinity ? 0 : Math.min(...finite);
  const far = Math.max(near + 1e-6, ...finite);
  const values = Uint16Array.from(depths, (depth) => Number.isFinite(depth)
    ? Math.round((depth - near) / (far - near) * 65534) : 65535);
  return { width: columns, height: rows, near, far, values };
}

// ---- the server ----

const control = { fail: null, mute: false, raw: null, refuse: false, token: null, name: null, steps: 6, features: ['notes'], note: null, maxViewportPx: 4096, mostPixels: null, hasWebp: false, hidden: null, refine: null, levels: 0, unresolved: 0, hold: null, broken: null };
const seen = { shown: [], states: 0, first: null, last: null, picks: 0, tiles: 0, renders: [], targets: [], webps: 0 };
const streams = new Set();
/** @type {{url: string, answerNow: () => void}[]} */
const held = [];

function webSocketFrame(opcode, data) {
  const header = data.length < 126 ? Buffer.from([0x80 | opcode, data.length])
    : data.length < 65536 ? Buffer.from([0x80 | opcode, 126, data.length >> 8, data.length & 255])
      : Buffer.alloc(10);
  if (header.length === 10) {
    header[0] = 0x80 | opcode;
    header[1] = 127;
    header.writeBigUInt64BE(BigInt(data.length), 2);
  }
  return Buffer.concat([header, data]);
}

const TILES = { columns: 4, rows: 3 };

/** Sends a message of the gateway. */
function sendMessage(stream, header, parts) {
  const text = Buffer.from(JSON.stringify(header));
  const size = Buffer.alloc(4);
  size.writeUInt32LE(text.length, 0);
  stream.socket.write(webSocketFrame(2, Buffer.concat([size, text, ...parts])));
}

/** Draws a tile of the exact picture: borders of the last ones are those of the picture. */
function answerTile(stream, state, index) {
  const { widthPx, heightPx } = state.frame.viewport;
  seen.tiles = stream.tiles += 1;
  stream.image ??= draw(state.frame, { width: widthPx, height: heightPx });
  const [column, row] = [index % TILES.columns, Math.floor(index / TILES.columns)];
  const [x, right] = [column, column + 1].map((at) => Math.floor(at * widthPx / TILES.columns));
  const [y, bottom] = [row, row + 1].map((at) => Math.floor(at * heightPx / TILES.rows));
  const rgb = Buffer.alloc(3 * (right - x) * (bottom - y));
  for (let j = y; j < bottom; ++j) {
    rgb.set(stream.image.rgb.subarray(3 * (j * widthPx + x), 3 * (j * widthPx + right)), 3 * (j - y) * (right - x));
  }
  const png = encodePng(right - x, bottom - y, rgb);
  sendMessage(stream, { sequenceNumber: state.sequenceNumber, frameNumber: String(++stream.frames),
    tile: { region: { x, y, widthPx: right - x, heightPx: bottom - y }, index, count: TILES.columns * TILES.rows,
      extent: { widthPx, heightPx }, camera: view.cameraToJson(stream.image.camera) },
    image: { type: 'image/png', bytes: png.length }, depthBytes: 0 }, [png]);
}

/** The next answer to a state that refines: a quick frame, a coarse one, tiles, the exact one; or that it is over a limit. */
function refine(stream) {
  const { newest: state, refined } = stream;
  const { tiles, bytes, seconds } = control.refine;
  const { maxExactBytes = Infinity, maxExactDuration = Infinity } = state.refinement;
  const isOver = bytes > Number(maxExactBytes) || seconds > parseFloat(maxExactDuration);
  if (!refined.isQuick) {
    refined.isQuick = true;
    answer(stream, state, false);
    return 120;
  }
  if (!refined.isCoarse) {
    refined.isCoarse = true;
    answer(stream, state, false, true);
    return 5;
  }
  if (isOver) {
    const limits = `${maxExactBytes} ${maxExactDuration}`;
    if (refined.over !== limits) {
      refined.over = limits;
      sendMessage(stream, { sequenceNumber: state.sequenceNumber, frameNumber: String(++stream.frames), image: { type: 'image/png', bytes: 0 },
        exactDeferred: { expectedBytes: String(bytes), expectedDuration: `${seconds}s`, drawnLevel: { level: 2 } } }, []);
    }
    return null;
  }
  if (refined.tiles < Math.min(tiles, TILES.columns * TILES.rows)) {
    answerTile(stream, state, refined.tiles++);
    return 5;
  }
  if (tiles >= TILES.columns * TILES.rows && !refined.isExact) {
    refined.isExact = true;
    answer(stream, state, true);
  }
  return null;
}

/** Goes on with the picture of the newest state, or begins it. */
function workRefined(stream) {
  const words = JSON.stringify(stream.newest.frame);
  if (stream.refined?.words !== words) {
    stream.refined = { words, tiles: 0 };
    stream.image = null;
  }
  const next = () => {
    const delay = refine(stream);
    if (delay !== null) {
      stream.timer = setTimeout(next, delay);
    }
  };
  stream.timer = setTimeout(next, 5);
}

function answer(stream, state, isExact, isCoarse = false) {
  const number = ++stream.frames;
  const base = { sequenceNumber: state.sequenceNumber, frameNumber: String(number) };
  let header = { ...base, error: control.fail, image: { type: 'image/png', bytes: 0 }, depthBytes: 0 };
  let parts = [];
  if (control.raw) {
    stream.socket.write(webSocketFrame(2, Buffer.from(control.raw, 'base64')));
    return;
  }
  const { viewport } = state.frame;
  const isTooLarge = control.mostPixels !== null && isExact && viewport.widthPx * viewport.heightPx > control.mostPixels;
  if (isTooLarge) {
    header.error = { code: 8, message: 'the picture needs more memory than there is' };
  } else if (!control.fail) {
    const { widthPx, heightPx } = state.frame.viewport;
    const shrink = isExact || isCoarse ? 1 : 2;
    const image = draw(state.frame, { width: Math.max(1, Math.round(widthPx / shrink)), height: Math.max(1, Math.round(heightPx / shrink)) });
    if (isCoarse) {
      image.rgb.forEach((value, i) => { image.rgb[i] = value ^ 8; });  // no pixel is that of the exact picture
    }
    // As the server: only frames of a moving view have depths.
    const grid = isExact ? null : gridOf(image, 128);
    const png = encodePng(image.width, image.height, image.rgb);
    const colorBy = surfacesOf(state.frame)[0]?.colorBy;
    const selection = selectionOf(state.frame);
    header = { ...base, isExact: isExact || undefined,
      frame: { camera: view.cameraToJson(image.camera), extent: { widthPx: image.width, heightPx: image.height },
        ...(selection ? { selection, time: selection.timeStep / 4 } : {}),
        notes: isExact && state.frame.withNotes && control.note ? [{ message: control.note }] : undefined,
        colorings: colorBy ? [{ colorBy: { range: { max: 100 }, ...colorBy } }] : [],
        ...(state.refinement ? { drawnLevel: isExact ? {} : { level: 2, maxSpacingPx: 0.9 } } : {}),
        statistics: { ...(isCoarse && control.unresolved ? { unresolvedBlockCount: String(control.unresolved) } : {}), triangleCount: '1000', activeBlockCount: '20', visibleBlockCount: '12', culledBlockCount: '8',
          durations: { occluderRenderingDuration: '0.004s', encodeDuration: '0.001s' },
          agents: !isExact ? undefined : [0, 1].map((i) => ({ agentAddress: `agent-${i}:50061`, shardIndices: [i], triangleCount: '500',
            extractDuration: '0.002s', renderDuration: '0.001s', busyDuration: '0.004s' })) } },
      depthGrid: grid ? { width: grid.width, height: grid.height, near: grid.near, far: grid.far } : undefined,
      image: { type: 'image/png', bytes: png.length }, depthBytes: grid ? 2 * grid.values.length : 0 };
    parts = grid ? [png, Buffer.from(grid.values.buffer)] : [png];
  }
  sendMessage(stream, header, parts);
}

// Draws the newest state; the exact picture follows when none has come for 120 ms.
function work(stream) {
  clearTimeout(stream.timer);
  const state = stream.newest;
  if (!state || control.mute) {
    return;
  }
  if (control.refine && state.refinement) {
    workRefined(stream);
    return;
  }
  stream.timer = setTimeout(() => {
    answer(stream, state, Boolean(state.isAtRest));
    if (!state.isAtRest) {
      stream.timer = setTimeout(() => answer(stream, state, true), 120);
    }
  }, 5);
}

// The sequence number of a state to answer when it comes; 0: none.
let owed = 0;

function receive(stream, text) {
  const message = JSON.parse(text);
  if (message.frameShown) {
    seen.shown.push(Number(message.frameShown.frameNumber));
  } else if (message.viewState) {
    if (!(Number(message.viewState.sequenceNumber) > stream.sequence)) {
      close(stream, 1008, 'sequence numbers must rise');
      return;
    }
    stream.sequence = Number(message.viewState.sequenceNumber);
    stream.newest = message.viewState;
    stream.states.set(stream.sequence, message.viewState);
    seen.states += 1;
    seen.first ??= message.viewState;
    seen.last = message.viewState;
    work(stream);
    if (stream.sequence === owed) {
      owed = 0;
      answer(stream, message.viewState, false);
    }
  }
}

function close(stream, code, reason) {
  const data = Buffer.concat([Buffer.from([code >> 8, code & 255]), Buffer.from(reason)]);
  clearTimeout(stream.timer);
  stream.newest = null;
  streams.delete(stream);
  stream.socket.end(webSocketFrame(8, data));
}

// Whether a request shows the token: as a header, as a protocol of a WebSocket, or in its address.
function isAdmitted(request, protocols) {
  seen.targets.push(request.url);
  const bearer = protocols.find((name) => name.startsWith('isoscope.bearer.'));
  const shown = [new URL(request.url, 'http://mock').searchParams.get('token'),
    request.headers.authorization?.replace(/^Bearer /, ''),
    bearer && Buffer.from(bearer.slice('isoscope.bearer.'.length), 'base64url').toString()];
  return !control.token || shown.includes(control.token);
}

function upgrade(request, socket) {
  const protocols = (request.headers['sec-websocket-protocol'] ?? '').split(',').map((name) => name.trim());
  if (control.refuse || !request.url.startsWith('/v1/interact')) {
    socket.end('HTTP/1.1 503 Service Unavailable\r\nContent-Length: 0\r\n\r\n');
    return;
  }
  if (!isAdmitted(request, protocols)) {
    socket.end('HTTP/1.1 401 Unauthorized\r\nContent-Length: 0\r\n\r\n');
    return;
  }
  const key = request.headers['sec-websocket-key'] + '258EAFA5-E914-47DA-95CA-C5AB0DC85B11';
  socket.write('HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n' +
    (protocols.includes('isoscope') ? 'Sec-WebSocket-Protocol: isoscope\r\n' : '') +
    `Sec-WebSocket-Accept: ${createHash('sha1').update(key).digest('base64')}\r\n\r\n`);
  const stream = { socket, frames: 0, tiles: 0, sequence: 0, newest: null, states: new Map(), timer: 0 };
  streams.add(stream);
  let bytes = Buffer.alloc(0);
  socket.on('data', (data) => {
    bytes = Buffer.concat([bytes, data]);
    while (bytes.length >= 6) {
      const opcode = bytes[0] & 15;
      let length = bytes[1] & 127;
      let start = 2;
      if (length === 126) {
        length = bytes.readUInt16BE(2);
        start = 4;
      } else if (length === 127) {
        length = Number(bytes.readBigUInt64BE(2));
        start = 10;
      }
      if (bytes.length < start + 4 + length) {
        return;
      }
      const mask = bytes.subarray(start, start + 4);
      const text = Buffer.from(bytes.subarray(start + 4, start + 4 + length).map((byte, i) => byte ^ mask[i & 3]));
      bytes = bytes.subarray(start + 4 + length);
      if (opcode === 1) {
        receive(stream, text.toString());
      } else if (opcode === 8) {
        close(stream, 1000, '');
      }
    }
  });
  const gone = () => {
    clearTimeout(stream.timer);
    streams.delete(stream);
  };
  socket.on('close', gone);
  socket.on('error', gone);
}

const TYPES = { html: 'text/html; charset=utf-8', js: 'text/javascript', css: 'text/css', svg: 'image/svg+xml' };

async function respond(request, body, reply) {
  const url = new URL(request.url, 'http://mock');
  const parts = url.pathname.split('/').slice(1).map(decodeURIComponent);
  const send = (value) => reply(200, 'application/json', JSON.stringify(value));
  const fail = (status, code, message) => reply(status, 'application/json', JSON.stringify({ code, message }));
  const levels = Array.from({ length: control.levels }, (_, i) => ({ level: i + 1, blockCount: '8', filter: 'FILTER_MEAN',
    geometry: { sampleDims: { x: String(101 >> i + 1), y: String(101 >> i + 1), z: String(101 >> i + 1) } } }));
  const datasets = [...DATASETS.map((one, i) => i === 0 && control.name ? { ...one, name: control.name } : one), flow(), ORGANS]
    .map((one) => levels.length > 0 ? { ...one, levels } : one);
  if (parts[0] === 'v1' && !isAdmitted(request, [])) {
    fail(401, 'UNAUTHENTICATED', 'a token is asked for here: open the address that was printed');
  } else if (control.broken && new RegExp(control.broken).test(request.url)) {
    fail(503, 'UNAVAILABLE', 'there is nobody who answers this');
  } else if (url.pathname === '/control') {
    if (request.method === 'POST') {
      const { answer: sequence, drop, reset, ...rest } = JSON.parse(body);
      if (reset) {
        Object.assign(seen, { shown: [], states: 0, first: null, last: null, picks: 0, tiles: 0, renders: [], targets: [], webps: 0 });
      }
      Object.assign(control, rest);
      if ('hold' in rest) {
        held.splice(0).forEach(({ answerNow }) => answerNow());
      }
      if (drop) {
        [...streams].forEach((stream) => close(stream, drop[0], drop[1]));
      }
      // The state may be on its way still.
      owed = sequence && ![...streams].some((stream) => stream.states.has(sequence)) ? sequence : 0;
      const isOfAddresses = Object.keys(JSON.parse(body)).every((name) => ['hold', 'broken'].includes(name));
      for (const stream of isOfAddresses ? [] : streams) {
        if (stream.states.has(sequence)) {
          answer(stream, stream.states.get(sequence), false);
        }
        work(stream);
      }
    }
    send({ ...seen, held: held.map(({ url: address }) => address), streams: streams.size });
  } else if (url.pathname === '/v1/datasets') {
    send({ datasets });
  } else if (url.pathname === '/v1/capabilities' && control.features) {
    send({ version: '1.2.3', features: control.features, maxViewportPx: control.maxViewportPx });
  } else if (url.pathname === '/v1/openapi.json') {
    send({ paths: { '/v1/datasets/{name}/render': { get: { responses: { 200: { content: { 'image/png': {}, ...(control.hasWebp ? { 'image/webp': {} } : {}) } } } } } } });
  } else if (url.pathname === '/v1/status') {
    send({ agents: [] });
  } else if (parts[1] === 'datasets') {
    const dataset = datasets.find((one) => one.name === parts[2]);
    if (!dataset) {
      fail(404, 'NOT_FOUND', `dataset "${parts[2]}": there are: "ball", "patient"`);
    } else if (parts.length === 3) {
      send(dataset);
    } else if (parts[3] === 'histogram') {
      send({ bins: Array.from({ length: 50 }, (_, i) => ({ min: 2 * i, max: 2 * i + 2, sampleCount: String((50 - i) ** 3),
        estimatedTriangleCount: '1000' })), hasSampleCounts: true,
      suggestions: [{ method: 'METHOD_BETWEEN_CLASSES', isovalue: 40, insideFraction: 0.3 }],
      ...(dataset.labels ? { suggestedLabels: dataset.labels.map(({ value }) => value) } : {}) });
    } else if (parts[3] === 'pick') {
      const { frame, pixels, withFieldValues } = JSON.parse(body);
      const { widthPx, heightPx } = frame.viewport;
      const camera = cameraOf(frame);
      seen.picks += 1;
      send({ points: pixels.map(({ x = 0, y = 0 }) => {
        const hit = cast(frame, camera, view.basisOf(camera), widthPx / heightPx, 2 * (x + 0.5) / widthPx - 1, 1 - 2 * (y + 0.5) / heightPx);
        return hit ? { isHit: true, position: { x: hit.position[0], y: hit.position[1], z: hit.position[2] }, depth: hit.depth,
          surfaceIndex: hit.index, ...(hit.surface.labels ? { label: hit.surface.labels[0], labelName: ORGANS.labels[hit.surface.labels[0] - 1].name } : {}), normal: { x: hit.normal[0], y: hit.normal[1], z: hit.normal[2] }, blockId: '7', shardIndex: 1,
          ...(withFieldValues ? { fieldValues: [{ field: 'pressure', unit: 'Pa', value: 40 }, ...['x', 'y', 'z', 'magnitude'].map((component, i) =>
            ({ field: 'velocity', component, unit: 'm/s', value: 0.5 * i }))] } : {}) } : {};
      }) });
    } else if (parts[3] === 'render' && url.searchParams.get('format') === 'webp') {
      const [width, height] = ['width', 'height'].map((name) => Number(url.searchParams.get(name)));
      reply(200, 'image/webp', encodeGreyWebp(width, height, seen.webps++ % 256));
    } else if (parts[3] === 'render') {
      const frame = JSON.parse(body);
      const refused = ['withNotes', 'withTrace', 'withUnresolvedCount', 'allowPartial'].find((option) => frame[option]);
      if (refused) {
        throw new Error(`${refused} is true: a picture over HTTP has none`);
      }
      seen.renders.push(frame);
      const image = draw(frame, { width: frame.viewport.widthPx, height: frame.viewport.heightPx });
      // Of a surface that does not show, a server tells the range of all values: of positions the volume's box.
      const rangeOf = (colorBy, i) => i !== control.hidden ? [0.123456 - i, 7.98765] : colorBy.quantity === 'QUANTITY_POSITION_X' ? [0, 100] : [-1000, 1000];
      const mapped = surfacesOf(frame).flatMap(({ colorBy }, i) => colorBy ? [[i, rangeOf(colorBy, i)]] : []);
      reply(200, 'image/png', encodePng(image.width, image.height, image.rgb), { 'X-Isoscope-Camera': JSON.stringify(view.cameraToJson(image.camera)),
        ...(mapped.length > 0 ? { 'X-Isoscope-Color-Ranges': JSON.stringify(Object.fromEntries(mapped)) } : {}) });
    } else if (/^mesh\.\w+$/.test(parts[3])) {
      reply(200, 'application/octet-stream', `a ${parts[3]}`);
    } else {
      fail(404, 'NOT_FOUND', `there is no ${url.pathname}`);
    }
  } else {
    const name = normalize(url.pathname === '/' ? 'index.html' : url.pathname.slice(1));
    const type = TYPES[name.split('.').at(-1)];
    try {
      reply(200, type, name.startsWith('..') || !type ? null : await readFile(join(folder, name)));
    } catch {
      fail(404, 'NOT_FOUND', `there is no ${url.pathname}`);
    }
  }
}

function serve() {
  const server = createServer((request, response) => {
    const chunks = [];
    request.on('data', (data) => chunks.push(data));
    request.on('end', () => {
      const reply = (status, type, body, headers = {}) => {
        response.writeHead(status, { ...headers, 'Content-Type': type, 'Cache-Control': 'no-store',
          'Content-Security-Policy': 'default-src \'none\'; script-src \'self\'; style-src \'self\'; worker-src \'self\' blob:; ' +
            'img-src \'self\' blob: data:; connect-src \'self\'; base-uri \'none\'; form-action \'none\'' });
        response.end(body);
      };
      const answerNow = () => respond(request, Buffer.concat(chunks).toString(), reply).catch((error) =>
        reply(400, 'application/json', JSON.stringify({ code: 'INVALID_ARGUMENT', message: String(error) })));
      if (control.hold && new RegExp(control.hold).test(request.url)) {
        held.push({ url: request.url, answerNow });
      } else {
        answerNow();
      }
    });
  });
  server.on('upgrade', upgrade);
  server.listen(0, '127.0.0.1', () => console.log(server.address().port));
}

if (import.meta.url === pathToFileURL(process.argv[1]).href) {
  serve();
}
