// The states that a view has sent, by number, until their pictures are on the screen.
//
// States with the same request are of one picture. A server that refines pictures compares requests byte by byte, and
// sends nothing of a picture twice. So a request that may be the same there but is none here gets another seed of its
// rays, which changes no pixel.
// @ts-check

/** @typedef {import('./types.js').FrameRequest} FrameRequest */

/**
 * @typedef {{scene: string, picture: number, sentAt: number, causedAt: number, isByInput: boolean, isAnswered: boolean, isShown: boolean}} SentState
 *   `scene` is the state without its camera. `sentAt` is on the clock of the worker. `causedAt` is the time of
 *   the newest input in the state; without input, the time of its sending. `picture` is the number of its picture.
 */

/** States of a pointer that moves are sent at once if the last one is so old, else in the next animation frame. */
const SEND_EVERY_MS = 8;
/** Answers to older states than these many have no times. */
const KEPT_STATES = 256;

/**
 * A request as one text: its members in order, and, if it is `loose`, without those that a default may stand for.
 * @param {any} value @param {boolean} isLoose @returns {any}
 */
function canonical(value, isLoose) {
  if (Array.isArray(value)) {
    return value.map((one) => canonical(one, isLoose));
  }
  if (value === null || typeof value !== 'object') {
    return value;
  }
  return Object.fromEntries(Object.keys(value).sort().filter((key) => !(isLoose ? [undefined, null, 0, false, ''] : [undefined, null]).includes(value[key]))
    .map((key) => [key, canonical(value[key], isLoose)]));
}

export class StateStream {
  /** The number of the last state; 0: none was sent. */
  sequence = 0;
  /** Whether the view has changed since. */
  isDirty = false;
  /** The number of the last state's picture. */
  picture = 0;
  /**
   * The request of the last state; null: none was sent on this connection.
   * @type {FrameRequest | null}
   */
  frame = null;
  #words = '';
  #looseWords = '';
  #seed = 0;
  #sentAt = 0;
  // Time of the newest input without a sent state.
  /** @type {number | null} */
  #inputAt = null;
  /** @type {Map<number, SentState>} */
  #sent = new Map();

  /** @param {number | null} time of the input that changed the view; null if none did */
  change(time) {
    this.isDirty = true;
    this.#inputAt = time ?? this.#inputAt;
  }

  /** The server begins at once; a state that comes before the last picture is shown waits for the next one. */
  get isRested() {
    return performance.now() - this.#sentAt >= SEND_EVERY_MS;
  }

  /**
   * Whether a request is that of the last state.
   * @param {FrameRequest} frame
   */
  isSame(frame) {
    return JSON.stringify(canonical(frame, false)) === this.#words;
  }

  /** Makes the next state one of another picture, though its request be the same: the picture is lost here. */
  renew() {
    this.#words = '';
  }

  /** @param {FrameRequest} frame @returns {FrameRequest} as it is sent */
  #toPicture(frame) {
    if (!this.isSame(frame)) {
      const words = JSON.stringify(canonical(frame, true));
      this.#seed = words === this.#looseWords ? this.#seed + 1 : 0;
      this.#looseWords = words;
      this.#words = JSON.stringify(canonical(frame, false));
      this.picture += 1;
    }
    return this.#seed > 0 ? { ...frame, raySeed: String(this.#seed) } : frame;
  }

  /**
   * Numbers the next state.
   * @param {FrameRequest} frame @param {number} targetFramesPerSecond
   * @param {import('./refinement.js').Refinement | null} [refinement] null where the server knows none
   * @returns {string} the message
   */
  next(frame, targetFramesPerSecond, refinement = null) {
    const now = performance.now();
    const asked = this.#toPicture(frame);
    this.frame = frame;
    this.isDirty = false;
    this.#sentAt = now;
    this.sequence += 1;
    this.#sent.set(this.sequence, { scene: JSON.stringify({ ...frame, camera: null, viewport: null }), picture: this.picture,
      sentAt: performance.timeOrigin + now, causedAt: this.#inputAt ?? now, isByInput: this.#inputAt !== null,
      isAnswered: false, isShown: false });
    for (const number of this.#sent.keys()) {
      if (number < this.sequence - KEPT_STATES) {
        this.#sent.delete(number);
      }
    }
    this.#inputAt = null;
    // Never at rest. The server sends the exact frame by itself 120 ms after the last state. The
    // quick frame before it has the depths that the next move needs.
    return JSON.stringify({ viewState: { sequenceNumber: String(this.sequence), frame: refinement ? asked : frame, targetFramesPerSecond,
      ...(refinement ? { refinement: refinement.toJson(this.picture) } : {}) } });
  }

  /** @param {number} sequence @returns {SentState | undefined} */
  of(sequence) {
    return this.#sent.get(sequence);
  }

  /** The connection is another one: no state of the last one is answered any more. */
  clear() {
    this.#sent.clear();
    this.frame = null;
    this.#words = this.#looseWords = '';
  }
}
