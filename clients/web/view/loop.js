// The parts of a view, and the way of a change through them.
//
// 1. Pointer, keyboard or a caller changes the model. Its state is sent at once, or in the next
//    animation frame (StateStream, Connection).
// 2. In the animation frame the newest frame that has arrived goes to the screen (Frames, Picture), and
//    the last one is drawn from the camera of the model, with the overlay.
// 3. Whatever happens is an event of the view.
// @ts-check

import { Client } from './client.js';
import { Connection } from './connection.js';
import { buildElements } from './elements.js';
import { Frames } from './frames.js';
import { Model } from './model.js';
import { Announcer, Notices } from './notices.js';
import { Overlay } from './overlay.js';
import { Picture } from './picture.js';
import { Refinement } from './refinement.js';
import { StateStream } from './state-stream.js';
import { Statistics } from './statistics.js';
import { AnimationLoop } from './tab.js';

/** @typedef {import('./types.js').FrameRequest} FrameRequest */
/** @typedef {import('./connection.js').Transport} Transport */

/**
 * @typedef {object} Options
 * @property {string} [url] address of the gateway; default: the page's own folder
 * @property {string} [token] where the gateway asks for one
 * @property {FrameRequest} [state] what to show, as setState takes it; default: nothing until that is called
 * @property {'auto' | 'webgl2' | 'bitmaprenderer'} [renderer] default: auto, WebGL2 with a GPU
 * @property {number} [targetFramesPerSecond] 1 to 120, default 30
 * @property {number} [maxSide] the largest side of a picture in pixels; default: all of the device's, up to the server's
 *   limit, and 2048 where that is not told
 * @property {boolean} [axes] @property {boolean} [scaleBar] default: both shown
 * @property {boolean} [box] default: not shown
 * @property {Partial<import('./refinement.js').Limits>} [limits] of what an exact picture may cost, where the server can tell: without
 *   a limit it is drawn, however long that takes; default: no limits
 * @property {'always' | 'focused'} [wheel] when the wheel zooms; default: always
 * @property {string} [label] what the view is, for screen readers
 * @property {(sentence: string) => void} [announce] takes what screen readers should say; default: the view has a live
 *   region of its own
 * @property {Transport} [transport] used where the gateway cannot be reached
 */


/** The pointer moves the place where tiles come first by so much of the picture, and so often, at most. */
const FOCUS_SHARE = 0.05;
const FOCUS_EVERY_MS = 200;

export class Loop {
  model = new Model();
  stream = new StateStream();
  statistics = new Statistics();
  #animation = new AnimationLoop(() => this.#tick());
  #client;
  #options;
  #emit;
  // Time of the first move since the last animation frame.
  /** @type {number | null} */
  #movedAt = null;
  #isLearning = false;
  /** The place that was asked for last. */
  #focusSent = { x: 0.5, y: 0.5, time: 0 };
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #focusTimer;
  /** Whether a state is to be sent for its place only. */
  #isRefocused = false;
  /** Of the picture whose pixels became fewer; '': none did. */
  #yieldedWeight = '';

