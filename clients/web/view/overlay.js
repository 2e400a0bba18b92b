// Axes, scale bar, boxes and pins, which lie over the picture.
// @ts-check

import { basisOf, project, spanAt } from './camera.js';
import { axisNamesOf, boxOfDataset, lengthUnitOf } from './named-views.js';
import { makeCanvas } from './picture.js';
import { JUMP_CELLS, gridDepth, jumpOf } from './relief.js';
import { sub, vecFromJson } from './vectors.js';

/** @typedef {import('./types.js').Vec3} Vec3 */
/** @typedef {import('./types.js').Box} Box */
/** @typedef {import('./types.js').Camera} Camera */
/** @typedef {import('./types.js').DatasetJson} DatasetJson */
/** @typedef {import('./types.js').FrameRequest} FrameRequest */
/** @typedef {import('./types.js').ShownFrame} ShownFrame */
/** @typedef {import('./picture.js').Picture} Picture */

/**
 * @typedef {{position: Vec3, label?: string, isStale?: boolean}} Pin `isStale`: faded
 * @typedef {{red?: number, green?: number, blue?: number}} Rgb
 * @typedef {{camera: Camera, frame: ShownFrame | null, box: Box | null, clipBox: Box | null,
 *   axisNames: string[], pins: Pin[], ink: string, halo: string, showBox: boolean}} Scene
 */

/**
 * Returns the largest of 1, 2 and 5 times a power of ten that is at most `limit`.
 * @param {number} limit above 0
 */
export function roundLength(limit) {
  const power = 10 ** Math.floor(Math.log10(limit));
  return [5, 2, 1].map((digit) => digit * power).find((value) => value <= limit * (1 + 1e-9)) ?? power;
}

/** The side of the picture of the axes, and the most that a scale bar takes, in CSS pixels. */
export const AXES_PX = 92;
export const SCALE_BAR_PX = 160;
const AXIS_COLORS = ['#ff6b6b', '#5fd08a', '#6aa8ff'];
/** Of pins and the clip box. */
const MARK_COLOR = '#ffb454';

/**
 * Says whether the frame's relief hides a point.
 * @param {ShownFrame | null} frame @param {Vec3} p
 */
function isHidden(frame, p) {
  if (!frame?.grid) {
    return false;
  }
  const at = project(frame.camera, frame.width / frame.height, p);
  const i = Math.floor((at.x + 1) / 2 * frame.grid.width);
  const j = Math.floor((1 - at.y) / 2 * frame.grid.height);
  const depth = gridDepth(frame.grid, i, j);
  return depth >= 0 && at.distance > depth + 2 * jumpOf(frame.camera, frame.grid.height).jumpPerDepth / JUMP_CELLS * depth;
}

/**
 * @param {CanvasRenderingContext2D} context @param {string} text @param {number} x @param {number} y
 * @param {string} color @param {string} halo
 */
function drawLabel(context, text, x, y, color, halo) {
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  context.font = '600 12px system-ui, sans-serif';
  context.lineWidth = 3;
  context.strokeStyle = halo;
  context.lineJoin = 'round';
  context.strokeText(text, x, y);
  context.fillStyle = color;
  context.fillText(text, x, y);
}

/**
 * Draws a line through points.
 * @param {CanvasRenderingContext2D} context @param {string} color @param {number} width
 * @param {[number, number][]} points
 */
function drawLine(context, color, width, points) {
  context.strokeStyle = color;
  context.lineWidth = width;
  context.beginPath();
  points.forEach(([x, y]) => context.lineTo(x, y));
  context.stroke();
}

/**
 * A camera's points in CSS pixels of a view.
 * @typedef {(p: Vec3) => {x: number, y: number, isSeen: boolean}} ToScreen
 */

/**
 * Draws the edges of a box, paler where the frame hides them.
 * @param {CanvasRenderingContext2D} context @param {ToScreen} toScreen @param {ShownFrame | null} frame
 * @param {Box} box @param {string} color
 */
function drawBox(context, toScreen, frame, box, color) {
  const pieces = 48;
  for (let edge = 0; edge < 12; ++edge) {
    const axis = edge >> 2;
    /** @type {Vec3} */
    const begin = [...box.min];
    begin[(axis + 1) % 3] = edge & 1 ? box.max[(axis + 1) % 3] : box.min[(axis + 1) % 3];
    begin[(axis + 2) % 3] = edge & 2 ? box.max[(axis + 2) % 3] : box.min[(axis + 2) % 3];
    let previous = toScreen(begin);
    for (let k = 1; k <= pieces; ++k) {
      /** @type {Vec3} */
      const p = [...begin];
      p[axis] = box.min[axis] + (box.max[axis] - box.min[axis]) * k / pieces;
      const at = toScreen(p);
      if (previous.isSeen && at.isSeen) {
        context.globalAlpha = isHidden(frame, p) ? 0.12 : 0.75;
        drawLine(context, color, 1.25, [[previous.x, previous.y], [at.x, at.y]]);
      }
      previous = at;
    }
  }
  context.globalAlpha = 1;
}

