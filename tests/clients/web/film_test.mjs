// Films: the requests of their frames, and the APNG or WebP that the frames become.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { inflateSync } from 'node:zlib';

import { ApngWriter } from '../../../clients/web/apng.js';
import { MAX_FILM_PIXELS, drawFilm, frameCountOf, keptOf, orbited, requestOfFrame, whyNoFilm } from '../../../clients/web/film.js';
import { WebpWriter } from '../../../clients/web/webp.js';
import { encodeGreyWebp, encodePng } from './mock_gateway.mjs';

/** @param {Blob} blob */
const bytesOf = async (blob) => Buffer.from(await blob.arrayBuffer());

/** @param {number} width @param {number} height @param {number} level of all channels */
const png = (width, height, level) => new Uint8Array(encodePng(width, height, Buffer.alloc(3 * width * height, level)));

// CRC-32 bit by bit, as the PNG specification defines it.
function crcOf(bytes) {
  let c = 0xffffffff;
  for (const byte of bytes) {
    c ^= byte;
    for (let k = 0; k < 8; ++k) {
      c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1;
    }
  }
  return ~c >>> 0;
}

// Reads an APNG of whole frames: {width, height, plays, frames: [{delay, pixels}]}. Fails where a viewer may.
function readApng(file) {
  assert.deepEqual([...file.subarray(0, 8)], [137, 80, 78, 71, 13, 10, 26, 10]);
  const animation = { width: 0, height: 0, count: 0, plays: -1, frames: [] };
  let sequence = 0;
  let last = '';
  for (let at = 8; at < file.length;) {
    const size = file.readUInt32BE(at);
    last = file.toString('latin1', at + 4, at + 8);
    const data = file.subarray(at + 8, at + 8 + size);
    assert.equal(file.readUInt32BE(at + 8 + size), crcOf(file.subarray(at + 4, at + 8 + size)), `CRC of ${last}`);
    if (last === 'fcTL' || last === 'fdAT') {
      assert.equal(data.readUInt32BE(0), sequence++, `sequence number of ${last}`);
    }
    if (last === 'IHDR') {
      [animation.width, animation.height] = [data.readUInt32BE(0), data.readUInt32BE(4)];
    } else if (last === 'acTL') {
      [animation.count, animation.plays] = [data.readUInt32BE(0), data.readUInt32BE(4)];
    } else if (last === 'fcTL') {
      assert.deepEqual([4, 8, 12, 16].map((offset) => data.readUInt32BE(offset)), [animation.width, animation.height, 0, 0]);
      assert.deepEqual([...data.subarray(24)], [0, 0]);
      animation.frames.push({ delay: data.readUInt16BE(20) / data.readUInt16BE(22), parts: [] });
    } else if (last === 'IDAT' || last === 'fdAT') {
      assert.equal(last === 'IDAT', animation.frames.length === 1, 'the first frame alone has IDAT');
      animation.frames.at(-1).parts.push(last === 'IDAT' ? data : data.subarray(4));
    }
    at += 12 + size;
  }
  assert.equal(last, 'IEND');
  assert.equal(animation.count, animation.frames.length);
  return { ...animation, frames: animation.frames.map(({ delay, parts }) => ({ delay, pixels: inflateSync(Buffer.concat(parts)) })) };
}

