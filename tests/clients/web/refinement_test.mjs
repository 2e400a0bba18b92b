// Pictures that refine, without a browser: what is asked for, what is counted, what people read, and which tiles are shown.
import assert from 'node:assert/strict';
import { test } from 'node:test';

import { DEFAULT_LIMITS, levelKey, levelMenu, levelOfKey, limitsOfText, textOfLimits, unresolvedText } from '../../../clients/web/levels.js';
import { stateFromHash, stateToLink } from '../../../clients/web/view-state.js';
import { cameraToJson } from '../../../clients/web/view/camera.js';
import { Frames } from '../../../clients/web/view/frames.js';
import { Model } from '../../../clients/web/view/model.js';
import { Refinement, costText, pictureText } from '../../../clients/web/view/refinement.js';
import { StateStream } from '../../../clients/web/view/state-stream.js';
import { parseMessage, workerMain } from '../../../clients/web/view/worker.js';
import { meshAddress } from '../../../clients/web/view-state.js';

const CAMERA = { eye: [0, 0, 5], target: [0, 0, 0], up: [0, 1, 0], fovYDegrees: 30, height: 0 };

// ---- states and pictures ----

/** @param {string} text */
const stateOf = (text) => JSON.parse(text).viewState;

test('states with the same request are of one picture, whatever the order of its members', () => {
  const stream = new StateStream();
  stream.next({ dataset: 'a', surfaces: [{ isovalue: 1 }], samples: undefined }, 30);
  stream.next({ surfaces: [{ isovalue: 1 }], dataset: 'a' }, 30);
  assert.equal(stream.picture, 1);
  assert.ok(stream.isSame({ dataset: 'a', surfaces: [{ isovalue: 1 }] }));
  stream.next({ dataset: 'a', surfaces: [{ isovalue: 2 }] }, 30);
  assert.equal(stream.picture, 2);
  assert.deepEqual([1, 2, 3].map((sequence) => stream.of(sequence)?.picture), [1, 1, 2]);
});

test('the request of the last state, without the camera that the server chose, is of the same picture', () => {
  const stream = new StateStream();
  assert.equal(stream.frame, null);
  stream.next({ dataset: 'a', cameraFit: 'CAMERA_FIT_CELLS' }, 30);
  stream.next(stream.frame ?? {}, 30);
  assert.deepEqual([stream.frame, stream.picture], [{ dataset: 'a', cameraFit: 'CAMERA_FIT_CELLS' }, 1]);
  stream.clear();
  assert.equal(stream.frame, null, 'another connection has no state');
});

test('a new picture has a request of its own, also where a server would see none', () => {
  const stream = new StateStream();
  const refinement = new Refinement();
  const send = (frame) => stateOf(stream.next(frame, 30, refinement)).frame;
  assert.equal(send({ dataset: 'a' }).raySeed, undefined);
  // A zero is as good as none: the server compares bytes.
  assert.equal(send({ dataset: 'a', isovalue: 0 }).raySeed, '1');
  assert.equal(send({ dataset: 'a', isovalue: 0 }).raySeed, '1', 'the same picture');
  assert.equal(send({ dataset: 'a' }).raySeed, '2');
  assert.equal(send({ dataset: 'b' }).raySeed, undefined);
  stream.renew();
  assert.equal(send({ dataset: 'b' }).raySeed, '1', 'a picture that was lost is asked for anew');
  stream.clear();
  assert.equal(send({ dataset: 'b' }).raySeed, undefined, 'another connection knows none');
  assert.equal(stream.picture, 6);
});

test('a server that does not refine gets states as before', () => {
  const stream = new StateStream();
  stream.next({ dataset: 'a' }, 30);
  const state = stateOf(stream.next({ dataset: 'a', isovalue: 0 }, 30));
  assert.deepEqual(state, { sequenceNumber: '2', frame: { dataset: 'a', isovalue: 0 }, targetFramesPerSecond: 30 });
});

// ---- what is asked for, and what has come ----

