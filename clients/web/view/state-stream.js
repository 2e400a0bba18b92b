// The states that a view has sent, by number, until their pictures are on the screen.
// @ts-check

/** @typedef {import('./types.js').FrameRequest} FrameRequest */

/**
 * @typedef {{scene: string, sentAt: number, causedAt: number, isByInput: boolean, isAnswered: boolean, isShown: boolean}} SentState
 *   `scene` is the state without its camera. `sentAt` is on the clock of the worker. `causedAt` is the time of
 *   the newest input in the state; without input, the time of its sending.
 */

/** States of a pointer that moves are sent at once if the last one is so old, else in the next animation frame. */
const SEND_EVERY_MS = 8;
/** Answers to older states than these many have no times. */
const KEPT_STATES = 256;

export class StateStream {
  /** The number of the last state; 0: none was sent. */
  sequence = 0;
  /** Whether the view has changed since. */
  isDirty = false;
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
   * Numbers the next state.
   * @param {FrameRequest} frame @param {number} targetFramesPerSecond @returns {string} the message
   */
  next(frame, targetFramesPerSecond) {
    const now = performance.now();
    this.isDirty = false;
    this.#sentAt = now;
    this.sequence += 1;
    this.#sent.set(this.sequence, { scene: JSON.stringify({ ...frame, camera: null, viewport: null }),
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
    return JSON.stringify({ viewState: { sequenceNumber: String(this.sequence), frame, targetFramesPerSecond } });
  }

  /** @param {number} sequence @returns {SentState | undefined} */
  of(sequence) {
    return this.#sent.get(sequence);
  }

  /** The connection is another one: no state of the last one is answered any more. */
  clear() {
    this.#sent.clear();
  }
}
