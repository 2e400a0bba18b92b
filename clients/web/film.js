// Films: pictures of a turn or of the steps of a series, asked for one by one and put together here.
//
//   1  the first frame is the view's; its answer tells the camera that was fitted and the ranges that it showed
//   2  the others keep both, so that nothing jumps: only the eye goes around, or the step on
//   3  each is the server's exact picture, whose bytes are put into the film (apng.js, webp.js)
//
// Pure: no element, no view.
// @ts-check

import { ApngWriter } from './apng.js';
import { add, normalize, rotate, sub, vecFromJson, vecToJson } from './view/vectors.js';
import { WebpWriter } from './webp.js';

/** @typedef {import('./isoscope-view.js').FrameRequest} FrameRequest */
/**
 * @typedef {object} Film
 * @property {'apng' | 'webp'} format
 * @property {'turn' | 'steps'} kind
 * @property {number} frameCount of a turn
 * @property {number[]} steps of a film of them: their numbers
 * @property {number} framesPerSecond
 * @property {number} width in pixels, as of all frames
 * @property {number} height
 */

/** The most pixels of all frames: 72 frames of 4K. Browsers hold the film until it is saved. */
export const MAX_FILM_PIXELS = 600e6;
export const MAX_FRAMES = 3600;
const MAX_WEBP_SIDE = 16383;

/** @param {Film} film */
export const frameCountOf = ({ kind, frameCount, steps }) => kind === 'steps' ? steps.length : frameCount;

/**
 * Why there is no such film, of the page or the command line, with what to do; '' if there is.
 * @param {Film} film
 */
export function whyNoSuchFilm(film) {
  const { format, framesPerSecond, width, height } = film;
  const count = frameCountOf(film);
  if (!Number.isInteger(count) || count < 2 || count > MAX_FRAMES) {
    return `A film has 2 to ${MAX_FRAMES} frames; this one would have ${Number.isFinite(count) ? count : 'none'}.`;
  }
  if (!(framesPerSecond >= 0.1 && framesPerSecond <= 120)) {
    return 'A film has 0.1 to 120 frames a second.';
  }
  return format === 'webp' && Math.max(width, height) > MAX_WEBP_SIDE
    ? `A WebP has at most ${MAX_WEBP_SIDE} pixels a side: make it smaller, or an APNG.` : '';
}

/**
 * Why the page can't make a film, with what to do; '' if it can.
 * @param {Film} film
 */
export function whyNoFilm(film) {
  const { width, height } = film;
  const count = frameCountOf(film);
  const pixels = count * width * height;
  return whyNoSuchFilm(film) || (pixels <= MAX_FILM_PIXELS ? '' : `${count} frames of ${width} × ${height} are ${Math.ceil(pixels / 1e6)} million ` +
    `pixels, and this page holds ${MAX_FILM_PIXELS / 1e6} million: make it smaller or shorter, or take the command of the film below.`);
}

/**
 * The camera after a turn about its own up, as of `isoscope render --orbit`: all but the eye keeps its bits.
 * @param {any} camera as JSON @param {number} degrees
 */
export function orbited(camera, degrees) {
  const target = vecFromJson(camera.target);
  const up = camera.up ? vecFromJson(camera.up) : /** @type {[number, number, number]} */ ([0, 1, 0]);
  const eye = rotate(sub(vecFromJson(camera.eye), target), normalize(up), degrees * Math.PI / 180);
  return { ...camera, eye: vecToJson(add(target, eye)) };
}

/**
 * Whether the ends of a range are found in one picture.
 * @param {any} range
 */
const isOfPicture = (range) => Boolean(range) && (Boolean(range.percentiles) || range.source === 'SOURCE_VISIBLE');

/**
 * The request with the camera and the ranges that the answer to it has used, for the frames after it.
 * @param {FrameRequest} request @param {Headers} headers of the answer @returns {FrameRequest}
 */
export function keptOf(request, headers) {
  const camera = JSON.parse(headers.get('X-Isoscope-Camera') ?? 'null') ?? request.camera;
  /** @type {Record<string, [number, number]>} */
  const ranges = JSON.parse(headers.get('X-Isoscope-Color-Ranges') ?? '{}');
  /** @param {any} coloring @param {string} name */
  const kept = (coloring, name) => isOfPicture(coloring?.range) && ranges[name]
    ? { ...coloring, range: { min: ranges[name][0], max: ranges[name][1] } } : coloring;
  const surfaces = (request.surfaces ?? []).map((/** @type {any} */ surface, /** @type {number} */ i) =>
    surface.colorBy ? { ...surface, colorBy: kept(surface.colorBy, String(i)) } : surface);
  return { ...request, camera, cameraFit: undefined, surfaces, ...(request.caps ? { caps: kept(request.caps, 'caps') } : {}) };
}

/**
 * @param {Film} film @param {FrameRequest} request of the first frame, or what `keptOf` made of it @param {number} i from 0
 * @returns {FrameRequest}
 */
export function requestOfFrame(film, request, i) {
  if (film.kind === 'steps') {
    const { time, ...selection } = request.selection ?? {};
    return { ...request, selection: { ...selection, timeStep: film.steps[i] } };
  }
  return i === 0 ? request : { ...request, camera: orbited(request.camera, 360 * i / film.frameCount) };
}

/**
 * Whether only an answer tells the camera and the ranges of a request.
 * @param {FrameRequest} request
 */
const isOpen = ({ camera, cameraFit, caps, surfaces }) => !camera || Boolean(cameraFit) || isOfPicture(caps?.range) ||
  (surfaces ?? []).some((/** @type {any} */ { colorBy }) => isOfPicture(colorBy?.range));

/**
 * Draws a film. Rejects with the error of the frame that failed, which it names, or with that of the signal.
 * @param {Film} film of which `whyNoFilm` says nothing @param {FrameRequest} request of the view, without a size
 * @param {(request: FrameRequest, format: 'png' | 'webp') => Promise<Response>} draw of a WebP, camera and ranges are given
 * @param {AbortSignal} signal @param {(doneCount: number) => void} tell before each frame
 * @returns {Promise<Blob>}
 */
export async function drawFilm(film, request, draw, signal, tell) {
  const count = frameCountOf(film);
  const isWebp = film.format === 'webp';
  const writer = new (isWebp ? WebpWriter : ApngWriter)({ frameCount: count, framesPerSecond: film.framesPerSecond });
  // A frame of APNG has the channels of the first one, and only opaque pictures are all alike.
  /** @type {FrameRequest} */
  let kept = { ...request, backgroundColor: { ...request.backgroundColor, alpha: 1 }, viewport: { widthPx: film.width, heightPx: film.height } };
  for (let i = 0; i < count; ++i) {
    tell(i);
    try {
      if (i === 0 && isWebp && isOpen(kept)) {
        // An address can't ask for all that a posted request can: this picture is for its camera and ranges alone.
        kept = keptOf(kept, (await draw(requestOfFrame(film, kept, 0), 'png')).headers);
      }
      const answer = await draw(requestOfFrame(film, kept, i), isWebp ? 'webp' : 'png');
      if (i === 0) {
        kept = keptOf(kept, answer.headers);
      }
      writer.add(new Uint8Array(await answer.arrayBuffer()));
    } catch (error) {
      signal.throwIfAborted();
      throw new Error(`Frame ${i + 1} of ${count}: ${/** @type {Error} */ (error).message}`);
    }
  }
  return writer.finish();
}