test('limits and the pointer are asked for, and a lift is for one picture', () => {
  const refinement = new Refinement({ seconds: 10, bytes: 4e9 });
  const all = { coarseLevels: true, tiles: true };
  const limits = { maxExactBytes: '4000000000', maxExactDuration: '10.000s' };
  assert.deepEqual(refinement.toJson(1), { ...all, ...limits });
  refinement.focus = { x: 0.25, y: 1 };
  refinement.lift();
  assert.deepEqual(refinement.toJson(1), { ...all, focus: { x: 0.25, y: 1 } });
  assert.deepEqual(refinement.toJson(1), { ...all, focus: { x: 0.25, y: 1 } }, 'a pointer that moves takes nothing back');
  refinement.focus = null;
  assert.deepEqual(refinement.toJson(2), { ...all, ...limits }, 'another view has its limits again');
  assert.equal(refinement.setLimits({ seconds: null, bytes: 1e9 }), true);
  assert.deepEqual(refinement.toJson(2), { ...all, maxExactBytes: '1000000000' });
});

test('tiles count once each, for their picture only, and the exact frame ends the count', () => {
  const refinement = new Refinement();
  assert.equal(refinement.progressOf(1), null);
  refinement.takeTile(1, 0, 40);
  refinement.takeTile(1, 7, 40);
  refinement.takeTile(1, 7, 40);
  assert.deepEqual(refinement.progressOf(1), { done: 2, count: 40 });
  assert.equal(refinement.progressOf(2), null);
  refinement.takeDeferred(2, { expectedBytes: '2100000000', expectedDuration: '40.5s', drawnLevel: { level: 2 } });
  assert.equal(refinement.progressOf(1), null);
  assert.deepEqual(refinement.deferredOf(2), { bytes: 2.1e9, seconds: 40.5, drawnLevel: { level: 2 } });
  refinement.lift();
  assert.equal(refinement.deferredOf(2), null);
  refinement.takeTile(2, 0, 4);
  refinement.complete(2);
  assert.equal(refinement.progressOf(2), null);
});

test('limits that stay the same keep what was told of them: the server does not repeat it', () => {
  const refinement = new Refinement({ seconds: 10, bytes: null });
  refinement.takeDeferred(1, { expectedBytes: '5' });
  assert.equal(refinement.setLimits({ seconds: 10, bytes: null }), false);
  assert.equal(refinement.deferredOf(1)?.bytes, 5);
  assert.equal(refinement.setLimits({ seconds: 11, bytes: null }), true);
  assert.equal(refinement.deferredOf(1), null);
});

// ---- words ----

test('what people read of a picture', () => {
  const progress = { done: 12, count: 40 };
  const drawnLevel = { level: 2, maxSpacingPx: 0.9 };
  assert.equal(pictureText({ isExact: false, drawnLevel, progress: null }), 'level 2, 1 sample = 0.9 px');
  assert.equal(pictureText({ isExact: false, drawnLevel, progress }), 'exact 12 of 40');
  assert.equal(pictureText({ isExact: true, drawnLevel: { maxSpacingPx: 0.2 }, progress: null }), 'exact');
  assert.equal(pictureText({ isExact: true, drawnLevel: { level: 1 }, progress }), 'exact at level 1');
  assert.equal(pictureText({ isExact: false, drawnLevel: {}, progress: null }), '');
  assert.equal(costText({ bytes: 2.1e9, seconds: 40.2 }), '2.1 GB, about 40 s');
  assert.equal(costText({ bytes: 2.04e12, seconds: 1260 }), '2 TB, about 21 min');
  assert.equal(costText({ bytes: 950, seconds: 20000 }), '950 B, about 5.6 h');
  assert.equal(costText({ bytes: 5e6, seconds: 0 }), '5 MB', 'a time that is not known is not told');
});

test('limits are in a link where they are not those of the page, and come back', () => {
  const state = { dataset: 'a', surfaces: [{ isovalue: 1 }] };
  assert.equal(stateToLink(state, null, DEFAULT_LIMITS), 'dataset=a&surface=1');
  assert.equal(textOfLimits(), '');
  for (const [limits, word] of /** @type {[any, string][]} */ ([[{ seconds: 60, bytes: null }, '60,none'], [{ seconds: null, bytes: 2.5e9 }, 'none,2.5'],
    [{ seconds: null, bytes: null }, 'none,none']])) {
    const link = stateToLink(state, null, limits);
    assert.equal(link, `dataset=a&surface=1&exact-limit=${word}`);
    assert.deepEqual(stateFromHash(link), { state, problems: [], limits });
  }
  for (const wrong of ['', '5', '5,6,7', '0,1', '-1,1', 'x,1', '1,NaN', '1,', 'none']) {
    assert.equal(limitsOfText(wrong), null, wrong);
  }
  assert.match(stateFromHash('exact-limit=5').problems[0], /^exact-limit=5 .*seconds and gigabytes/);
});

