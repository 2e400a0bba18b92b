// The view module without a browser: cameras, moves, the warp, and messages.
import assert from 'node:assert/strict';
import { readFileSync, readdirSync } from 'node:fs';
import { test } from 'node:test';

import * as view from '../../../clients/web/isoscope-view.js';
import { Frames, refusalOf } from '../../../clients/web/view/frames.js';
import { Model } from '../../../clients/web/view/model.js';
import { levelText } from '../../../clients/web/view/refinement.js';
import { workerSource } from '../../../clients/web/view/worker.js';
import { draw, gridOf } from './mock_gateway.mjs';
import { cornerDepth, warpByGrid, warpPoint } from './warp.mjs';

/** A small generator, so that failures come back. */
function makeRandom(seed) {
  let state = seed;
  return () => {
    state = Math.imul(state ^ (state >>> 15), 0x2c1b3c6d) + 0x6d2b79f5 | 0;
    return ((state ^ (state >>> 13)) >>> 0) / 2 ** 32;
  };
}

function randomCamera(random) {
  const v = () => [random() * 200 - 100, random() * 200 - 100, random() * 200 - 100];
  return { eye: v(), target: v(), up: v(), fovYDegrees: 10 + random() * 80, height: random() < 0.3 ? 10 + random() * 100 : 0 };
}

const near = (a, b, tolerance, what) => assert.ok(view.length(view.sub(a, b)) <= tolerance, `${what}: ${a} and ${b}`);

test('the default camera is the server\'s: VTK\'s ResetCamera', () => {
  // By core/view: 30 degrees, centre, distance = half of the diagonal / sin 15 degrees, along +z.
  const camera = view.defaultCamera({ min: [0, 0, 0], max: [10, 20, 30] });
  const distance = Math.hypot(10, 20, 30) / 2 / Math.sin(Math.PI / 12);
  near(camera.eye, [5, 10, 15 + distance], 1e-9, 'eye');
  assert.deepEqual([camera.target, camera.up, camera.fovYDegrees], [[5, 10, 15], [0, 1, 0], 30]);
});

test('named views look from the sides that the command line names', () => {
  const box = { min: [0, 0, 0], max: [10, 10, 10] };
  const side = (name, frame) => {
    const camera = view.namedCamera(name, box, frame);
    return camera && [view.normalize(view.sub(camera.eye, camera.target)).map(Math.round), camera.up];
  };
  assert.deepEqual(side('top'), [[0, 1, 0], [0, 0, -1]]);
  assert.deepEqual(side('left'), [[-1, 0, 0], [0, 1, 0]]);
  assert.deepEqual(side('left', 'LPS'), [[1, 0, 0], [0, 0, 1]]);
  assert.deepEqual(side('anterior', 'LPS'), [[0, -1, 0], [0, 0, 1]]);
  assert.deepEqual(side('anterior', 'RAS'), [[0, 1, 0], [0, 0, 1]]);
  assert.deepEqual(side('superior', 'SPL'), [[1, 0, 0], [0, -1, 0]]);
  assert.equal(side('anterior'), null);
  assert.equal(side('sideways'), null);
});

test('the table of named views is the one of C++', () => {
  const table = readFileSync(new URL('../../../core/view/named_views.inc', import.meta.url), 'utf8');
  const rows = [...table.matchAll(/\{"(\w+)", NamedView::k\w+, \{\{(.*?)\}, \{(.*?)\}\}, "(\w*)"\}/g)].map(([, name, toEye, up, sides]) =>
    [name, [toEye.split(', ').map(Number), up.split(', ').map(Number), sides]]);
  assert.equal(rows.length, 10);
  assert.deepEqual(Object.entries(view.NAMED_VIEWS), rows);
});

test('the box of a dataset has its samples as corners, also where the grid is turned', () => {
  const geometry = { sampleDims: { x: '11', y: '21', z: '3' }, spacing: { x: 1, y: 0.5, z: 2 }, origin: { x: 100 } };
  assert.deepEqual(view.boxOfDataset({ geometry }), { min: [100, 0, 0], max: [110, 10, 4] });
  const directionColumns = [{ y: 1 }, { x: -1 }, { z: 1 }];
  assert.deepEqual(view.boxOfDataset({ geometry: { ...geometry, directionColumns } }), { min: [90, 0, 0], max: [100, 10, 4] });
  assert.equal(view.boxOfDataset({}), null);
  assert.equal(view.boxOfDataset({ geometry: { ...geometry, spacing: { x: 'NaN', y: 1, z: 1 } } }), null);
});

