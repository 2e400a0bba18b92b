// Frames and tiles from the server, from their arrival to the screen.
//
// The newest frame waits for the next animation frame; an older one that still waits is dropped, and so are tiles of
// before. Tiles are painted into the frame that is shown, unless the view has another picture by then. Each answer with
// pixels is acknowledged once, shown or not, and each bitmap is closed. The screen closes those that it shows.
// @ts-check

import { cameraFromJson, isSameCamera } from './camera.js';
import { fillView } from './moves.js';
import { gridOfPicture } from './relief.js';

/** @typedef {import('./types.js').Camera} Camera */
/** @typedef {import('./types.js').DepthGrid} DepthGrid */

/**
 * @typedef {{model: import('./model.js').Model, picture: import('./picture.js').Picture,
 *   stream: import('./state-stream.js').StateStream, connection: import('./connection.js').Connection,
 *   notices: import('./notices.js').Notices, statistics: import('./statistics.js').Statistics,
 *   refinement: import('./refinement.js').Refinement}} Parts of a view
 */

const CODES = ['OK', 'CANCELLED', 'UNKNOWN', 'INVALID_ARGUMENT', 'DEADLINE_EXCEEDED', 'NOT_FOUND', 'ALREADY_EXISTS',
  'PERMISSION_DENIED', 'RESOURCE_EXHAUSTED', 'FAILED_PRECONDITION', 'ABORTED', 'OUT_OF_RANGE', 'UNIMPLEMENTED',
  'INTERNAL', 'UNAVAILABLE', 'DATA_LOSS', 'UNAUTHENTICATED'];
/** These errors are temporary: an agent restarts, a queue empties. */
const PASSING_CODES = [4, 8, 9, 14];
const EXHAUSTED = 8;
/** Reasons of RESOURCE_EXHAUSTED where a smaller picture is refused, too: its place in the queue is missing. */
const BUSY_REASONS = ['TOO_BUSY', 'RATE_LIMITED'];
/** A state is sent again after so long, in milliseconds; sooner or later if the server says when, within limits. */
const DEFAULT_RETRY_MS = 2000;
const LEAST_RETRY_MS = 250;
const MOST_RETRY_MS = 60000;
const VERSION_HINT = 'Do server and page have the same version?';

/** @param {any} header */
const sequenceOf = (header) => Number(header.sequenceNumber ?? 0);

/**
 * What the error of a frame asks for.
 * @param {{code?: number, reason?: string, retryDuration?: string}} error `reason` and `retryDuration` of newer servers
 * @returns {{isPassing: boolean, isTooLarge: boolean, retryMs: number}} `isTooLarge`: a smaller picture may be drawn
 */
export function refusalOf({ code = 2, reason = '', retryDuration }) {
  const told = 1000 * parseFloat(retryDuration ?? '');
  return { isPassing: PASSING_CODES.includes(Number(code)), isTooLarge: Number(code) === EXHAUSTED && !BUSY_REASONS.includes(reason),
    retryMs: Number.isFinite(told) ? Math.min(MOST_RETRY_MS, Math.max(LEAST_RETRY_MS, told)) : DEFAULT_RETRY_MS };
}

/** @param {any} message @returns {DepthGrid | null} */
function gridOf({ header, depths }) {
  return depths.length > 0 ? { width: header.depthGrid.width, height: header.depthGrid.height,
    near: Number(header.depthGrid.near ?? 0), far: Number(header.depthGrid.far ?? 0), values: depths } : null;
}

export class Frames {
  /** The state that the frame on the screen answers, and its picture. */
  shownSequence = 0;
  shownPicture = -1;
  #parts;
  #on;
  /** @type {any} */
  #arrived = null;
  /**
   * Those behind it.
   * @type {any[]}
   */
  #tiles = [];
  /** @type {{grid: DepthGrid, camera: Camera, scene: string} | null} */
  #lastGrid = null;
  #errorSequence = -1;
  #exhaustedCount = 0;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #retryTimer;

  /**
   * @param {Parts} parts
   * @param {{arrived: () => void, changed: () => void, exhausted: () => void, cameraTaken: () => void, shown: (detail: any) => void,
   *   refined: () => void}} on
   *   `arrived`: a frame or tile waits for `show`; `refined`: a tile is shown, or the exact frame is deferred; `changed`: a state must be sent; `exhausted`: the server has refused two
   *   frames on end for want of memory; `cameraTaken`: the camera is the server's
   */
  constructor(parts, on) {
    this.#parts = parts;
    this.#on = on;
  }