test('the menu has the levels of the dataset, and none where there are none', () => {
  assert.deepEqual(levelMenu({}), []);
  assert.deepEqual(levelMenu(null), []);
  const menu = levelMenu({ levels: [{ level: 1, geometry: { sampleDims: { x: '32', y: '31', z: '30' } } }, { level: 2 }] });
  assert.deepEqual(menu, [['finest', 'finest (exact)'], ['spacing', 'by spacing'], ['1', 'level 1: 32 × 31 × 30'], ['2', 'level 2']]);
  for (const [key, choice] of /** @type {[string, any][]} */ ([['finest', undefined], ['spacing', { maxSpacingPx: 1.1 }], ['2', { level: 2 }]])) {
    assert.deepEqual(levelOfKey(key, 1.1), choice);
    assert.equal(levelKey(choice), key);
  }
  assert.equal(levelKey({ level: 0 }), 'finest');
});

test('a mesh is of the level that the view names, and of all samples else', () => {
  const state = { dataset: 'a', surfaces: [{ isovalue: 1 }] };
  assert.equal(meshAddress({ ...state, level: { level: 2 } }, 'ply'), 'v1/datasets/a/mesh.ply?surface=1&level=2');
  for (const level of [{ level: 0 }, { maxSpacingPx: 2 }, undefined]) {
    assert.equal(meshAddress({ ...state, level }, 'ply'), 'v1/datasets/a/mesh.ply?surface=1');
  }
});

test('what a level hides is said where it is known', () => {
  assert.equal(unresolvedText({ unresolvedBlockCount: '37' }), '37 blocks of the surface are not resolved at this level.');
  assert.equal(unresolvedText({ unresolvedBlockCount: '1' }), '1 block of the surface is not resolved at this level.');
  assert.equal(unresolvedText({}) + unresolvedText(undefined), '');
});

// ---- frames and tiles ----

function makeView() {
  const log = [];
  const stream = new StateStream();
  const refinement = new Refinement();
  const model = new Model();
  model.replace({ dataset: 'a', camera: cameraToJson(CAMERA) }, 1);
  const problems = [];
  const parts = { model, stream, refinement, connection: { acknowledge: ({ header }) => log.push(`shown ${header.frameNumber}`) },
    picture: { frame: null, show: (bitmap, frame) => { log.push(`frame ${frame.width}`); }, paint: (bitmap, at, frame) => { log.push(`tile ${at.x},${at.y} of ${frame.width}`); } },
    notices: { endWaiting() {}, framed() {}, problem: (text) => problems.push(text) },
    statistics: { counts: { bitmapsMade: 0, bitmapsClosed: 0, bytesReceived: 0, framesDropped: 0, tilesShown: 0 }, decode: { add() {} }, roundTrip: { add() {} }, shown() {} } };
  const frames = new Frames(/** @type {any} */ (parts), { arrived() {}, changed() {}, exhausted() {}, cameraTaken() {}, shown() {}, refined: () => log.push('refined') });
  let number = 0;
  const receive = (header, size) => frames.receive({ kind: 'frame', depths: [], bytes: 9, decodeMs: 0, receivedAt: 0,
    header: { sequenceNumber: String(stream.sequence), frameNumber: String(number += 1), ...header },
    bitmap: size ? { width: size, height: size, close() {} } : null });
  const extent = { widthPx: 128, heightPx: 128 };
  const tile = (index, x, y, more = {}) => receive({ tile: { region: { x, y, widthPx: 64, heightPx: 64 }, index, count: 4, extent, camera: cameraToJson(CAMERA) }, ...more }, 64);
  const send = (isovalue) => stream.next({ surfaces: [{ isovalue }] }, 30, refinement);
  return { log, stream, refinement, frames, receive, tile, send, problems, counts: parts.statistics.counts };
}
const whole = (isExact) => ({ isExact, frame: { camera: cameraToJson(CAMERA) } });