test('two pictures of a pixel are the bytes that another program made, and text of the first one is left out', async () => {
  const red = 'iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAAAXNSR0IArs4c6QAAAAN0RVh0YQBi3EmiOwAAAA9JREFUeAEBBAD7/wD/AAADAQEAjR3lggAAAABJRU5ErkJggg==';
  const green = 'iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAAAXNSR0IArs4c6QAAAA9JREFUeAEBBAD7/wAA/wACAgEAQRXdQgAAAABJRU5ErkJggg==';
  const both = 'iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAAAXNSR0IArs4c6QAAAAhhY1RMAAAAAgAAAADzjZNwAAAAGmZjVEwAAAAAAAAAAQAAAAEAAAAAAAAA' +
    'AABkBOIAACM+3qIAAAAPSURBVHgBAQQA+/8A/wAAAwEBAI0d5YIAAAAaZmNUTAAAAAEAAAABAAAAAQAAAAAAAAAAAGQE4gAAuE00dgAAABNmZEFUAAAAAngBAQQA+/8AAP8AAgIBAI6Ggh4A' +
    'AAAASUVORK5CYII=';
  const writer = new ApngWriter({ frameCount: 2, framesPerSecond: 12.5 });
  for (const text of [red, green]) {
    writer.add(new Uint8Array(Buffer.from(text, 'base64')));
  }
  assert.equal((await bytesOf(writer.finish())).toString('base64'), both);
});

test('a film has the pixels of its frames, for ever, at its speed', async () => {
  const writer = new ApngWriter({ frameCount: 3, framesPerSecond: 12 });
  const frames = [10, 200, 77].map((level) => png(7, 5, level));
  frames.forEach((frame) => writer.add(frame));
  const film = readApng(await bytesOf(writer.finish()));
  assert.deepEqual([film.width, film.height, film.plays], [7, 5, 0]);
  film.frames.forEach(({ delay, pixels }, i) => {
    assert.ok(Math.abs(delay - 1 / 12) < 1e-9);
    assert.equal(pixels.length, 5 * (1 + 3 * 7));
    assert.equal(pixels[1], [10, 200, 77][i]);
  });
});

test('what is no picture like the first one is refused, and so is a film without all frames', () => {
  const writer = new ApngWriter({ frameCount: 2, framesPerSecond: 12 });
  const first = png(4, 4, 1);
  assert.throws(() => writer.finish(), /2 frames was given 0/);
  writer.add(first);
  for (let size = 0; size < first.length; ++size) {
    assert.throws(() => writer.add(first.slice(0, size)), /not a whole PNG/);
  }
  const long = first.slice();
  long.set([255, 255, 255, 255], 33);  // the length of IDAT
  assert.throws(() => writer.add(long), /not a whole PNG/);
  assert.throws(() => writer.add(png(4, 5, 1)), /another size/);
  const translucent = first.slice();
  translucent[25] = 6;
  assert.throws(() => writer.add(translucent), /other channels/);
  assert.throws(() => writer.finish(), /2 frames was given 1/);
});

/** @param {number} width @param {number} height @param {number} level */
const webp = (width, height, level) => new Uint8Array(encodeGreyWebp(width, height, level));

// Reads an animated WebP: {flags, width, height, plays, frames: [{width, height, ms, how, image}]}. Fails where a viewer may.
function readWebp(file) {
  const word = (at) => file.toString('latin1', at, at + 4);
  assert.deepEqual([word(0), file.readUInt32LE(4), word(8)], ['RIFF', file.length - 8, 'WEBP']);
  const film = { flags: -1, width: 0, height: 0, plays: -1, frames: [] };
  const order = [];
  for (let at = 12; at < file.length;) {
    const size = file.readUInt32LE(at + 4);
    assert.ok(at + 8 + size <= file.length);
    const data = file.subarray(at + 8, at + 8 + size);
    order.push(word(at));
    if (word(at) === 'VP8X') {
      Object.assign(film, { flags: data[0], width: data.readUIntLE(4, 3) + 1, height: data.readUIntLE(7, 3) + 1 });
      assert.equal(size, 10);
    } else if (word(at) === 'ANIM') {
      assert.equal(size, 6);
      film.plays = data.readUInt16LE(4);
    } else {
      assert.deepEqual([data.readUIntLE(0, 3), data.readUIntLE(3, 3)], [0, 0]);
      assert.equal(data.toString('latin1', 16, 20), 'VP8L');
      const length = data.readUInt32LE(20);
      assert.equal(size, 24 + length + length % 2);
      film.frames.push({ width: data.readUIntLE(6, 3) + 1, height: data.readUIntLE(9, 3) + 1, ms: data.readUIntLE(12, 3), how: data[15], image: data.subarray(24) });
    }
    at += 8 + size + size % 2;
  }
  assert.deepEqual(order, ['VP8X', 'ANIM', ...film.frames.map(() => 'ANMF')]);
  return film;
}

