// Frames drawn by WebGL2. A frame of the current camera is drawn as it is. For another camera, each
// point of its depth grid is a quad at its depth: a relief that is seen from there.
// @ts-check

import { isSameCamera } from './camera.js';
import { jumpOf, makeWarp } from './relief.js';
import { length, sub } from './vectors.js';

/** @typedef {import('./types.js').Camera} Camera */
/** @typedef {import('./types.js').DepthGrid} DepthGrid */
/** @typedef {import('./types.js').ShownFrame} ShownFrame */
/** @typedef {import('./picture.js').Screen} Screen */

const VERTEX_SHADER = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
uniform usampler2D depths;
uniform ivec2 grid;
uniform vec4 depthRange;  // near, far, jump, jump for each unit of depth
uniform mat3 turn;
uniform vec3 offset;
uniform vec4 spans;       // of the frame, of the canvas
uniform bvec3 mode;       // flat, frame in perspective, canvas in perspective
uniform vec2 flatScale;
uniform vec2 clipPlanes;  // near, far
out vec2 place;

float depthAt(ivec2 at) {
  if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, grid))) return -1.0;
  uint value = texelFetch(depths, at, 0).r;
  return value == 65535u ? -1.0 : mix(depthRange.x, depthRange.y, float(value) / 65534.0);
}

void main() {
  ivec2 corner = ivec2(gl_VertexID & 1, gl_VertexID >> 1);
  if (mode.x) {
    place = vec2(corner);
    gl_Position = vec4((2.0 * place.x - 1.0) * flatScale.x, (1.0 - 2.0 * place.y) * flatScale.y, 0.0, 1.0);
    return;
  }
  ivec2 cell = ivec2(gl_InstanceID % grid.x, gl_InstanceID / grid.x);
  place = vec2(cell + corner) / vec2(grid);
  float own = depthAt(cell);
  for (int k = 0; own < 0.0 && k < 1; ++k) {
    for (int n = 0; n < 9; ++n) own = max(own, depthAt(cell + ivec2(n % 3 - 1, n / 3 - 1)));
  }
  if (own < 0.0) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    return;
  }
  float sum = 0.0;
  float count = 0.0;
  for (int k = 0; k < 4; ++k) {
    float depth = depthAt(cell + corner - 1 + ivec2(k & 1, k >> 1));
    if (depth >= 0.0 && abs(depth - own) <= depthRange.z + depthRange.w * min(depth, own)) {
      sum += depth;
      count += 1.0;
    }
  }
  float depth = count > 0.0 ? sum / count : own;
  float s = mode.y ? depth : 1.0;
  vec3 p = turn * vec3((2.0 * place.x - 1.0) * spans.x * s, (1.0 - 2.0 * place.y) * spans.y * s, depth) + offset;
  float n = clipPlanes.x;
  float f = clipPlanes.y;
  gl_Position = mode.z ? vec4(p.xy / spans.zw, ((f + n) * p.z - 2.0 * f * n) / (f - n), p.z)
                       : vec4(p.xy / spans.zw, (2.0 * p.z - f - n) / (f - n), 1.0);
}`;

const FRAGMENT_SHADER = `#version 300 es
precision highp float;
uniform sampler2D picture;
uniform vec2 pictureSize;
uniform bool isEnlarged;
in vec2 place;
out vec4 color;

// The cubic of Mitchell and Netravali (1988), of 16 pixels by nine looks between them.
vec3 smoothAt(vec2 at) {
  vec2 texel = at * pictureSize;
  vec2 middle = floor(texel - 0.5) + 0.5;
  vec2 f = texel - middle;
  vec2 f2 = f * f;
  vec2 f3 = f2 * f;
  vec2 first = (1.0 - 9.0 * f + 15.0 * f2 - 7.0 * f3) / 18.0;
  vec2 third = (1.0 + 9.0 * f + 27.0 * f2 - 21.0 * f3) / 18.0;
  vec2 last = (7.0 * f3 - 6.0 * f2) / 18.0;
  vec2 inner = 1.0 - first - last;
  vec2 a = (middle - 1.0) / pictureSize;
  vec2 b = (middle + third / inner) / pictureSize;
  vec2 c = (middle + 2.0) / pictureSize;
  vec3 top = texture(picture, a).rgb * first.x + texture(picture, vec2(b.x, a.y)).rgb * inner.x +
             texture(picture, vec2(c.x, a.y)).rgb * last.x;
  vec3 center = texture(picture, vec2(a.x, b.y)).rgb * first.x + texture(picture, b).rgb * inner.x +
                texture(picture, vec2(c.x, b.y)).rgb * last.x;
  vec3 bottom = texture(picture, vec2(a.x, c.y)).rgb * first.x + texture(picture, vec2(b.x, c.y)).rgb * inner.x +
                texture(picture, c).rgb * last.x;
  return clamp(top * first.y + center * inner.y + bottom * last.y, 0.0, 1.0);
}