test('a camera comes back from JSON, and what is none gives null', () => {
  const random = makeRandom(1);
  for (let i = 0; i < 100; ++i) {
    const camera = randomCamera(random);
    const again = view.cameraFromJson(JSON.parse(JSON.stringify(view.cameraToJson(camera))));
    assert.ok(view.isSameCamera(again, camera.height > 0 ? { ...camera, fovYDegrees: 30 } : camera));
  }
  // Protobuf leaves zeros out.
  assert.deepEqual(view.cameraFromJson({ eye: { z: 5 }, target: {}, perspective: { fovYDegrees: 30 } })?.eye, [0, 0, 5]);
  const good = { eye: { z: 5 }, target: {}, up: { y: 1 }, perspective: { fovYDegrees: 30 } };
  for (const bad of [null, 7, {}, { ...good, eye: {} }, { ...good, up: { z: 1 } }, { ...good, eye: { z: 'NaN' } },
    { ...good, perspective: { fovYDegrees: 180 } }, { ...good, up: { x: Infinity } },
    { ...good, orthographic: { height: -1 } }]) {
    assert.equal(view.cameraFromJson(bad), null, JSON.stringify(bad));
  }
});

test('unproject is the inverse of project', () => {
  const random = makeRandom(2);
  for (let i = 0; i < 500; ++i) {
    const camera = randomCamera(random);
    const distance = 1 + random() * 100;
    const [x, y, aspect] = [random() * 2 - 1, random() * 2 - 1, 0.5 + random()];
    const at = view.project(camera, aspect, view.unproject(camera, aspect, x, y, distance));
    near([at.x, at.y, at.distance], [x, y, distance], 1e-8 * distance, 'point');
  }
});

test('a turn keeps distance, target and a right angle of up, and moves what faces the eye with the pointer', () => {
  const random = makeRandom(3);
  for (let i = 0; i < 200; ++i) {
    const camera = randomCamera(random);
    const before = view.basisOf(camera);
    const dx = random() * 0.2 - 0.1;
    const dy = random() * 0.2 - 0.1;
    const turned = view.turn(camera, dx, dy);
    const after = view.basisOf(turned);
    assert.ok(Math.abs(after.distance - before.distance) < 1e-9 * before.distance);
    assert.deepEqual(turned.target, camera.target);
    assert.ok(Math.abs(view.dot(after.forward, turned.up)) < 1e-9);
    // A point between target and eye.
    const point = view.sub(camera.target, view.scale(before.forward, before.distance / 4));
    const at = view.project(turned, 1, point);
    assert.ok(at.x * dx >= 0 && at.y * dy >= 0, `${dx}, ${dy} moved a point to ${at.x}, ${at.y}`);
  }
  // Half of the picture's height is a right angle.
  const camera = { eye: [0, 0, 10], target: [0, 0, 0], up: [0, 1, 0], fovYDegrees: 30, height: 0 };
  near(view.turn(camera, 1, 0).eye, [-10, 0, 0], 1e-9, 'eye');
  near(view.turn(camera, 0, 1).eye, [0, -10, 0], 1e-9, 'eye');
});

test('a full circle over the poles comes back to the same camera', () => {
  let camera = { eye: [0, 0, 10], target: [0, 0, 0], up: [0, 1, 0], fovYDegrees: 30, height: 0 };
  for (let i = 0; i < 40; ++i) {
    camera = view.turn(camera, 0, 0.1);
  }
  near(camera.eye, [0, 0, 10], 1e-9, 'eye');
  near(camera.up, [0, 1, 0], 1e-9, 'up');
});

test('a pan keeps the point under the pointer, at any depth', () => {
  const random = makeRandom(4);
  for (let i = 0; i < 200; ++i) {
    const camera = randomCamera(random);
    const distance = 5 + random() * 50;
    const point = view.unproject(camera, 1.5, 0.2, -0.3, distance);
    const at = view.project(view.pan(camera, 0.3, 0.1, distance), 1.5, point);
    near([at.x, at.y, 0], [0.2 + 0.3 / 1.5, -0.2, 0], 1e-7, 'point');
  }
});