/**
 * Draws points; a dashed line joins two.
 * @param {CanvasRenderingContext2D} context @param {ToScreen} toScreen @param {Pin[]} pins @param {string} halo
 */
function drawPins(context, toScreen, pins, halo) {
  if (pins.length === 2) {
    const [a, b] = pins.map((pin) => toScreen(pin.position));
    context.setLineDash([5, 4]);
    drawLine(context, MARK_COLOR, 1.5, [[a.x, a.y], [b.x, b.y]]);
    context.setLineDash([]);
  }
  for (const pin of pins) {
    const at = toScreen(pin.position);
    if (at.isSeen) {
      context.globalAlpha = pin.isStale ? 0.35 : 1;
      context.beginPath();
      context.arc(at.x, at.y, 5, 0, 2 * Math.PI);
      context.fillStyle = MARK_COLOR;
      context.fill();
      context.lineWidth = 2;
      context.strokeStyle = '#1a1206';
      context.stroke();
      if (pin.label) {
        drawLabel(context, pin.label, at.x, at.y - 15, MARK_COLOR, halo);
      }
    }
  }
  context.globalAlpha = 1;
}

/**
 * Draws boxes and pins, which are part of the scene.
 * @param {CanvasRenderingContext2D} context @param {number} width @param {number} height in CSS pixels
 * @param {Scene} scene
 */
function drawOverlay(context, width, height, scene) {
  /** @type {ToScreen} */
  const toScreen = (p) => {
    const at = project(scene.camera, width / height, p);
    return { x: (at.x + 1) / 2 * width, y: (1 - at.y) / 2 * height,
      isSeen: scene.camera.height > 0 || at.distance > 0 };
  };
  context.clearRect(0, 0, width, height);
  context.lineCap = 'round';
  for (const [box, color] of /** @type {[Box | null, string][]} */ ([[scene.box, scene.ink], [scene.clipBox, MARK_COLOR]])) {
    if (scene.showBox && box) {
      drawBox(context, toScreen, scene.frame, box, color);
    }
  }
  drawPins(context, toScreen, scene.pins, scene.halo);
}

/**
 * Draws the directions of the world, on a square of AXES_PX.
 * @param {CanvasRenderingContext2D} context @param {Scene} scene
 */
function drawAxes(context, scene) {
  context.clearRect(0, 0, AXES_PX, AXES_PX);
  context.lineCap = 'round';
  const { right, up, forward } = basisOf(scene.camera);
  const center = { x: AXES_PX / 2, y: AXES_PX / 2 };
  const arm = 26;
  const axes = AXIS_COLORS.map((color, axis) => ({
    x: right[axis], y: up[axis], depth: forward[axis], color,
    label: scene.axisNames[axis],
  })).sort((a, b) => b.depth - a.depth);
  for (const axis of axes) {
    const end = { x: center.x + arm * axis.x, y: center.y - arm * axis.y };
    drawLine(context, scene.halo, 5, [[center.x, center.y], [end.x, end.y]]);
    drawLine(context, axis.color, 2.5, [[center.x, center.y], [end.x, end.y]]);
  }
  // No line lies over a letter.
  for (const axis of axes) {
    const reach = Math.hypot(axis.x, axis.y);
    const away = reach > 0.2 ? (arm * reach + 10) / reach : arm;
    drawLabel(context, axis.label, center.x + away * axis.x, center.y - away * axis.y, axis.color, scene.halo);
  }
}

/**
 * Returns the scale bar: its length in CSS pixels, and its text.
 * @param {Camera} camera @param {number} width @param {number} height of the view in CSS pixels
 */
function scaleBarOf(camera, width, height) {
  const span = spanAt(camera, basisOf(camera).distance) * 2 / height;
  const reach = roundLength(span * Math.min(SCALE_BAR_PX, width / 4));
  return { px: reach / span, text: String(Number(reach.toPrecision(6))) };
}

/**
 * Draws a scale bar that ends at the right of its canvas.
 * @param {CanvasRenderingContext2D} context @param {{px: number, text: string}} bar
 * @param {{ink: string, halo: string}} colors
 */