test('a WebP film has the images of its frames as they came, and as a whole the length of all', async () => {
  const writer = new WebpWriter({ frameCount: 7, framesPerSecond: 12 });
  const frames = [0, 1, 2, 3, 4, 5, 6].map((level) => webp(300, 70, 40 * level));
  frames.forEach((frame) => writer.add(frame));
  const film = readWebp(await bytesOf(writer.finish()));
  assert.deepEqual([film.flags, film.width, film.height, film.plays, film.frames.length], [2, 300, 70, 0, 7]);
  film.frames.forEach(({ width, height, how, image }, i) => {
    assert.deepEqual([width, height, how], [300, 70, 2]);
    assert.deepEqual([...image], [...frames[i].subarray(20)]);
  });
  // 7 / 12 s, whatever the rounding of each.
  assert.equal(film.frames.reduce((sum, { ms }) => sum + ms, 0), 583);
});

test('the image is found behind other chunks, and its alpha is told', async () => {
  const plain = webp(5, 4, 9);
  plain[24] |= 0x10;  // whether it has alpha
  const extended = Buffer.concat([Buffer.from('RIFF....WEBPVP8X\n\0\0\0'), Buffer.alloc(10), Buffer.from('ICCP\x03\0\0\0abc\0'), plain.subarray(12)]);
  const writer = new WebpWriter({ frameCount: 1, framesPerSecond: 0.1 });
  writer.add(new Uint8Array(extended));
  const film = readWebp(await bytesOf(writer.finish()));
  assert.deepEqual([film.flags, film.width, film.height, film.frames[0].ms], [18, 5, 4, 10000]);
});

test('what is no lossless WebP like the first one is refused, and so is a film without all frames', () => {
  const writer = new WebpWriter({ frameCount: 2, framesPerSecond: 12 });
  const first = webp(40, 40, 200);
  for (let size = 0; size < first.length; ++size) {
    assert.throws(() => writer.add(first.slice(0, size)), /not a whole lossless WebP/);
  }
  for (const [at, byte] of [[0, 0], [8, 0], [15, 32], [20, 0]]) {  // the last two: lossy, and no image at all
    const other = first.slice();
    other[at] = byte;
    assert.throws(() => writer.add(other), /not a whole lossless WebP/);
  }
  assert.throws(() => writer.add(png(4, 4, 1)), /not a whole lossless WebP/);
  writer.add(first);
  assert.throws(() => writer.add(webp(40, 41, 200)), /another size/);
  assert.throws(() => writer.finish(), /2 frames was given 1/);
});

const CAMERA = { eye: { x: 1, y: 2, z: 8 }, target: { x: 1, y: 2, z: 3 }, up: { x: 0, y: 2, z: 0 }, perspective: { fovYDegrees: 29.999999999999996 } };
const TURN = { format: 'apng', kind: 'turn', frameCount: 4, steps: [], framesPerSecond: 12, width: 6, height: 4 };

test('a turn goes around the target about up, to the side of the command line, and keeps all else', () => {
  const quarter = orbited(CAMERA, 90);
  assert.deepEqual({ ...quarter, eye: null }, { ...CAMERA, eye: null });
  for (const [axis, value] of Object.entries({ x: 6, y: 2, z: 3 })) {
    assert.ok(Math.abs(quarter.eye[axis] - value) < 1e-12, `${axis}: ${quarter.eye[axis]}`);
  }
  // Up need not be perpendicular, and is +y where a camera has none.
  const tilted = orbited({ eye: { x: 0, y: 3, z: 4 }, target: {} }, 180);
  assert.ok(Math.abs(tilted.eye.y - 3) < 1e-12 && Math.abs(tilted.eye.z + 4) < 1e-12);
});

