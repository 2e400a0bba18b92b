// PNG pictures as one animated PNG (APNG), in the very bytes of `isoscope render --output turn.apng`:
//
//   signature, IHDR, sRGB        of the first frame
//   acTL  frames, plays (0: for ever)
//   fcTL 0, IDAT ...             first frame, also what other programs show
//   fcTL 1, fdAT 2, fdAT 3 ...   second frame: a sequence number before the bytes of each IDAT
//   ...
//   IEND
//
// Pixels are not decoded: a frame is as exact as its picture. All frames share one IHDR: size and colour type.
// Source: the PNG specification, third edition, sections 5.3 and 11.3.5.
// @ts-check

/** @typedef {{type: string, data: Uint8Array, bytes: Uint8Array}} Chunk `bytes`: with length, type and CRC */

const SIGNATURE = Uint8Array.of(137, 80, 78, 71, 13, 10, 26, 10);
const IHDR_BYTES = 13;
/** A delay is a fraction of two 16-bit numbers: so many hundredths of a frame. */
const DELAY_NUMERATOR = 100;

const CRC_TABLE = Uint32Array.from({ length: 256 }, (_, n) => {
  let c = n;
  for (let k = 0; k < 8; ++k) {
    c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1;
  }
  return c;
});

/** @param {Uint8Array} bytes */
function crc32(bytes) {
  let c = 0xffffffff;
  for (let i = 0; i < bytes.length; ++i) {
    c = CRC_TABLE[(c ^ bytes[i]) & 255] ^ (c >>> 8);
  }
  return ~c >>> 0;
}

/** @param {number[]} values of 32 bits, big-endian */
function words(...values) {
  const bytes = new Uint8Array(4 * values.length);
  const view = new DataView(bytes.buffer);
  values.forEach((value, i) => view.setUint32(4 * i, value));
  return bytes;
}

/** @param {Uint8Array[]} parts */
function joined(...parts) {
  const bytes = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    bytes.set(part, at);
    at += part.length;
  }
  return bytes;
}

/** @param {string} type of four letters @param {Uint8Array[]} data */
function chunkOf(type, ...data) {
  const body = joined(Uint8Array.from(type, (letter) => letter.charCodeAt(0)), ...data);
  return joined(words(body.length - 4), body, words(crc32(body)));
}

/** @param {Uint8Array} png @returns {Chunk[]} [] if it is none */
function chunksOf(png) {
  /** @type {Chunk[]} */
  const chunks = [];
  const view = new DataView(png.buffer, png.byteOffset, png.byteLength);
  let at = SIGNATURE.every((byte, i) => png[i] === byte) ? SIGNATURE.length : png.length;
  while (at + 12 <= png.length) {
    const end = at + 12 + view.getUint32(at);
    if (end > png.length) {
      return [];
    }
    const type = String.fromCharCode(...png.subarray(at + 4, at + 8));
    chunks.push({ type, data: png.subarray(at + 8, end - 4), bytes: png.subarray(at, end) });
    at = end;
  }
  const isWhole = chunks[0]?.type === 'IHDR' && chunks[0].data.length === IHDR_BYTES && chunks.at(-1)?.type === 'IEND';
  return isWhole && chunks.some(({ type }) => type === 'IDAT') ? chunks : [];
}

/** Takes pictures one by one. Each becomes a Blob, which browsers may keep on disk. */
export class ApngWriter {
  /** @type {Blob[]} */
  #parts = [];
  #added = 0;
  #sequence = 0;
  /** The data of the first IHDR. */
  #header = new Uint8Array();
  #frameCount;
  #delayDenominator;

  /** @param {{frameCount: number, framesPerSecond: number}} options at least one frame; 0.1 to 120 of them a second */
  constructor({ frameCount, framesPerSecond }) {
    this.#frameCount = frameCount;
    this.#delayDenominator = Math.round(DELAY_NUMERATOR * framesPerSecond);
  }

  /**
   * Throws an Error if it is no PNG, or of another size or colour type than the first one.
   * @param {Uint8Array} png
   */
  add(png) {
    const chunks = chunksOf(png);
    if (chunks.length === 0) {
      throw new Error('the answer is not a whole PNG.');
    }
    const out = this.#added === 0 ? this.#head(chunks) : [];
    if (!chunks[0].data.every((byte, i) => byte === this.#header[i])) {
      throw new Error('the picture has another size or other channels than the first frame.');
    }
    out.push(this.#frameControl());
    for (const { type, data, bytes } of chunks) {
      if (type === 'IDAT') {
        out.push(this.#added === 0 ? bytes : chunkOf('fdAT', words(this.#sequence++), data));
      }
    }
    this.#added += 1;
    this.#parts.push(new Blob(out));
  }

  /** @returns {Blob} the file. Throws an Error if frames are missing. */
  finish() {
    if (this.#added !== this.#frameCount) {
      throw new Error(`An animation of ${this.#frameCount} frames was given ${this.#added}.`);
    }
    return new Blob([...this.#parts, chunkOf('IEND')], { type: 'image/apng' });
  }

  /** @param {Chunk[]} chunks of the first frame, of which text is left out */
  #head(chunks) {
    this.#header = chunks[0].data.slice();
    return [SIGNATURE, ...chunks.filter(({ type }) => type === 'IHDR' || type === 'sRGB').map(({ bytes }) => bytes),
      chunkOf('acTL', words(this.#frameCount, 0))];
  }

  /** The whole picture at (0, 0), written over the frame before. */
  #frameControl() {
    const size = this.#header.subarray(0, 8);
    return chunkOf('fcTL', words(this.#sequence++), size, words(0, 0, DELAY_NUMERATOR * 65536 + this.#delayDenominator), new Uint8Array(2));
  }
}
