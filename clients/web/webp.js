// WebP pictures, each one lossless image, as one animated WebP:
//
//   RIFF size WEBP
//   VP8X  flags, 0 0 0, width - 1, height - 1                                the sides in 24 bits, little-endian
//   ANIM  background (4 bytes), plays (2 bytes; 0: for ever)
//   ANMF  x, y, width - 1, height - 1, milliseconds (24 bits each), how,     one for each frame,
//         VP8L ...                                                           with its image as it came
//
// Pixels are not decoded: a frame is as exact as its picture. A chunk of odd size has a zero behind it.
// Source: RFC 9649, sections 2.7 and 3.4.
// @ts-check

const HEADER_BYTES = 12;
const VP8L_SIGNATURE = 0x2f;
const FLAG_ANIMATION = 2;
const FLAG_ALPHA = 16;
/** The frame replaces all before it, and nothing of it is mixed. */
const NO_BLEND = 2;
const MAX_RIFF_BYTES = 2 ** 32 - 10;

/** @param {number} value @param {number} count of bytes, little-endian */
const little = (value, count) => Array.from({ length: count }, (_, i) => Math.floor(value / 256 ** i) % 256);
/** @param {string} text */
const letters = (text) => Array.from(text, (letter) => letter.charCodeAt(0));
/** @param {string} type @param {number[]} data of an even count */
const riffOf = (type, data) => [...letters(type), ...little(data.length, 4), ...data];

/**
 * @param {Uint8Array} webp @returns {{width: number, height: number, hasAlpha: boolean, bytes: Uint8Array} | null} the chunk
 *   VP8L with its padding; null if there is no whole one
 */
function losslessImageOf(webp) {
  const view = new DataView(webp.buffer, webp.byteOffset, webp.byteLength);
  const word = (/** @type {number} */ at) => String.fromCharCode(...webp.subarray(at, at + 4));
  if (word(0) !== 'RIFF' || word(8) !== 'WEBP') {
    return null;
  }
  for (let at = HEADER_BYTES; at + 8 <= webp.length;) {
    const size = view.getUint32(at + 4, true);
    const end = at + 8 + size + size % 2;
    if (end > webp.length) {
      return null;
    }
    if (word(at) === 'VP8L' && size >= 5 && webp[at + 8] === VP8L_SIGNATURE) {
      // Width - 1 and height - 1 in 14 bits each, then whether it has alpha.
      const bits = view.getUint32(at + 9, true);
      return { width: bits % 16384 + 1, height: (bits >>> 14) % 16384 + 1, hasAlpha: (bits >>> 28) % 2 === 1, bytes: webp.subarray(at, end) };
    }
    at = end;
  }
  return null;
}

/** Takes pictures one by one. Each becomes a Blob, which browsers may keep on disk. */
export class WebpWriter {
  /** @type {Blob[]} */
  #parts = [];
  #width = 0;
  #height = 0;
  #hasAlpha = false;
  #frameCount;
  #framesPerSecond;

  /** @param {{frameCount: number, framesPerSecond: number}} options at least one frame; 0.1 to 120 of them a second */
  constructor({ frameCount, framesPerSecond }) {
    this.#frameCount = frameCount;
    this.#framesPerSecond = framesPerSecond;
  }

  /**
   * Throws an Error if it is no lossless WebP, or of another size than the first one.
   * @param {Uint8Array} webp
   */
  add(webp) {
    const image = losslessImageOf(webp);
    if (!image) {
      throw new Error('the answer is not a whole lossless WebP.');
    }
    const { width, height, hasAlpha, bytes } = image;
    if (this.#parts.length === 0) {
      [this.#width, this.#height] = [width, height];
    }
    if (width !== this.#width || height !== this.#height) {
      throw new Error('the picture has another size than the first frame.');
    }
    this.#hasAlpha ||= hasAlpha;
    const head = [...little(0, 6), ...little(width - 1, 3), ...little(height - 1, 3), ...little(this.#durationMs, 3), NO_BLEND];
    this.#parts.push(new Blob([Uint8Array.from([...letters('ANMF'), ...little(head.length + bytes.length, 4), ...head]), bytes]));
  }

  /** Whole milliseconds of the frame that comes: film and frames begin at the nearest ones. */
  get #durationMs() {
    const begin = (/** @type {number} */ i) => Math.round(1000 * i / this.#framesPerSecond);
    return begin(this.#parts.length + 1) - begin(this.#parts.length);
  }

  /** @returns {Blob} the file. Throws an Error if frames are missing, or if it is longer than a WebP can be. */
  finish() {
    if (this.#parts.length !== this.#frameCount) {
      throw new Error(`An animation of ${this.#frameCount} frames was given ${this.#parts.length}.`);
    }
    const head = [...riffOf('VP8X', [FLAG_ANIMATION + (this.#hasAlpha ? FLAG_ALPHA : 0), 0, 0, 0, ...little(this.#width - 1, 3), ...little(this.#height - 1, 3)]),
      ...riffOf('ANIM', little(0, 6))];
    const size = this.#parts.reduce((sum, part) => sum + part.size, letters('WEBP').length + head.length);
    if (size > MAX_RIFF_BYTES) {
      throw new Error('A WebP has less than 4 GiB: make the film smaller or shorter.');
    }
    return new Blob([Uint8Array.from([...letters('RIFF'), ...little(size, 4), ...letters('WEBP'), ...head]), ...this.#parts], { type: 'image/webp' });
  }
}