test('later frames keep the fitted camera and the ranges of the first one, and no others', () => {
  const request = { cameraFit: 'CAMERA_FIT_CELLS', caps: { colorMap: 'COLOR_MAP_GREY', range: { percentiles: { low: 2, high: 98 } } }, surfaces: [
    { isovalue: 1, colorBy: { quantity: 'QUANTITY_POSITION_X', range: { source: 'SOURCE_VISIBLE' } } },
    { isovalue: 2, colorBy: { quantity: 'QUANTITY_POSITION_Y', range: { min: 3, max: 4 } } },
    { isovalue: 3, colorBy: { quantity: 'QUANTITY_POSITION_Z' } }, { isovalue: 4 }] };
  const headers = new Headers({ 'X-Isoscope-Camera': JSON.stringify(CAMERA), 'X-Isoscope-Color-Ranges': '{"0":[-1.5,7],"1":[0,9],"2":[0,1],"caps":[10,110]}' });
  const kept = keptOf(request, headers);
  assert.deepEqual([kept.camera, kept.cameraFit, kept.caps.range], [CAMERA, undefined, { min: 10, max: 110 }]);
  assert.deepEqual(kept.surfaces.map(({ colorBy }) => colorBy?.range), [{ min: -1.5, max: 7 }, { min: 3, max: 4 }, undefined, undefined]);
  const last = requestOfFrame(TURN, kept, 3);
  assert.deepEqual([last.caps.range, last.camera.up, last.cameraFit], [{ min: 10, max: 110 }, CAMERA.up, undefined]);
  assert.equal(requestOfFrame(TURN, request, 0).cameraFit, 'CAMERA_FIT_CELLS');
});

test('a film of steps shows each of its steps of the same field', () => {
  const film = { ...TURN, kind: 'steps', steps: [0, 3, 9] };
  assert.equal(frameCountOf(film), 3);
  const request = { camera: CAMERA, selection: { field: 'velocity', component: 'x', time: 0.25 } };
  assert.deepEqual([0, 1, 2].map((i) => requestOfFrame(film, request, i).selection),
    [0, 3, 9].map((timeStep) => ({ field: 'velocity', component: 'x', timeStep })));
  assert.deepEqual(requestOfFrame(film, request, 2).camera, CAMERA);
});

test('a film that the page could not hold is refused with its size, and 72 frames of 4K are not', () => {
  assert.equal(whyNoFilm(TURN), '');
  assert.equal(whyNoFilm({ ...TURN, frameCount: 72, width: 3840, height: 2160 }), '');
  const why = whyNoFilm({ ...TURN, frameCount: 72, width: 7680, height: 4320 });
  for (const words of ['72 frames of 7680 × 4320', '2389 million', `${MAX_FILM_PIXELS / 1e6} million`, 'smaller or shorter']) {
    assert.ok(why.includes(words), why);
  }
  for (const [part, words] of [[{ frameCount: 1 }, /2 to 3600 frames.* 1\./], [{ frameCount: NaN }, /none/], [{ frameCount: 2.5 }, /2\.5/], [{ frameCount: 3601 }, /3601/],
    [{ framesPerSecond: 0 }, /a second/], [{ framesPerSecond: NaN }, /a second/], [{ framesPerSecond: 121 }, /a second/],
    [{ kind: 'steps', steps: [4] }, /2 to 3600/]]) {
    assert.match(whyNoFilm({ ...TURN, ...part }), words);
  }
});

/** @param {(i: number) => Response} answerOf @param {any[]} [asked] */
const drawer = (answerOf, asked = []) => async (request) => answerOf(asked.push(request) - 1);
const answer = (i) => new Response(png(6, 4, 40 * i), { headers: { 'X-Isoscope-Camera': JSON.stringify(CAMERA) } });
const STATE = { dataset: 'ball', surfaces: [{ isovalue: 5 }], cameraFit: 'CAMERA_FIT_CELLS', backgroundColor: { red: 1, green: 1, blue: 1, alpha: 0 } };