function drawScaleBar(context, bar, { ink, halo }) {
  const x = SCALE_BAR_PX + 20;
  const y = 34;
  context.clearRect(0, 0, x + 4, y + 4);
  context.lineCap = 'round';
  /** @type {[number, number][]} */
  const points = [[x - bar.px, y - 4], [x - bar.px, y], [x, y], [x, y - 4]];
  drawLine(context, halo, 4, points);
  drawLine(context, ink, 2, points);
  drawLabel(context, bar.text, x - bar.px / 2, y - 14, ink, halo);
}

/**
 * The colours of lines and of their halos over a background.
 * @param {Rgb} background
 */
function inkOver({ red = 0, green = 0, blue = 0 }) {
  return 0.3 * red + 0.59 * green + 0.11 * blue > 0.55 ? { ink: '#1b2430', halo: 'rgba(255,255,255,.75)' }
    : { ink: '#e8eef7', halo: 'rgba(0,0,0,.6)' };
}

/**
 * Three small canvases over a picture: anything drawn over the whole picture is composited with it again at
 * each change. A canvas is drawn only when its content changes.
 */
export class Overlay {
  #picture;
  // The content of each canvas.
  /** @type {Map<HTMLCanvasElement, string>} */
  #drawn = new Map();

  /**
   * @param {Picture} picture below it
   * @param {{axes?: boolean, scaleBar?: boolean, box?: boolean}} options
   */
  constructor(picture, { axes = true, scaleBar = true, box = false }) {
    this.#picture = picture;
    this.shown = { axes, scaleBar, box };
    /** @type {Pin[]} */
    this.pins = [];
    this.scene = makeCanvas('overlay');
    this.axes = makeCanvas('overlay axes');
    this.scaleBar = makeCanvas('overlay scale-bar');
    picture.screen.canvas.after(this.scene, this.axes, this.scaleBar);
  }

  /** Draws all of it again: the pixels of the picture have another size. */
  resized() {
    this.#drawn.clear();
  }

  /**
   * @param {Camera} camera of the view @param {FrameRequest} state @param {DatasetJson | null} dataset
   * @param {number} frames how many have been shown
   */
  draw(camera, state, dataset, frames) {
    const { frame, screen, cssWidth, cssHeight } = this.#picture;
    if (cssWidth === 0 || cssHeight === 0) {
      return;
    }
    const { shown, pins } = this;
    const clip = state.clip?.box;
    const axisNames = axisNamesOf(dataset);
    /** @type {Scene} */
    const scene = {
      // An unwarped picture is late, and its overlay must be equally late.
      camera: screen.isWarping ? camera : frame?.camera ?? camera, frame, box: boxOfDataset(dataset),
      clipBox: clip ? { min: vecFromJson(clip.min), max: vecFromJson(clip.max) } : null, axisNames, pins,
      ...inkOver(state.backgroundColor ?? {}), showBox: shown.box };
    const { eye, target, up } = scene.camera;
    const bar = scaleBarOf(scene.camera, cssWidth, cssHeight);
    bar.text += ` ${lengthUnitOf(dataset)}`.trimEnd();
    this.#drawOn(this.axes, AXES_PX, AXES_PX, shown.axes ? [sub(target, eye), up, axisNames, scene.ink] : null,
      (context) => drawAxes(context, scene));
    this.#drawOn(this.scaleBar, SCALE_BAR_PX + 24, 38, shown.scaleBar ? [bar.px.toFixed(1), bar.text, scene.ink] : null,
      (context) => drawScaleBar(context, bar, scene));
    this.#drawOn(this.scene, cssWidth, cssHeight, shown.box || pins.length > 0
      ? [scene.camera, frames, scene.box, scene.clipBox, pins, shown.box, scene.ink] : null,
    (context) => drawOverlay(context, cssWidth, cssHeight, scene));
  }

  /**
   * Draws on a canvas if its content has changed; hides it if there is none (null).
   * @param {HTMLCanvasElement} canvas @param {number} width @param {number} height in CSS pixels
   * @param {any[] | null} content @param {(context: CanvasRenderingContext2D) => void} draw
   */
  #drawOn(canvas, width, height, content, draw) {
    const words = JSON.stringify(content);
    if (this.#drawn.get(canvas) === words) {
      return;
    }
    this.#drawn.set(canvas, words);
    // A hidden canvas holds no pixels.
    const { ratio } = this.#picture;
    const [across, down] = content === null ? [0, 0] : [Math.round(width * ratio), Math.round(height * ratio)];
    if (canvas.width !== across || canvas.height !== down) {
      canvas.width = across;
      canvas.height = down;
    }
    canvas.hidden = content === null;
    const context = content === null ? null : canvas.getContext('2d');
    if (context) {
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      draw(context);
    }
  }
}