test('a zoom keeps the point under the pointer', () => {
  const random = makeRandom(5);
  for (let i = 0; i < 200; ++i) {
    const camera = randomCamera(random);
    const distance = 5 + random() * 50;
    const point = view.unproject(camera, 1.5, 0.4, -0.3, distance);
    const factor = 0.3 + random() * 3;
    const at = view.project(view.zoomTo(camera, factor, point), 1.5, point);
    near([at.x, at.y, 0], [0.4, -0.3, 0], 1e-7, 'point');
    if (!(camera.height > 0)) {
      assert.ok(Math.abs(at.distance - distance / factor) < 1e-7 * distance);
    }
  }
});

test('warping by the true depth is projecting', () => {
  const random = makeRandom(6);
  for (let i = 0; i < 300; ++i) {
    const [from, to] = [randomCamera(random), randomCamera(random)];
    const [u, v, depth] = [random(), random(), 1 + random() * 100];
    const truth = view.project(to, 0.8, view.unproject(from, 1.3, 2 * u - 1, 1 - 2 * v, depth));
    const at = warpPoint(view.makeWarp(from, 1.3, to, 0.8), u, v, depth);
    near([at.x, at.y, at.distance], [truth.x, truth.y, truth.distance], 1e-6 * (1 + Math.hypot(truth.x, truth.y, truth.distance)), 'point');
  }
});

/** Returns the share of covered pixels that the grid takes to within 2 pixels of their true place. */
function warpShare(request, size, columns, degrees) {
  const image = draw(request, size);
  const grid = gridOf(image, columns);
  const from = image.camera;
  const to = view.turn(from, degrees / 90 * 0.8, degrees / 90 * 0.6);
  const aspect = size.width / size.height;
  const warp = view.makeWarp(from, aspect, to, aspect);
  const jump = view.jumpOf(from, grid.height);
  let covered = 0;
  let good = 0;
  for (let y = 0; y < size.height; ++y) {
    for (let x = 0; x < size.width; ++x) {
      const depth = image.depth[y * size.width + x];
      if (Number.isFinite(depth)) {
        ++covered;
        const [u, v] = [(x + 0.5) / size.width, (y + 0.5) / size.height];
        const truth = warpPoint(warp, u, v, depth);
        const at = warpByGrid(grid, warp, u, v, jump);
        if (at && Math.hypot((at.x - truth.x) * size.width / 2, (at.y - truth.y) * size.height / 2) <= 2) {
          ++good;
        }
      }
    }
  }
  assert.ok(covered > size.width * size.height / 20, `only ${covered} pixels are covered`);
  return good / covered;
}

test('after 5 degrees at least 90 % of the covered pixels are within 2 pixels of their true place', () => {
  const size = { width: 1024, height: 768 };
  const fit = { cameraFit: 'CAMERA_FIT_SURFACE' };
  const oblique = view.cameraToJson({ eye: [-60, 160, 150], target: [50, 50, 50], up: [0, 1, 0], fovYDegrees: 35, height: 0 });
  const parallel = { eye: { x: 150, y: 80, z: 160 }, target: { x: 50, y: 50, z: 50 }, orthographic: { height: 90 } };
  const requests = { whole: { surfaces: [{ isovalue: 40 }], ...fit }, oblique: { surfaces: [{ isovalue: 30 }], camera: oblique },
    parallel: { surfaces: [{ isovalue: 40 }], camera: parallel },
    cut: { surfaces: [{ isovalue: 40 }], camera: oblique, clip: { halfSpaces: [{ normal: { z: -1 }, offset: -55 }] } } };
  for (const [name, request] of Object.entries(requests)) {
    for (const columns of [128, 192, 256]) {
      const share = warpShare(request, size, columns, 5);
      console.log(`warp, ${name}, grid of ${columns}: ${(100 * share).toFixed(2)} % within 2 pixels`);
      assert.ok(share >= 0.9, `${name}, grid of ${columns}: ${share}`);
    }
  }
});

test('a view that is framed again keeps direction, up, angle and projection, and has the whole box around its middle', () => {
  const box = { min: [0, 0, 0], max: [10, 20, 40] };
  const radius = Math.hypot(10, 20, 40) / 2;
  for (const height of [0, 7]) {
    const camera = { eye: [3, 4, 12], target: [3, 4, 10], up: [0, 1, 0], fovYDegrees: 60, height };
    const framed = view.framedAgain(camera, box);
    assert.deepEqual(framed.target, [5, 10, 20]);
    assert.deepEqual([framed.up, framed.fovYDegrees], [camera.up, 60]);
    assert.deepEqual(framed.eye.map((x) => Number(x.toFixed(9))), [5, 10, 20 + Number((radius / Math.sin(Math.PI / 6)).toFixed(9))]);
    assert.equal(framed.height, height > 0 ? 2 * radius : 0);
  }
  const standard = view.defaultCamera(box);
  assert.deepEqual(view.framedAgain(standard, box), standard);
});