test('tiles are painted over the frame before them, and the exact frame replaces all', () => {
  const { log, stream, refinement, frames, receive, tile, send, counts } = makeView();
  send(1);
  receive(whole(false), 64);
  tile(0, 0, 0);
  tile(1, 64, 64);
  frames.show();
  assert.deepEqual(log, ['frame 64', 'shown 1', 'shown 2', 'tile 0,0 of 128', 'shown 3', 'tile 64,64 of 128', 'refined']);
  assert.deepEqual(refinement.progressOf(stream.picture), { done: 2, count: 4 });
  assert.equal(frames.shownPicture, stream.picture);
  tile(2, 0, 64);
  receive(whole(true), 128);
  assert.equal(frames.hasArrived, true);
  frames.show();
  assert.deepEqual(log.slice(7), ['shown 4', 'frame 128', 'shown 5'], 'a tile that waits gives way to all of it');
  assert.equal(refinement.progressOf(stream.picture), null);
  assert.equal(counts.bitmapsClosed, counts.bitmapsMade);
});

test('tiles of a picture that is not the view\'s any more are acknowledged and not painted', () => {
  const { log, frames, tile, send } = makeView();
  send(1);
  send(2);
  tile(0, 0, 0, { sequenceNumber: '1' });
  tile(0, 0, 0, { sequenceNumber: '99' });
  frames.show();
  assert.deepEqual(log, ['shown 1', 'shown 2', 'refined']);
});

test('tiles go on under a newer state of the same picture', () => {
  const { log, stream, refinement, frames, tile, send } = makeView();
  send(1);
  tile(0, 0, 0);
  frames.show();
  send(1);
  tile(1, 64, 0);
  frames.show();
  assert.deepEqual(log.filter((one) => one.startsWith('tile')), ['tile 0,0 of 128', 'tile 64,0 of 128']);
  assert.deepEqual(refinement.progressOf(stream.picture), { done: 2, count: 4 });
});

test('a tile outside of its picture is refused with a sentence', () => {
  for (const [x, y] of [[65, 0], [0, 65], [-1, 0]]) {
    const { log, frames, tile, send, problems } = makeView();
    send(1);
    tile(0, x, y);
    frames.show();
    assert.match(problems[0], /a tile that lies outside/);
    assert.deepEqual(log, ['shown 1', 'refined']);
  }
});

test('a deferred frame is told, and needs no answer', () => {
  const { log, stream, refinement, receive, send } = makeView();
  send(1);
  receive({ exactDeferred: { expectedBytes: '5', expectedDuration: '2s' } });
  assert.deepEqual(log, ['refined']);
  assert.deepEqual(refinement.deferredOf(stream.picture), { bytes: 5, seconds: 2, drawnLevel: undefined });
  send(2);
  receive({ sequenceNumber: '1', exactDeferred: { expectedBytes: '7' } });
  assert.deepEqual(log, ['refined'], 'that of another picture is none of this one');
});

// ---- the worker ----

test('the worker keeps tiles behind their frame while it decodes, and a frame drops them', async (context) => {
  const resolvers = [];
  globalThis.createImageBitmap = () => new Promise((resolve) => resolvers.push(() => resolve({ close() {} })));
  context.after(() => { delete globalThis.createImageBitmap; });
  const seen = [];
  const scope = { onmessage: null, postMessage: (message) => seen.push(message.kind === 'frame' ? `frame ${message.header.frameNumber}`
    : message.kind === 'outgoing' ? `shown ${JSON.parse(message.text).frameShown.frameNumber}` : message.kind) };
  workerMain(scope, parseMessage);
  const push = (frameNumber, more = {}) => {
    const json = new TextEncoder().encode(JSON.stringify({ frameNumber: String(frameNumber), image: { type: 'image/png', bytes: 1 }, ...more }));
    const bytes = new Uint8Array(5 + json.length);
    new DataView(bytes.buffer).setUint32(0, json.length, true);
    bytes.set(json, 4);
    scope.onmessage({ data: { kind: 'data', buffer: bytes.buffer } });
  };
  const decodeOne = async () => {
    resolvers.shift()();
    await new Promise((resolve) => { setImmediate(resolve); });
  };
  push(1);
  push(2);
  push(3, { tile: {} });
  push(4, { exactDeferred: {} });
  for (let i = 0; i < 4; ++i) {
    await decodeOne();
  }
  assert.deepEqual(seen, ['frame 1', 'frame 2', 'frame 3', 'frame 4']);
  push(5);
  push(6, { tile: {} });
  push(7, { tile: {} });
  push(8);
  await decodeOne();
  await decodeOne();
  assert.deepEqual(seen.slice(4), ['dropped', 'shown 6', 'dropped', 'shown 7', 'frame 5', 'frame 8']);
});