  get hasArrived() {
    return this.#arrived !== null || this.#tiles.length > 0;
  }

  /** @param {any} message of the worker: frame, dropped or bad */
  receive(message) {
    const { counts } = this.#parts.statistics;
    switch (message.kind) {
      case 'frame':
        counts.bitmapsMade += message.bitmap ? 1 : 0;
        counts.bytesReceived += message.bytes;
        this.#arrive(message);
        break;
      case 'dropped':
        counts.framesDropped += 1;
        counts.bytesReceived += message.bytes;
        break;
      case 'bad': this.#parts.notices.problem(`${message.sentence} ${VERSION_HINT}`); break;
    }
  }

  /** @param {any} message */
  #arrive(message) {
    const { model, stream, connection, notices, statistics } = this.#parts;
    const { header } = message;
    const sequence = sequenceOf(header);
    statistics.decode.add(message.decodeMs);
    const sent = stream.of(sequence);
    if (sent && !sent.isAnswered) {  // the exact frame waits for rest besides
      sent.isAnswered = true;
      statistics.roundTrip.add(message.receivedAt - sent.sentAt);
    }
    if (header.exactDeferred) {
      this.#defer(header, sequence);
      return;
    }
    if (header.error || !message.bitmap) {
      message.bitmap?.close();
      statistics.counts.bitmapsClosed += message.bitmap ? 1 : 0;
      this.#fail(header.error ?? { code: 13, message: 'the server sent a frame without a picture' }, sequence);
      connection.acknowledge(message);
      return;
    }
    if (header.tile) {
      this.#tiles.push(message);
      this.#on.arrived();
      return;
    }
    const camera = cameraFromJson(header.frame?.camera);
    if (!camera && !model.camera) {
      notices.problem(`The server sent a picture without the camera that it shows. ${VERSION_HINT}`);
    }
    this.#drop();
    this.#arrived = message;
    const grid = gridOf(message);
    if (grid && camera) {
      this.#lastGrid = { grid, camera, scene: sent?.scene ?? '' };
    }
    this.#on.arrived();
  }

  /** @param {{code?: number, message?: string, reason?: string, retryDuration?: string}} error @param {number} sequence */
  #fail(error, sequence) {
    const { notices } = this.#parts;
    notices.endWaiting();
    this.#errorSequence = sequence;
    const text = (error.message ?? '').trim() || 'the server gives no reason';
    const sentence = text[0].toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? '' : '.');
    const code = Number(error.code ?? 2);
    const { isPassing, isTooLarge, retryMs } = refusalOf(error);
    notices.problem(`${sentence} (${CODES[code] ?? code})${isPassing ? ' Trying again.' : ''}`);
    clearTimeout(this.#retryTimer);
    this.#exhaustedCount = isTooLarge ? this.#exhaustedCount + 1 : 0;
    if (this.#exhaustedCount === 2) {
      this.#exhaustedCount = 0;
      this.#on.exhausted();
    }
    if (isPassing) {
      // A hidden tab sends it once it is shown.
      this.#retryTimer = setTimeout(() => this.#on.changed(), retryMs);
    }
  }

  /**
   * The exact frame is over a limit: nothing more is waited for.
   * @param {any} header @param {number} sequence
   */
  #defer(header, sequence) {
    const { stream, notices, refinement } = this.#parts;
    const picture = stream.of(sequence)?.picture;
    if (picture === undefined || picture !== stream.picture) {
      return;
    }
    notices.endWaiting();
    if (sequence > this.#errorSequence) {
      notices.framed(true);
    }
    refinement.takeDeferred(picture, header.exactDeferred);
    this.#on.refined();
  }

  /** Drops what was decoded and not shown, and says so. */
  #drop() {
    const { connection, statistics: { counts } } = this.#parts;
    for (const message of [...(this.#arrived ? [this.#arrived] : []), ...this.#tiles]) {
      message.bitmap.close();
      counts.bitmapsClosed += 1;
      counts.framesDropped += 1;
      connection.acknowledge(message);
    }
    this.#arrived = null;
    this.#tiles = [];
  }

  /** Puts what has arrived on the screen. */
  show() {
    if (this.#arrived) {
      this.#showFrame(this.#arrived);
    }
    const tiles = this.#tiles;
    this.#tiles = [];
    tiles.forEach((message) => this.#showTile(message));
    if (tiles.length > 0) {
      this.#on.refined();
    }
  }

  /**
   * Paints a tile into the frame on the screen. One of another picture than the view's is dropped.
   * @param {any} message
   */
  #showTile(message) {
    const { model, picture, stream, connection, notices, statistics: { counts }, refinement } = this.#parts;
    const { header: { tile }, bitmap } = message;
    const { x = 0, y = 0, widthPx = 0, heightPx = 0 } = tile.region ?? {};
    const { widthPx: width = 0, heightPx: height = 0 } = tile.extent ?? {};
    const sequence = sequenceOf(message.header);
    const number = stream.of(sequence)?.picture;
    const camera = cameraFromJson(tile.camera) ?? model.camera;
    const fits = bitmap.width === widthPx && bitmap.height === heightPx && x >= 0 && y >= 0 && x + widthPx <= width && y + heightPx <= height;
    counts.bitmapsClosed += 1;
    connection.acknowledge(message);
    if (!fits) {
      notices.problem(`The server sent a tile that lies outside of its picture. ${VERSION_HINT}`);
    }
    if (!fits || !camera || number === undefined || number !== stream.picture) {
      counts.framesDropped += 1;
      bitmap.close();
      return;
    }
    if (model.takeCamera(camera, sequence)) {
      this.#on.cameraTaken();
    }
    picture.paint(bitmap, { x, y }, { width, height, camera, isExact: false, background: model.background });
    counts.tilesShown += 1;
    this.shownSequence = sequence;
    this.shownPicture = number;
    refinement.takeTile(number, Number(tile.index ?? 0), Number(tile.count ?? 0));
    notices.endWaiting();
    if (sequence > this.#errorSequence) {
      notices.framed(true);
    }
  }

  /** @param {any} message */
  #showFrame(message) {
    const { model, picture, stream, connection, notices, statistics, refinement } = this.#parts;
    this.#arrived = null;
    const { header, bitmap } = message;
    const sequence = sequenceOf(header);
    const camera = cameraFromJson(header.frame?.camera) ?? model.camera;
    if (camera) {
      this.#takeCamera(camera, message);
    }
    const sent = stream.of(sequence);
    const isExact = header.isExact === true;
    const { width, height } = bitmap;
    if (camera) {
      const grid = gridOf(message) ?? this.#gridBefore(camera, sent?.scene ?? '');
      picture.show(bitmap, { width, height, camera, grid, isExact, background: model.background,
        drawnLevel: header.frame?.drawnLevel });
    } else {
      bitmap.close();
    }
    statistics.counts.bitmapsClosed += 1;
    if (isExact) {
      this.#exhaustedCount = 0;
      clearTimeout(this.#retryTimer);  // nothing is missing any more
    }
    statistics.shown(isExact, sent);
    this.shownSequence = sequence;
    this.shownPicture = sent?.picture ?? -1;
    if (isExact) {
      refinement.complete(this.shownPicture);
    }
    connection.acknowledge(message);
    if (sequence > this.#errorSequence || isExact) {
      notices.endWaiting();
      notices.framed(isExact);
    }
    this.#on.shown({ header, isExact, width, height, decodeMs: message.decodeMs,
      roundTripMs: sent ? message.receivedAt - sent.sentAt : null, latencyMs: statistics.shownLatencyMs });
  }

  /**
   * Takes the camera that the server chose.
   * @param {Camera} camera @param {any} message
   */
  #takeCamera(camera, message) {
    const { model } = this.#parts;
    const { header, bitmap } = message;
    const taken = model.takeCamera(camera, sequenceOf(header));
    if (!taken) {
      return;
    }
    if (taken.isFitted) {
      const grid = gridOf(message) ?? gridOfPicture(camera, bitmap, model.background);
      const filled = fillView(camera, grid, bitmap.width / bitmap.height);
      if (!isSameCamera(filled, camera)) {
        model.takeFitted(filled);
        this.#on.changed();
      }
    }
    this.#on.cameraTaken();
  }

  /**
   * The exact frame may have no depths: those of the quick one before it are the same.
   * @param {Camera} camera @param {string} scene '' if unknown @returns {DepthGrid | null}
   */
  #gridBefore(camera, scene) {
    const last = this.#lastGrid;
    return last && scene !== '' && scene === last.scene && isSameCamera(camera, last.camera) ? last.grid : null;
  }

  end() {
    clearTimeout(this.#retryTimer);
    this.#drop();
  }
}