test('a filled view has all of the surface in it, in the middle, and little room around', () => {
  const size = { width: 400, height: 240 };
  for (const camera of [undefined, view.cameraToJson({ eye: [260, 180, 90], target: [40, 60, 50], up: [0, 0, 1], fovYDegrees: 50, height: 0 }),
    { eye: { x: 250, y: 80, z: 160 }, target: { x: 50, y: 50, z: 50 }, orthographic: { height: 180 } }]) {
    const image = draw({ surfaces: [{ isovalue: 40 }], camera }, size);
    const aspect = size.width / size.height;
    const filled = view.fillView(image.camera, gridOf(image, 128), aspect);
    const again = draw({ surfaces: [{ isovalue: 40 }], camera: view.cameraToJson(filled) }, size);
    const rows = Array.from({ length: size.height }, (_, y) => y)
      .filter((y) => again.depth.subarray(y * size.width, (y + 1) * size.width).some(Number.isFinite));
    assert.ok(rows[0] > 2 && rows.at(-1) < size.height - 3, `rows ${rows[0]} to ${rows.at(-1)}`);
    assert.ok(rows.length > 0.8 * size.height, `${rows.length} rows of ${size.height}`);
    assert.ok(Math.abs(rows[0] + rows.at(-1) - size.height) < 0.06 * size.height, 'not in the middle');
  }
  const empty = { width: 4, height: 4, near: 1, far: 2, values: new Uint16Array(16).fill(65535) };
  const camera = view.defaultCamera({ min: [0, 0, 0], max: [1, 1, 1] });
  assert.deepEqual(view.fillView(camera, empty, 1), camera);
});

test('a camera is that of a fit until someone moves it, and again when it comes back', () => {
  const fitted = view.defaultCamera({ min: [0, 0, 0], max: [10, 20, 30] });
  const moved = view.turn(fitted, 0.1, 0);
  const model = new Model();
  model.replace({ dataset: 'ball', cameraFit: 'CAMERA_FIT_CELLS' }, 1);
  assert.equal(model.hasFittedCamera, false, 'no camera yet');
  model.takeCamera(fitted, 1);
  assert.equal(model.hasFittedCamera, true);
  model.replace({ ...model.toState(), samples: 4 }, 2);
  assert.equal(model.hasFittedCamera, true, 'another part of the state');
  model.move(moved);
  assert.equal(model.hasFittedCamera, false);
  model.replace({ ...model.toState(), samples: 1 }, 3);
  assert.equal(model.hasFittedCamera, false);
  model.move(fitted);
  assert.equal(model.hasFittedCamera, true, 'undone');
  model.replace({ ...model.toState(), cameraFit: 'CAMERA_FIT_SURFACE' }, 4);
  assert.equal(model.hasFittedCamera, false, 'the server chooses');
  assert.deepEqual(model.takeCamera(fitted, 4), { isFitted: true });
  model.takeFitted(moved);
  assert.equal(model.hasFittedCamera, true, 'the view filled itself');
  const link = new Model();
  link.replace(model.toState(), 1);
  assert.equal(link.hasFittedCamera, false, 'the camera of a link is chosen');
});

test('the relief is cut at jumps, whole elsewhere, and has nothing where there is only background', () => {
  // A far plane, a near step on its right half, background on the left.
  const values = new Uint16Array(64);
  for (let i = 0; i < 64; ++i) {
    values[i] = i % 8 < 2 ? 65535 : i % 8 < 5 ? 60000 : 0;
  }
  const grid = { width: 8, height: 8, near: 10, far: 110, values };
  const far = 10 + 100 * 60000 / 65534;
  const corner = (i, a) => cornerDepth(grid, i, 4, a, 0, 0, 5);
  assert.equal(corner(0, 0), -1);
  assert.ok(Math.abs(corner(1, 1) - far) < 1e-9, 'the rim takes the depth of its neighbour');
  assert.ok(Math.abs(corner(3, 1) - far) < 1e-9);
  assert.ok(Math.abs(corner(4, 1) - far) < 1e-9, 'not pulled to the near step');
  assert.equal(corner(5, 0), 10);
  assert.equal(view.gridDepth(grid, -1, 0), -1);
  assert.equal(view.gridDepth(grid, 8, 0), -1);
});