  /**
   * @param {HTMLElement} element @param {Options} options
   * @param {(type: string, detail: any) => boolean} emit sends an event; false if its default is prevented
   */
  constructor(element, options, emit) {
    this.#options = options;
    this.#emit = emit;
    this.#client = new Client(options.url, options.token);
    this.elements = buildElements(element, { label: options.label, isSpeaking: !options.announce });
    const { root, notice, speech } = this.elements;
    const announcer = new Announcer((sentence) => { speech.textContent = sentence; });
    this.notices = new Notices(notice, options.announce ?? ((sentence) => announcer.say(sentence)),
      (detail) => emit('notice', detail));
    this.refinement = new Refinement(options.limits);
    this.picture = new Picture(root, options, () => {
      this.stream.renew();
      this.change(false, null);
    });
    this.overlay = new Overlay(this.picture, options);
    this.connection = new Connection(this.#client, this.notices,
      { transport: options.transport, isTransportFirst: !options.url }, {
        status: (kind, sentence) => emit('status', { kind, sentence }),
        opened: (isAgain) => this.#opened(isAgain),
        closed: () => {
          this.stream.isDirty = true;
          this.notices.endWaiting();
        },
        message: (message) => this.frames.receive(message),
      });
    this.frames = new Frames(this, {
      arrived: () => this.schedule(),
      changed: () => this.change(false, null),
      exhausted: () => this.#yieldPixels(),
      cameraTaken: () => emit('state', { state: this.model.toState(), isMoving: false }),
      shown: (detail) => emit('frame', detail),
      refined: () => emit('refined', { progress: this.refinement.progressOf(this.stream.picture),
        deferred: this.refinement.deferredOf(this.stream.picture) }),
    });
    this.resizer = new ResizeObserver((entries) => {
      const size = entries.at(-1)?.devicePixelContentBoxSize?.[0];
      this.#resize(size && { width: size.inlineSize, height: size.blockSize });
    });
  }

  /**
   * Begins: sizes the picture, shows the first state, and connects.
   * @param {() => void} showFirst
   */
  start(showFirst) {
    try {
      this.resizer.observe(this.elements.root, { box: 'device-pixel-content-box' });
    } catch {
      this.resizer.observe(this.elements.root);  // a browser that does not count them
    }
    this.#resize();
    showFirst();
    this.#learnAbilities();
    this.connection.connect();
  }

  /** @param {boolean} isMoving @param {number | null} time of the event, if a move of the camera caused it */
  change(isMoving, time) {
    this.stream.change(time);
    this.#movedAt ??= time;
    if (time !== null && this.stream.isRested) {
      this.#send();
    }
    this.schedule();
    this.#emit('state', { state: this.model.toState(), isMoving });
  }

  /** @param {string} token */
  setToken(token) {
    this.#client.token = token;
    if (!this.connection.isOpen) {
      this.connection.again();
    }
  }

  /** Takes the size of the element now; the observer would tell it later. */
  resize() {
    this.#resize();
  }

  /**
   * The pointer is over the picture: tiles come there first.
   * @param {{x: number, y: number} | null} place as fractions of the picture; null: it is elsewhere
   */
  focus(place) {
    this.refinement.focus = place;
    const { x, y, time } = this.#focusSent;
    const isFar = place !== null && Math.hypot(place.x - x, place.y - y) > FOCUS_SHARE;
    clearTimeout(this.#focusTimer);
    if (isFar && this.refinement.progressOf(this.stream.picture)) {
      const waitMs = time + FOCUS_EVERY_MS - performance.now();
      if (waitMs > 0) {
        this.#focusTimer = setTimeout(() => this.focus(this.refinement.focus), waitMs);  // the pointer may stay
        return;
      }
      this.#isRefocused = true;
      this.schedule();
    }
  }

  /** Sends the same picture again: its limits are others now. */
  askAgain() {
    this.stream.change(null);
    this.schedule();
  }

  /** Draws in the next animation frame. */
  schedule() {
    this.#animation.schedule();
  }

  /** Learns the box and the patient frame of the dataset, for the box, the axes and the named views. */
  async describe() {
    const name = this.model.datasetName;
    if (this.#options.transport && !this.#options.url) {
      return;
    }
    try {
      const dataset = name ? await this.#client.get(`v1/datasets/${encodeURIComponent(name)}`)
        : (await this.#client.get('v1/datasets')).datasets?.[0];
      if (name === this.model.datasetName && !this.#animation.isEnded && dataset) {
        this.model.dataset = dataset.dataset ?? dataset;
        this.#emit('dataset', this.model.dataset);
        this.schedule();
      }
    } catch {
      // The frame reports a problem of the dataset; a lost gateway is asked again once it is back.
    }
  }

  end() {
    clearTimeout(this.#focusTimer);
    this.#animation.end();
    this.resizer.disconnect();
    this.notices.endWaiting();
    this.frames.end();
    this.connection.end();
    this.picture.destroy();
    this.elements.host.remove();
  }

  /** Learns how large a picture may be, where no caller has a limit, and whether the server refines pictures. */
  async #learnAbilities() {
    if (this.#isLearning || this.#options.transport && !this.#options.url) {
      return;
    }
    this.#isLearning = true;
    try {
      const { maxViewportPx, features = [] } = await this.#client.get('v1/capabilities');
      if (this.#animation.isEnded) {
        return;
      }
      const isKnown = features.includes('refinement');
      if (isKnown !== this.refinement.isKnown) {
        this.refinement.isKnown = isKnown;
        this.askAgain();
      }
      if (maxViewportPx > 0 && !this.#options.maxSide) {
        this.#options = { ...this.#options, maxSide: maxViewportPx };
        this.picture.setMaxSide(maxViewportPx);
        this.#resize();
      }
    } catch {
      // It is asked again with the next connection.
    }
    this.#isLearning = false;
  }

  /** What makes a picture of some size need more or less of the server's memory. */
  #weight() {
    const { dataset, samples, surfaces = [] } = this.model.state;
    return JSON.stringify([dataset, samples, surfaces.map((/** @type {any} */ { color, colorBy }) => (color?.alpha ?? 1) < 1 || Boolean(colorBy?.opacity))]);
  }

  /** The server has no memory for a picture of this size: a smaller one is drawn, and scaled up. */
  #yieldPixels() {
    if (this.picture.yieldPixels()) {
      this.#yieldedWeight = this.#weight();
      this.#resize();
    }
  }