test('a turn asks for opaque frames of one size, the first as it is and the others around its camera, and tells each', async () => {
  const asked = [];
  const told = [];
  const film = await drawFilm(TURN, STATE, drawer(answer, asked), new AbortController().signal, (done) => told.push(done));
  assert.deepEqual(told, [0, 1, 2, 3]);
  assert.deepEqual(asked[0], { ...STATE, backgroundColor: { red: 1, green: 1, blue: 1, alpha: 1 }, viewport: { widthPx: 6, heightPx: 4 } });
  assert.deepEqual(asked.map(({ camera }) => camera && Math.round(camera.eye.x)), [undefined, 6, 1, -4]);
  assert.ok(asked.slice(1).every(({ cameraFit, backgroundColor }) => cameraFit === undefined && backgroundColor.alpha === 1));
  assert.deepEqual(readApng(await bytesOf(film)).frames.map(({ pixels }) => pixels[1]), [0, 40, 80, 120]);
  assert.equal(film.type, 'image/apng');
});

test('frames of a WebP film are asked for with camera and ranges, for which one picture comes before', async () => {
  const asked = [];
  const draw = async (request, format) => {
    asked.push([format, request]);
    const headers = { 'X-Isoscope-Camera': JSON.stringify(CAMERA), 'X-Isoscope-Color-Ranges': '{"0":[1,2]}' };
    return new Response(format === 'webp' ? webp(6, 4, 40 * asked.length) : png(6, 4, 1), { headers });
  };
  const film = { ...TURN, format: 'webp' };
  const open = { ...STATE, surfaces: [{ isovalue: 5, colorBy: { quantity: 'QUANTITY_FIELD', field: 'p', range: { source: 'SOURCE_VISIBLE' } } }] };
  const file = await drawFilm(film, open, draw, new AbortController().signal, () => {});
  assert.deepEqual(asked.map(([format]) => format), ['png', 'webp', 'webp', 'webp', 'webp']);
  for (const [, { camera, cameraFit, surfaces }] of asked.slice(1)) {
    assert.deepEqual([camera.target, cameraFit, surfaces[0].colorBy.range], [CAMERA.target, undefined, { min: 1, max: 2 }]);
  }
  assert.deepEqual(asked[1][1].camera, CAMERA);
  assert.equal(readWebp(await bytesOf(file)).frames.length, 4);
  assert.equal(file.type, 'image/webp');
  asked.length = 0;
  await drawFilm(film, { dataset: 'ball', surfaces: [{ isovalue: 5 }], camera: CAMERA }, draw, new AbortController().signal, () => {});
  assert.deepEqual(asked.map(([format]) => format), ['webp', 'webp', 'webp', 'webp'], 'a picture for nothing');
  assert.match(whyNoFilm({ ...film, width: 16384 }), /at most 16383/);
  assert.equal(whyNoFilm({ ...TURN, width: 16384 }), '');
});

test('a frame that fails is named, and none is asked for after it', async () => {
  const asked = [];
  const fail = drawer((i) => {
    if (i === 2) {
      throw new Error('no agent serves shard 3');
    }
    return answer(i);
  }, asked);
  await assert.rejects(drawFilm(TURN, STATE, fail, new AbortController().signal, () => {}), { message: 'Frame 3 of 4: no agent serves shard 3' });
  assert.equal(asked.length, 3);
  await assert.rejects(drawFilm(TURN, STATE, drawer(() => new Response('a page')), new AbortController().signal, () => {}), /Frame 1 of 4: .*PNG/);
});

test('a film that is cancelled asks for no other frame', async () => {
  const abort = new AbortController();
  const asked = [];
  const draw = drawer((i) => {
    if (i === 1) {
      abort.abort();
      abort.signal.throwIfAborted();
    }
    return answer(i);
  }, asked);
  await assert.rejects(drawFilm(TURN, STATE, draw, abort.signal, () => {}), { name: 'AbortError' });
  assert.equal(asked.length, 2);
});
