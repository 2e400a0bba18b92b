// The frame on the screen: its canvas, and the size of it that the view has.
//
// With a graphics card WebGL2 draws it and warps it (gl-screen.js). Without one it is shown as it
// comes. The same happens when the driver takes the canvas away, and when the first warps are slow.
// @ts-check

import { hasFastWebGl, makeGlScreen } from './gl-screen.js';

/** @typedef {import('./types.js').Camera} Camera */
/** @typedef {import('./types.js').ShownFrame} ShownFrame */

/**
 * @typedef {{name: string, canvas: HTMLCanvasElement, isWarping: boolean, show: (bitmap: ImageBitmap, frame: ShownFrame) => void,
 *   paint: (bitmap: ImageBitmap, at: Corner, frame: ShownFrame) => void, draw: (camera: Camera) => boolean, finish: () => void, resize: (width: number, height: number) => void,
 *   destroy: () => void}} Screen show takes the bitmap over and closes it; so does paint, over what is shown, which it
 *   first scales to the size of `frame`; draw says whether it warped; finish waits until it is drawn.
 * @typedef {{x: number, y: number}} Corner top left, in pixels of the picture
 */

/** So many warps are timed; if they take longer than this in the middle, WebGL is left. */
const MEASURED_WARPS = 7;
const SLOW_WARP_MS = 25;

/** The largest side of a picture until the server has told its own limit. */
const CAUTIOUS_SIDE_PX = 2048;
/** A server that has no memory for a picture is asked for one of so much of its side, but for none below the least. */
const YIELD_SHARE = 0.7;
const LEAST_SIDE_PX = 512;

/** @param {number[]} background red, green, blue, 0 to 1 */
const cssOf = (background) => `rgb(${background.map((c) => Math.round(255 * c)).join(' ')})`;

/** @param {string} className */
export function makeCanvas(className) {
  const canvas = document.createElement('canvas');
  canvas.className = className;
  return canvas;
}

/**
 * A canvas of a frame's size with another one's picture, scaled to its height.
 * @param {HTMLCanvasElement} source @param {ShownFrame} frame
 */