  #send() {
    const { model, stream } = this;
    const before = this.#isRefocused && !stream.isDirty ? stream.frame : null;
    this.#isRefocused = false;
    if (!this.connection.isOpen || !(stream.isDirty || before) || !model.isSet || document.hidden) {
      return;
    }
    if (this.#yieldedWeight && this.#yieldedWeight !== this.#weight()) {
      this.#yieldedWeight = '';
      if (this.picture.takePixels()) {
        this.picture.resize();
        this.overlay.resized();
      }
    }
    // For its place only, a state is that of before: with the camera that the server chose, it would be another picture.
    const frame = before ?? { ...model.toState(), viewport: { widthPx: this.picture.width, heightPx: this.picture.height } };
    const refinement = this.refinement.isKnown && this.connection.name === 'gateway' ? this.refinement : null;
    this.#focusSent = { ...(this.refinement.focus ?? { x: 0.5, y: 0.5 }), time: performance.now() };
    this.connection.send(stream.next(frame, this.#options.targetFramesPerSecond ?? 30, refinement));
    this.statistics.counts.statesSent += 1;
    // Of a picture that is here nothing more comes, unless the server knows no pictures.
    if (!before && !(refinement && this.frames.shownPicture === stream.picture && this.picture.frame?.isExact)) {
      this.notices.beginWaiting();
    }
  }

  #tick() {
    const movedAt = this.#movedAt;
    this.#movedAt = null;
    // The state is sent first: the server works while this draws.
    this.#send();
    if (this.frames.hasArrived) {
      this.frames.show();
    }
    this.#draw();
    if (movedAt !== null) {
      this.statistics.localResponse.add(performance.now() - movedAt);
    }
  }

  #draw() {
    const { camera, state, dataset } = this.model;
    if (camera) {
      const { counts } = this.statistics;
      counts.warpsDrawn += this.picture.draw(camera) ? 1 : 0;
      this.overlay.draw(camera, state, dataset, counts.framesShown);
    }
  }

  /** @param {{width: number, height: number}} [device] as Picture takes it */
  #resize(device) {
    if (this.picture.resize(device)) {
      this.overlay.resized();
      this.change(true, null);
      this.#draw();
    }
  }

  /** @param {boolean} isAgain */
  #opened(isAgain) {
    this.statistics.counts.reconnects += isAgain ? 1 : 0;
    this.stream.clear();
    this.#learnAbilities();
    if (!this.model.dataset) {
      this.describe();
    }
    this.change(false, null);
  }
}
