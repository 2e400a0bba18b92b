// How a picture refines: what the view asks of the server for it, and how far it has come.
//
// A picture is what all states with one request are of. A small one comes as quick frames and the exact one. Of a
// large one comes, once the view rests, a frame of a coarser level, then tiles of the exact frame, then the exact
// frame; or the word that this is over a limit.
// @ts-check

/** @typedef {import('./types.js').DrawnLevelJson} DrawnLevelJson */
/** @typedef {{seconds: number | null, bytes: number | null}} Limits of an exact frame; null: none */
/** @typedef {{done: number, count: number}} Progress tiles that are shown, of all */
/** @typedef {{bytes: number, seconds: number, drawnLevel?: DrawnLevelJson}} Deferred what the exact frame would cost */

/** @type {Limits} */
const UNLIMITED = { seconds: null, bytes: null };

export class Refinement {
  /** Whether the server knows it; older ones refuse the question. */
  isKnown = false;
  /**
   * Where tiles come first, as fractions of the picture from its top left; null: its middle.
   * @type {{x: number, y: number} | null}
   */
  focus = null;
  /** @type {Limits} */
  #limits;
  /** Whether the next state has no limits; and the picture that has none: -1: each has them. */
  #isLifting = false;
  #lifted = -1;
  /** Of the picture that is told of last. */
  #picture = -1;
  /** @type {Set<number>} */
  #done = new Set();
  #count = 0;
  /** @type {Deferred | null} */
  #deferred = null;

  /** @param {Partial<Limits>} [limits] default: none */
  constructor(limits = {}) {
    this.#limits = { ...UNLIMITED, ...limits };
  }

  /** @returns {Limits} */
  get limits() {
    return { ...this.#limits };
  }

  /**
   * Takes other limits. A server does not repeat what it said of the same ones.
   * @param {Partial<Limits>} given @returns {boolean} false if they are the same
   */
  setLimits(given) {
    const limits = { ...UNLIMITED, ...given };
    const isOther = limits.seconds !== this.#limits.seconds || limits.bytes !== this.#limits.bytes;
    if (isOther) {
      this.#limits = limits;
      this.#deferred = null;
    }
    return isOther;
  }

  /** Lets the exact frame of the next state's picture cost what it may. */
  lift() {
    this.#isLifting = true;
    this.#deferred = null;
  }

  /**
   * What a state asks for.
   * @param {number} picture its number @returns {Record<string, any>} Refinement as JSON
   */
  toJson(picture) {
    if (this.#isLifting) {
      this.#isLifting = false;
      this.#lifted = picture;
    }
    const { seconds, bytes } = picture === this.#lifted ? UNLIMITED : this.#limits;
    return { coarseLevels: true, tiles: true, ...(this.focus ? { focus: this.focus } : {}),
      ...(bytes === null ? {} : { maxExactBytes: String(Math.max(1, Math.round(bytes))) }),
      ...(seconds === null ? {} : { maxExactDuration: `${Math.max(0.001, seconds).toFixed(3)}s` }) };
  }

  /** @param {number} picture */
  #tell(picture) {
    if (picture !== this.#picture) {
      this.#picture = picture;
      this.#done.clear();
      this.#count = 0;
      this.#deferred = null;
    }
  }

  /**
   * Takes the number of a tile that is shown.
   * @param {number} picture @param {number} index @param {number} count of all tiles
   */
  takeTile(picture, index, count) {
    this.#tell(picture);
    this.#done.add(index);
    this.#count = count;
    this.#deferred = null;
  }

  /** @param {number} picture @param {any} json ExactDeferred */
  takeDeferred(picture, { expectedBytes, expectedDuration, drawnLevel }) {
    this.#tell(picture);
    this.#deferred = { bytes: Number(expectedBytes ?? 0), seconds: parseFloat(expectedDuration ?? '') || 0, drawnLevel };
  }

  /** @param {number} picture whose exact frame is shown */
  complete(picture) {
    this.#tell(picture);
    this.#count = 0;
    this.#deferred = null;
  }

  /** @param {number} picture @returns {Progress | null} null if no tiles come */
  progressOf(picture) {
    return picture === this.#picture && this.#count > 0 ? { done: this.#done.size, count: this.#count } : null;
  }

  /** @param {number} picture @returns {Deferred | null} null if its exact frame is not deferred */
  deferredOf(picture) {
    return picture === this.#picture ? this.#deferred : null;
  }
}

/**
 * The level of a picture, for people: "level 2, 1 sample = 0.9 px"; '' if it has all samples.
 * @param {DrawnLevelJson | undefined} drawn
 */
export function levelText(drawn) {
  const level = Number(drawn?.level ?? 0);
  const spacing = Number(drawn?.maxSpacingPx ?? 0);
  return level === 0 ? '' : `level ${level}${spacing > 0 ? `, 1 sample = ${Number(spacing.toPrecision(2))} px` : ''}`;
}

/**
 * What an exact frame would cost, for people: "2.1 GB, about 40 s".
 * @param {Deferred} deferred
 */
export function costText({ bytes, seconds }) {
  const power = Math.min(4, Math.floor(Math.log10(Math.max(bytes, 1)) / 3));
  const size = `${Number((bytes / 1000 ** power).toPrecision(2))} ${['B', 'kB', 'MB', 'GB', 'TB'][power]}`;
  const [value, unit] = seconds < 90 ? [seconds, 's'] : seconds < 5400 ? [seconds / 60, 'min'] : [seconds / 3600, 'h'];
  return seconds > 0 ? `${size}, about ${Number(value.toPrecision(2))} ${unit}` : size;
}

/**
 * What the picture of a view that rests is, for people; '' if a word of its own does better.
 * @param {{isExact: boolean, drawnLevel?: DrawnLevelJson, progress: Progress | null}} picture
 */
export function pictureText({ isExact, drawnLevel, progress }) {
  const level = levelText(drawnLevel);
  return isExact ? level ? `exact at ${level}` : 'exact' : progress ? `exact ${progress.done} of ${progress.count}` : level;
}