test('lengths of scale bars are 1, 2 or 5 times a power of ten', () => {
  for (const [limit, value] of [[1, 1], [1.99, 1], [2, 2], [4.9, 2], [5, 5], [99, 50], [0.03, 0.02], [1000, 1000], [1e-7, 1e-7]]) {
    assert.ok(Math.abs(view.roundLength(limit) - value) < 1e-9 * value, `${limit}: ${view.roundLength(limit)}`);
  }
});

test('the page asks for all modules at once', () => {
  const web = new URL('../../../clients/web/', import.meta.url);
  const asked = [...readFileSync(new URL('index.html', web), 'utf8').matchAll(/<link rel="modulepreload" href="(.+)">/g)].map((match) => match[1]);
  const modules = (/** @type {string} */ folder) => readdirSync(new URL(folder, web)).filter((name) => name.endsWith('.js')).sort();
  assert.deepEqual(asked, [...modules('./').filter((name) => name !== 'page.js'), ...modules('view').filter((name) => name !== 'types.js').map((name) => `view/${name}`)]);
});

// ---- messages ----

function message(header, image = new Uint8Array(0), depths = new Uint8Array(0)) {
  const text = typeof header === 'string' ? new TextEncoder().encode(header) : new TextEncoder().encode(JSON.stringify(header));
  const bytes = new Uint8Array(4 + text.length + image.length + depths.length);
  new DataView(bytes.buffer).setUint32(0, text.length, true);
  bytes.set(text, 4);
  bytes.set(image, 4 + text.length);
  bytes.set(depths, 4 + text.length + image.length);
  return bytes.buffer;
}

const GOOD = { sequenceNumber: '3', frameNumber: '1', image: { type: 'image/png', bytes: 3 }, depthBytes: 4,
  depthGrid: { width: 2, height: 1, near: 1, far: 2 } };

test('a message is taken apart to the byte', () => {
  const { header, image, depths } = view.parseMessage(message(GOOD, Uint8Array.of(7, 8, 9), Uint8Array.of(1, 2, 255, 255)));
  assert.equal(header.sequenceNumber, '3');
  assert.deepEqual([...image], [7, 8, 9]);
  assert.deepEqual([...depths], [0x0201, 65535]);
  const error = view.parseMessage(message({ error: { code: 14, message: 'agent lost' }, frameNumber: '2' }));
  assert.equal(error.header.error.code, 14);
  assert.equal(error.image.length, 0);
});

test('a message that is none is refused with a sentence, never half taken', () => {
  const image = Uint8Array.of(7, 8, 9);
  const depths = Uint8Array.of(1, 2, 3, 4);
  const bad = [new ArrayBuffer(0), new ArrayBuffer(3), Uint8Array.of(255, 255, 255, 255, 1).buffer,
    message('no json'), message('null'), message('[1]'), message('7'), message('{"image":{"bytes":1}}'),
    message({ ...GOOD, image: { type: 'image/png', bytes: 4 } }, image, depths),
    message({ ...GOOD, image: { type: 'image/png', bytes: -3 } }, image, depths),
    message({ ...GOOD, image: { type: 'image/png', bytes: '3' } }, image, depths),
    message({ ...GOOD, image: { type: 'image/png', bytes: 1e300 } }, image, depths),
    message({ ...GOOD, image: { type: 'image/svg+xml', bytes: 3 } }, image, depths),
    message({ ...GOOD, image: { type: 'text/html', bytes: 3 } }, image, depths),
    message({ ...GOOD, depthBytes: 2 }, image, depths), message({ ...GOOD, depthBytes: 4.5 }, image, depths),
    message({ ...GOOD, depthGrid: { width: 3, height: 1 } }, image, depths),
    message({ ...GOOD, depthGrid: { width: -2, height: -1 } }, image, depths),
    message({ ...GOOD, depthGrid: undefined }, image, depths),
    message({ ...GOOD, frameNumber: 'x' }, image, depths), message({ ...GOOD, frameNumber: -1 }, image, depths),
    message(new TextDecoder('latin1').decode(Uint8Array.of(123, 34, 255)), image)];
  for (const buffer of bad) {
    assert.throws(() => view.parseMessage(buffer), /^Error: The server sent a message of \d+ bytes that is no frame: .+\.$/);
  }
});