function scaledCanvas(source, { width, height, background }) {
  const canvas = makeCanvas('picture plain');
  [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext('2d', { alpha: false });
  if (context) {
    context.fillStyle = cssOf(background);
    context.fillRect(0, 0, width, height);
    context.imageSmoothingQuality = 'high';
    const across = source.width * height / source.height;
    context.drawImage(source, (width - across) / 2, 0, across, height);
  }
  return canvas;
}

/**
 * Shows pictures as they come, without WebGL. If the processor emulates WebGL, this takes half of
 * its time.
 * @returns {Screen}
 */
function makeBitmapScreen() {
  const canvas = makeCanvas('picture plain');
  const context = /** @type {ImageBitmapRenderingContext} */ (canvas.getContext('bitmaprenderer', { alpha: false }));
  /**
   * Over it, while tiles come: its picture with them.
   * @type {HTMLCanvasElement | null}
   */
  let board = null;
  return {
    name: 'bitmaprenderer',
    get canvas() { return board ?? canvas; },
    isWarping: false,
    show(bitmap, shown) {
      if (canvas.width !== shown.width || canvas.height !== shown.height) {
        canvas.width = shown.width;
        canvas.height = shown.height;
      }
      context.transferFromImageBitmap(bitmap);
      bitmap.close();
      board?.remove();
      board = null;
    },
    paint(bitmap, { x, y }, frame) {
      if (board?.width !== frame.width || board.height !== frame.height) {
        const scaled = scaledCanvas(board ?? canvas, frame);
        board?.remove();
        canvas.after(scaled);
        board = scaled;
      }
      board.getContext('2d')?.drawImage(bitmap, x, y);
      bitmap.close();
    },
    resize() {},
    draw: () => false,
    finish() {},
    destroy() {
      context.transferFromImageBitmap(null);
      canvas.remove();
      board?.remove();
    },
  };
}

/** The first child of an element: a canvas with the last frame. */
export class Picture {
  #root;
  #renderer;
  /** The limits of caller and server, and that of the server's memory. */
  #maxSide;
  #yieldedSide = Infinity;
  #changed;
  /** @type {number[]} */
  #warpTimes = [];
  #background = '';
  #isDestroyed = false;

  /**
   * @param {HTMLElement} root
   * @param {{renderer?: 'auto' | 'webgl2' | 'bitmaprenderer', maxSide?: number}} options
   * @param {() => void} changed called when another screen needs the frame again
   */
  constructor(root, { renderer = 'auto', maxSide = CAUTIOUS_SIDE_PX }, changed) {
    this.#root = root;
    this.#renderer = renderer;
    this.#maxSide = maxSide;
    this.#changed = changed;
    /** @type {ShownFrame | null} */
    this.frame = null;
    // Of the picture; of the element in pixels of the device, and in CSS pixels. Both are the same unless a limit is less.
    this.width = 1;
    this.height = 1;
    this.deviceWidth = 1;
    this.deviceHeight = 1;
    this.ratio = 0;
    this.cssWidth = 0;
    this.cssHeight = 0;
    const isGl = renderer === 'webgl2' || renderer === 'auto' && hasFastWebGl();
    /** @type {Screen} */
    this.screen = (isGl ? makeGlScreen(makeCanvas('picture'), (why) => this.#leaveGl(why)) : null) ?? makeBitmapScreen();
    root.prepend(this.screen.canvas);
  }

  get aspect() {
    return this.width / this.height;
  }

  /** Whether each pixel of the frame is one of the device. */
  get isWhole() {
    return this.frame?.width === this.deviceWidth && this.frame.height === this.deviceHeight;
  }

  /**
   * Takes the limit of the server.
   * @param {number} side in pixels
   */
  setMaxSide(side) {
    this.#maxSide = side;
  }

  /**
   * Asks for fewer pixels: the server has no memory for these.
   * @returns {boolean} false if there are few already
   */
  yieldPixels() {
    const side = Math.floor(YIELD_SHARE * Math.max(this.width, this.height));
    if (side < LEAST_SIDE_PX) {
      return false;
    }
    this.#yieldedSide = side;
    return true;
  }

  /** Asks for all pixels again. @returns {boolean} whether there were fewer */
  takePixels() {
    const isLess = this.#yieldedSide < Infinity;
    this.#yieldedSide = Infinity;
    return isLess;
  }

  /**
   * Takes the size of the element.
   * @param {{width: number, height: number}} [device] its size in pixels of the device, if the browser tells
   * @returns {boolean} whether it has changed
   */
  resize(device) {
    const ratio = globalThis.devicePixelRatio || 1;
    const { clientWidth, clientHeight } = this.#root;
    const isSame = this.ratio === ratio && this.cssWidth === clientWidth && this.cssHeight === clientHeight;
    // A browser that emulates a screen tells the pixels of its own.
    const isOfThisScreen = device && Math.abs(device.width - clientWidth * ratio) <= 1 + ratio
      && Math.abs(device.height - clientHeight * ratio) <= 1 + ratio;
    const [across, down] = isOfThisScreen ? [device.width, device.height] : isSame ? [this.deviceWidth, this.deviceHeight]
      : [Math.round(clientWidth * ratio), Math.round(clientHeight * ratio)];
    const shrink = Math.min(1, Math.min(this.#maxSide, this.#yieldedSide) / Math.max(across, down, 1));
    const width = Math.max(1, Math.round(across * shrink));
    const height = Math.max(1, Math.round(down * shrink));
    [this.deviceWidth, this.deviceHeight] = [across, down];
    if (isSame && this.width === width && this.height === height) {
      return false;
    }
    this.width = width;
    this.height = height;
    this.ratio = ratio;
    [this.cssWidth, this.cssHeight] = [clientWidth, clientHeight];
    this.screen.resize(width, height);
    this.#sharpen();
    return true;
  }

  /** @param {ImageBitmap} bitmap closed here @param {ShownFrame} frame */
  show(bitmap, frame) {
    this.frame = frame;
    this.screen.show(bitmap, frame);
    this.#sharpen();
    const background = cssOf(frame.background);
    if (background !== this.#background) {
      this.#background = background;
      this.#root.style.background = background;
    }
  }

  /**
   * Paints a part of a frame over the one that is shown, whose depths and level stay.
   * @param {ImageBitmap} bitmap closed here @param {Corner} at @param {Omit<ShownFrame, 'grid'>} frame all of it
   */
  paint(bitmap, at, frame) {
    this.frame = { ...frame, grid: this.frame?.grid ?? null, drawnLevel: this.frame?.drawnLevel };
    this.screen.paint(bitmap, at, this.frame);
    this.#sharpen();
  }

  /** @param {Camera} camera @returns {boolean} whether the frame was warped */
  draw(camera) {
    const startedAt = performance.now();
    const isWarped = this.screen.draw(camera);
    if (isWarped) {
      this.#measureWarp(startedAt);
    }
    return isWarped;
  }

  destroy() {
    this.#isDestroyed = true;
    this.screen.destroy();
  }

  /** A canvas of the device's pixels is shown as it is; the browser smooths another one. */
  #sharpen() {
    const { canvas } = this.screen;
    canvas.classList.toggle('whole', canvas.width === this.deviceWidth && canvas.height === this.deviceHeight);
  }

  /**
   * Some drivers emulate WebGL without reporting it, so the first warps are timed.
   * @param {number} startedAt
   */
  #measureWarp(startedAt) {
    const times = this.#warpTimes;
    if (this.#renderer !== 'auto' || times.length >= MEASURED_WARPS) {
      return;
    }
    this.screen.finish();
    times.push(performance.now() - startedAt);
    const middle = [...times].sort((a, b) => a - b)[MEASURED_WARPS >> 1];
    if (times.length === MEASURED_WARPS && middle > SLOW_WARP_MS) {
      this.#leaveGl(`a warp takes ${Math.round(middle)} ms`);
    }
  }

  /** @param {string} why */
  #leaveGl(why) {
    if (this.#isDestroyed || this.screen.name !== 'webgl2') {
      return;
    }
    console.warn(`isoscope: goes on without WebGL: ${why}`);
    this.screen.canvas.remove();
    this.screen = makeBitmapScreen();
    this.#root.prepend(this.screen.canvas);
    this.#changed();
  }
}
