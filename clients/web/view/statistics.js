// Counts and times of a view, for users and tests. Times are milliseconds.
// @ts-check

/** The last of many numbers, and their percentiles. */
class Samples {
  /** @type {number[]} */
  #values = [];

  /** @param {number} value */
  add(value) {
    this.#values.push(value);
    if (this.#values.length > 512) {
      this.#values.shift();
    }
  }

  summary() {
    const sorted = [...this.#values].sort((a, b) => a - b);
    /** @param {number} share */
    const at = (share) => sorted.length === 0 ? null : sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
    return { count: sorted.length, p50: at(0.5), p95: at(0.95) };
  }
}

export class Statistics {
  counts = { framesShown: 0, exactShown: 0, tilesShown: 0, framesDropped: 0, warpsDrawn: 0, bytesReceived: 0,
    bitmapsMade: 0, bitmapsClosed: 0, reconnects: 0, statesSent: 0 };
  latency = new Samples();
  roundTrip = new Samples();
  decode = new Samples();
  localResponse = new Samples();
  /**
   * Latency of the frame on the screen: from its own input, or its own sending, to its display.
   * @type {number | null}
   */
  shownLatencyMs = null;
  /** @type {number[]} */
  #shownTimes = [];

  /**
   * Counts a frame that is on the screen now.
   * @param {boolean} isExact @param {import('./state-stream.js').SentState | undefined} sent the state that it answers
   */
  shown(isExact, sent) {
    this.counts.framesShown += 1;
    this.counts.exactShown += isExact ? 1 : 0;
    const now = performance.now();
    this.#shownTimes = [...this.#shownTimes.filter((time) => now - time < 1000), now];
    this.shownLatencyMs = sent ? now - sent.causedAt : null;
    if (sent?.isByInput && !sent.isShown) {
      this.latency.add(now - sent.causedAt);
    }
    if (sent) {
      sent.isShown = true;
    }
  }

  /** `shownLatencyMs` is that of the frame on the screen, `latencyMs` that of the last frames that an input caused. */
  summary() {
    const now = performance.now();
    return {
      ...this.counts,
      bitmapsOpen: this.counts.bitmapsMade - this.counts.bitmapsClosed,
      framesPerSecond: this.#shownTimes.filter((time) => now - time < 1000).length,
      shownLatencyMs: this.shownLatencyMs,
      latencyMs: this.latency.summary(),
      localResponseMs: this.localResponse.summary(),
      roundTripMs: this.roundTrip.summary(),
      decodeMs: this.decode.summary(),
    };
  }
}