test('any cut and any changed byte of a message gives a frame or a sentence', () => {
  const whole = new Uint8Array(message(GOOD, Uint8Array.of(7, 8, 9), Uint8Array.of(1, 2, 255, 255)));
  const attempt = (bytes) => {
    try {
      view.parseMessage(bytes.buffer);
    } catch (error) {
      assert.match(error.message, /^The server sent a message/);
    }
  };
  for (let end = 0; end < whole.length; ++end) {
    assert.throws(() => view.parseMessage(whole.slice(0, end).buffer), /^Error: The server sent/);
  }
  const random = makeRandom(7);
  for (let i = 0; i < 3000; ++i) {
    const bytes = whole.slice();
    for (let k = 0; k < 1 + random() * 3; ++k) {
      bytes[Math.floor(random() * bytes.length)] = Math.floor(random() * 256);
    }
    attempt(bytes);
  }
});

test('the worker is made of source that stands alone', () => {
  // As startWorker does it: nothing of the module may be in reach.
  const scope = { postMessage() {}, onmessage: null };
  new Function('self', workerSource())(scope);
  assert.equal(typeof scope.onmessage, 'function');
});

/** Frames of a view whose server only refuses. @param {import('node:test').TestContext} context */
function refusedFrames(context) {
  context.mock.timers.enable({ apis: ['setTimeout'] });
  const seen = { sent: 0, yielded: 0, problems: [] };
  const parts = { model: { camera: null }, picture: {}, stream: { of: () => undefined }, connection: { acknowledge() {} },
    notices: { endWaiting() {}, problem: (text) => seen.problems.push(text) },
    statistics: { counts: { bitmapsMade: 0, bitmapsClosed: 0, bytesReceived: 0, framesDropped: 0 }, decode: { add() {} } } };
  const frames = new Frames(/** @type {any} */ (parts), { arrived() {}, cameraTaken() {}, shown() {},
    changed: () => { seen.sent += 1; }, exhausted: () => { seen.yielded += 1; } });
  return { seen, refuse: (error) => frames.receive({ kind: 'frame', header: { sequenceNumber: '1', error }, bitmap: null, depths: [], bytes: 9, decodeMs: 0 }),
    wait: (ms) => context.mock.timers.tick(ms) };
}

test('a server whose queue is full is asked again for the same picture, when it says', (context) => {
  const { seen, refuse, wait } = refusedFrames(context);
  for (let i = 1; i <= 5; ++i) {
    refuse({ code: 8, message: 'full', reason: i % 2 ? 'TOO_BUSY' : 'RATE_LIMITED', retryDuration: '3.5s' });
    wait(3499);
    assert.equal(seen.sent, i - 1);
    wait(1);
    assert.equal(seen.sent, i);
  }
  assert.equal(seen.yielded, 0);
  assert.equal(seen.problems[0], 'Full. (RESOURCE_EXHAUSTED) Trying again.');
  refuse({ code: 8, message: 'full', reason: 'TOO_BUSY', retryDuration: '0s' });
  wait(249);
  assert.equal(seen.sent, 5, 'never at once, for ever');
  wait(1);
  assert.equal(seen.sent, 6);
});

test('a picture that is refused twice for its memory becomes smaller; older servers give no reason', (context) => {
  for (const reason of ['TOO_LARGE', undefined]) {
    const { seen, refuse, wait } = refusedFrames(context);
    refuse({ code: 8, message: 'never fits', reason });
    wait(2000);
    assert.deepEqual([seen.sent, seen.yielded], [1, 0]);
    refuse({ code: 8, message: 'never fits', reason });
    assert.equal(seen.yielded, 1);
    refuse({ code: 8, message: 'never fits', reason });
    refuse({ code: 8, message: 'full', reason: 'TOO_BUSY' });
    refuse({ code: 8, message: 'never fits', reason });
    assert.equal(seen.yielded, 1);
    context.mock.timers.reset();
  }
});

test('a picture of a level says so, and one of all samples says nothing', () => {
  assert.equal(levelText({ level: 2, maxSpacingPx: 0.8765 }), 'level 2, 1 sample = 0.88 px');
  assert.equal(levelText({ level: 11, maxSpacingPx: 123.4 }), 'level 11, 1 sample = 120 px');
  assert.equal(levelText({ level: 1 }), 'level 1', 'no part of the volume is in front of the eye');
  for (const exact of [{ maxSpacingPx: 3 }, { level: 0 }, {}, undefined]) {
    assert.equal(levelText(exact), '');
  }
});