void main() {
  color = isEnlarged ? vec4(smoothAt(place), 1.0) : texture(picture, place);
}`;

/** A frame of less than this share of the canvas is smoothed by a cubic. */
const ENLARGED_SHARE = 0.9;
/** The texture units. */
const PICTURE_UNIT = 0;
const DEPTHS_UNIT = 1;
/** That of a picture which is drawn into. */
const TARGET_UNIT = 2;

/**
 * Compiles and links the program; null, with a warning, where that fails.
 * @param {WebGL2RenderingContext} gl @returns {WebGLProgram | null}
 */
function linkProgram(gl) {
  const program = /** @type {WebGLProgram} */ (gl.createProgram());
  for (const [type, source] of /** @type {[number, string][]} */ (
    [[gl.VERTEX_SHADER, VERTEX_SHADER], [gl.FRAGMENT_SHADER, FRAGMENT_SHADER]])) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(type));
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) {
      console.warn(`isoscope: a shader does not compile here: ${gl.getShaderInfoLog(shader)}`);
      return null;
    }
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  return gl.getProgramParameter(program, gl.LINK_STATUS) ? program : null;
}

/**
 * Makes the texture of a unit.
 * @param {WebGL2RenderingContext} gl @param {number} unit
 */
function makeTexture(gl, unit) {
  const texture = gl.createTexture();
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(gl.TEXTURE_2D, texture);
  for (const [name, value] of [[gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
    [gl.TEXTURE_MIN_FILTER, gl.NEAREST], [gl.TEXTURE_MAG_FILTER, gl.NEAREST]]) {
    gl.texParameteri(gl.TEXTURE_2D, name, value);
  }
  return texture;
}

/**
 * Makes the textures of picture and depths.
 * @param {WebGL2RenderingContext} gl
 */
function makeTextures(gl) {
  makeTexture(gl, PICTURE_UNIT);
  makeTexture(gl, DEPTHS_UNIT);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
}

/** Draws by WebGL2: a frame as it is, or as a relief from another camera. @implements {Screen} */
class GlScreen {
  name = 'webgl2';
  isWarping = true;
  #gl;
  #at;
  /** @type {ShownFrame | null} */
  #frame = null;

  /** @param {HTMLCanvasElement} canvas @param {WebGL2RenderingContext} gl @param {WebGLProgram} program */
  constructor(canvas, gl, program) {
    this.canvas = canvas;
    this.#gl = gl;
    gl.useProgram(program);
    /** @param {string} name */
    const uniform = (name) => gl.getUniformLocation(program, name);
    this.#at = {
      grid: uniform('grid'), depthRange: uniform('depthRange'), turn: uniform('turn'), offset: uniform('offset'),
      spans: uniform('spans'), mode: uniform('mode'), flatScale: uniform('flatScale'),
      clipPlanes: uniform('clipPlanes'), pictureSize: uniform('pictureSize'), isEnlarged: uniform('isEnlarged'),
    };
    gl.uniform1i(uniform('picture'), PICTURE_UNIT);
    gl.uniform1i(uniform('depths'), DEPTHS_UNIT);
    makeTextures(gl);
  }

  /** @param {ImageBitmap} bitmap @param {ShownFrame} frame */
  show(bitmap, frame) {
    const gl = this.#gl;
    gl.activeTexture(gl.TEXTURE0 + PICTURE_UNIT);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, bitmap);
    bitmap.close();
    if (frame.grid) {
      gl.activeTexture(gl.TEXTURE0 + DEPTHS_UNIT);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.R16UI, frame.grid.width, frame.grid.height, 0,
        gl.RED_INTEGER, gl.UNSIGNED_SHORT, frame.grid.values);
    }
    this.#frame = frame;
  }

  /** @param {ImageBitmap} bitmap @param {import('./picture.js').Corner} at @param {ShownFrame} frame */
  paint(bitmap, at, frame) {
    const gl = this.#gl;
    if (this.#frame?.width !== frame.width || this.#frame.height !== frame.height) {
      this.#scale(frame);
    }
    gl.activeTexture(gl.TEXTURE0 + PICTURE_UNIT);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, at.x, at.y, gl.RGBA, gl.UNSIGNED_BYTE, bitmap);
    bitmap.close();
    this.#frame = frame;
  }

  /**
   * Gives the picture the size of a frame.
   * @param {ShownFrame} frame
   */
  #scale({ width, height, background }) {
    const gl = this.#gl;
    gl.activeTexture(gl.TEXTURE0 + PICTURE_UNIT);
    const before = gl.getParameter(gl.TEXTURE_BINDING_2D);
    const target = makeTexture(gl, TARGET_UNIT);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
    const buffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
    gl.viewport(0, 0, width, height);
    gl.clearColor(background[0], background[1], background[2], 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    if (this.#frame) {
      this.#setPicture(this.#frame, height, false);
      this.#drawFlat(this.#frame, width, height, -1);  // row 0 of a texture is the first of a picture
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(buffer);
    gl.bindTexture(gl.TEXTURE_2D, null);
    gl.activeTexture(gl.TEXTURE0 + PICTURE_UNIT);
    gl.bindTexture(gl.TEXTURE_2D, target);
    gl.deleteTexture(before);
  }

  /**
   * Says how the picture is looked up.
   * @param {ShownFrame} frame @param {number} height of what is drawn to @param {boolean} isPixelByPixel
   */
  #setPicture(frame, height, isPixelByPixel) {
    const gl = this.#gl;
    gl.activeTexture(gl.TEXTURE0 + PICTURE_UNIT);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
      gl.texParameteri(gl.TEXTURE_2D, name, isPixelByPixel ? gl.NEAREST : gl.LINEAR);
    }
    // A moving frame of a large volume has few pixels: bilinear, each of them would be seen.
    gl.uniform2f(this.#at.pictureSize, frame.width, frame.height);
    gl.uniform1i(this.#at.isEnlarged, frame.height < ENLARGED_SHARE * height ? 1 : 0);
  }

  /** @param {ShownFrame} frame @param {number} width @param {number} height of what is drawn to @param {1 | -1} up */
  #drawFlat(frame, width, height, up) {
    const gl = this.#gl;
    gl.disable(gl.DEPTH_TEST);
    gl.uniform3i(this.#at.mode, 1, 1, 1);
    // The picture has the height of the view; it may be wider or narrower.
    gl.uniform2f(this.#at.flatScale, frame.width / frame.height / (width / height), up);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  /** @param {number} width @param {number} height */
  resize(width, height) {
    this.canvas.width = width;
    this.canvas.height = height;
  }

  /** @param {Camera} camera */
  draw(camera) {
    const { canvas } = this;
    const gl = this.#gl;
    const frame = this.#frame;
    if (!frame || canvas.width === 0 || canvas.height === 0) {
      return false;
    }
    const grid = isSameCamera(frame.camera, camera) ? null : frame.grid;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(frame.background[0], frame.background[1], frame.background[2], 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const isPixelByPixel = !grid && frame.width === canvas.width && frame.height === canvas.height;
    this.#setPicture(frame, canvas.height, isPixelByPixel);
    if (grid) {
      gl.uniform3i(this.#at.mode, 0, frame.camera.height > 0 ? 0 : 1, camera.height > 0 ? 0 : 1);
      this.#drawRelief(frame, grid, camera);
      return true;
    }
    this.#drawFlat(frame, canvas.width, canvas.height, 1);
    return false;
  }

  /** @param {ShownFrame} frame @param {DepthGrid} grid of the frame @param {Camera} camera */
  #drawRelief(frame, grid, camera) {
    const gl = this.#gl;
    const at = this.#at;
    const warp = makeWarp(frame.camera, frame.width / frame.height, camera, this.canvas.width / this.canvas.height);
    const jump = jumpOf(frame.camera, grid.height);
    gl.enable(gl.DEPTH_TEST);
    gl.uniform2i(at.grid, grid.width, grid.height);
    gl.uniformMatrix3fv(at.turn, false, warp.matrix);
    gl.uniform3f(at.offset, warp.offset[0], warp.offset[1], warp.offset[2]);
    gl.uniform4f(at.spans, warp.fromSpan[0], warp.fromSpan[1], warp.toSpan[0], warp.toSpan[1]);
    const reach = grid.far + length(sub(frame.camera.eye, camera.eye)) + grid.far - grid.near;
    gl.uniform2f(at.clipPlanes, camera.height > 0 ? -reach : reach * 1e-3, reach * 2);
    // First without cuts, which fills hidden parts from their surroundings; then with cuts, on top.
    for (const [any, perDepth] of [[1e30, 0], [jump.jump, jump.jumpPerDepth]]) {
      gl.clear(gl.DEPTH_BUFFER_BIT);
      gl.uniform4f(at.depthRange, grid.near, grid.far, any, perDepth);
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, grid.width * grid.height);
    }
  }

  finish() {
    const gl = this.#gl;
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  destroy() {
    this.#frame = null;
    this.#gl.getExtension('WEBGL_lose_context')?.loseContext();
    this.canvas.remove();
  }
}

/**
 * Makes a screen by WebGL2; null where there is none.
 * @param {HTMLCanvasElement} canvas a new one
 * @param {(why: string) => void} lost called when the context is lost @returns {Screen | null}
 */
export function makeGlScreen(canvas, lost) {
  const gl = canvas.getContext('webgl2', { antialias: false, alpha: false, preserveDrawingBuffer: false });
  const program = gl && linkProgram(gl);
  if (!program) {
    return null;
  }
  canvas.addEventListener('webglcontextlost', (event) => {
    event.preventDefault();
    lost('the graphics driver took the canvas away');
  });
  return new GlScreen(canvas, gl, program);
}

/** Says whether WebGL2 is there and not done by the processor. */
export function hasFastWebGl() {
  const canvas = document.createElement('canvas');
  const gl = canvas.getContext('webgl2');
  if (!gl) {
    return false;
  }
  const info = gl.getExtension('WEBGL_debug_renderer_info');
  const name = String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  gl.getExtension('WEBGL_lose_context')?.loseContext();
  return !/swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}