test('what an error of a frame asks for', () => {
  assert.deepEqual(refusalOf({ code: 8, reason: 'TOO_BUSY', retryDuration: '0.5s' }), { isPassing: true, isTooLarge: false, retryMs: 500 });
  assert.deepEqual(refusalOf({ code: 8, reason: 'TOO_BUSY', retryDuration: '3600s' }).retryMs, 60000);
  assert.deepEqual(refusalOf({ code: 14, retryDuration: 'soon' }), { isPassing: true, isTooLarge: false, retryMs: 2000 });
  assert.deepEqual(refusalOf({}), { isPassing: false, isTooLarge: false, retryMs: 2000 });
});

test('a refusal is asked again after the time that it tells, and given up when that is too long', async () => {
  const answers = [];
  const asked = [];
  const saved = [globalThis.fetch, globalThis.document];
  globalThis.document = { baseURI: 'http://localhost/' };
  globalThis.fetch = async () => {
    asked.push(performance.now());
    const [status, body] = answers.shift();
    return new Response(JSON.stringify(body), { status });
  };
  const refusal = (ms) => [429, { code: 'RESOURCE_EXHAUSTED', message: 'full', retry_delay_ms: ms }];
  try {
    const client = new view.Client('http://localhost/');
    answers.push(refusal(40), refusal(5), [200, { datasets: [] }]);
    assert.deepEqual(await client.get('v1/datasets'), { datasets: [] });
    assert.equal(asked.length, 3);
    assert.ok(asked[1] - asked[0] >= 39, `${asked[1] - asked[0]} ms`);
    answers.push(refusal(3600000));
    await assert.rejects(client.get('v1/datasets'), { code: 'RESOURCE_EXHAUSTED', status: 429 });
    answers.push([429, { code: 'RESOURCE_EXHAUSTED', message: 'never fits' }]);
    await assert.rejects(client.get('v1/datasets'), { message: 'never fits' });
    const aborter = new AbortController();
    answers.push(refusal(20000));
    setTimeout(() => aborter.abort(), 10);
    await assert.rejects(client.post('v1/render', {}, aborter.signal), { name: 'AbortError' });
    assert.equal(asked.length, 6);
  } finally {
    [globalThis.fetch, globalThis.document] = saved;
  }
});

test('a refusal is not asked again behind a hidden tab', async () => {
  const saved = [globalThis.fetch, globalThis.document];
  const tab = Object.assign(new EventTarget(), { baseURI: 'http://localhost/', hidden: false });
  let asked = 0;
  globalThis.document = tab;
  globalThis.fetch = async () => {
    asked += 1;
    tab.hidden = asked === 1;
    return asked === 1 ? new Response(JSON.stringify({ code: 'RESOURCE_EXHAUSTED', message: 'full', retry_delay_ms: 1 }), { status: 429 })
      : new Response('{}');
  };
  try {
    const answer = new view.Client('http://localhost/').get('v1/datasets');
    await new Promise((resolve) => { setTimeout(resolve, 50); });
    tab.dispatchEvent(new Event('visibilitychange'));  // hidden still
    await new Promise((resolve) => { setTimeout(resolve, 10); });
    assert.equal(asked, 1);
    tab.hidden = false;
    tab.dispatchEvent(new Event('visibilitychange'));
    assert.deepEqual(await answer, {});
    assert.equal(asked, 2);
  } finally {
    [globalThis.fetch, globalThis.document] = saved;
  }
});

test('of many sentences a screen reader gets the first one, and after two seconds the newest', () => {
  const said = [];
  const waits = [];
  const announcer = new view.Announcer((sentence) => said.push(sentence), (action, ms) => waits.push([action, ms]));
  ['lost', 'a pick', 'another pick', 'back'].forEach((sentence) => announcer.say(sentence));
  assert.deepEqual(said, ['lost']);
  assert.equal(waits[0][1], 2000);
  waits.shift()[0]();
  assert.deepEqual(said, ['lost', 'back']);
  assert.equal(waits.length, 1);
  waits.shift()[0]();
  assert.deepEqual([said.length, waits.length], [2, 0]);
  announcer.say('later');
  assert.deepEqual(said, ['lost', 'back', 'later']);
});
