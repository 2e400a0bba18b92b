// The commands of `isoscope` that make what the page downloads: its picture, its film, its mesh. They name the file that
// `isoscope view` was given, else a server. Pure: no element, no view.
// @ts-check

import { drawnToWords, stateOfMesh, stateToWords } from './view-state.js';

/** @typedef {import('./view-state.js').FrameRequest} FrameRequest */
/** @typedef {import('./view-state.js').Drawn} Drawn */
/** @typedef {import('./film.js').Film} Film */
/**
 * What a command reads: a file in place of a server and its dataset.
 * @typedef {{file?: string, hasToken?: boolean}} Source
 */

/** @param {string} value as a shell takes it */
const quoted = (value) => /^[\w.,:+/-]+$/.test(value) ? value : `'${value.replace(/'/g, '\'\\\'\'')}'`;

/**
 * The command of some words. Its reader knows the coordinator's address and the file of its token, the page does not.
 * @param {'render' | 'export'} verb @param {Source} source @param {string | undefined} dataset of a server @param {[string, string][]} words
 */
function commandOf(verb, { file, hasToken }, dataset, words) {
  const input = file ? [`isoscope ${verb} ${quoted(file.startsWith('-') ? `./${file}` : file)}`]
    : [`isoscope ${verb} --server HOST:50051`, ...(hasToken ? ['--token-file TOKEN_FILE'] : []), ...(dataset ? [`--dataset ${quoted(dataset)}`] : [])];
  return [...input, ...words.map(([name, value]) => value === '' ? `--${name}` : `--${name} ${quoted(value)}`)].join(' \\\n  ');
}

/**
 * The file of a dataset that a command can read in place of a server: that of `isoscope view`, whose coordinator names
 * this very page, on this machine. '' where a server may be far away.
 * @param {any} dataset @param {string} gatewayAddress of the coordinator @param {string} pageAddress
 */
export function fileOf(dataset, gatewayAddress, pageAddress) {
  try {
    const [told, page] = [new URL(gatewayAddress), new URL('./', pageAddress)];
    const isOwn = told.href === page.href && /^(127\.\d+\.\d+\.\d+|localhost|\[::1\])$/.test(page.hostname);
    return isOwn ? String(dataset?.source ?? '') : '';
  } catch {
    return '';  // the coordinator names no page
  }
}

/**
 * The words of a picture. A fitted view has its own camera once the server has answered. Until then they have the
 * initial camera, because a command takes no fit with a camera.
 * @param {FrameRequest} state @param {Drawn} drawn @param {{width: number, height: number}} [size]
 * @returns {[string, string][]}
 */
function wordsOfPicture({ dataset, ...state }, drawn, size) {
  const words = [...stateToWords(state.camera ? { ...state, cameraFit: undefined } : state), ...drawnToWords(drawn)];
  return size ? [...words, ['width', String(size.width)], ['height', String(size.height)]] : words;
}

/**
 * Returns the command that draws the same picture.
 * @param {FrameRequest} state @param {string} file @param {{width: number, height: number}} [size] @param {Source} [source]
 * @param {Drawn} [drawn]
 */
export const stateToCommand = (state, file, size, source = {}, drawn = {}) =>
  commandOf('render', source, state.dataset, [...wordsOfPicture(state, drawn, size), ['output', file]]);

/**
 * The steps of a film as `--step` takes them: 'A:B' or 'A:B:STRIDE', which counts numbers; null if that are others.
 * @param {number[]} steps of the film @param {number[]} served all of the field
 */
function wordOfSteps(steps, served) {
  const [first, last] = [steps[0], steps[steps.length - 1]];
  const isSame = (/** @type {number} */ stride) =>
    served.filter((number) => number >= first && number <= last && (number - first) % stride === 0).join() === steps.join();
  const stride = [1, steps[1] - first].find(isSame);
  return stride === undefined ? null : `${first}:${last}${stride === 1 ? '' : `:${stride}`}`;
}

/**
 * Returns the command that draws the same film; null where it can't name the film's steps.
 * @param {Film} film of two frames or more @param {number[]} served the numbers of all steps @param {FrameRequest} state
 * @param {Source} [source] @param {Drawn} [drawn]
 */
export function filmToCommand(film, served, state, source = {}, drawn = {}) {
  const { time, timeStep, ...selection } = state.selection ?? {};
  const steps = film.kind === 'steps' ? wordOfSteps(film.steps, served) : '';
  /** @type {[string, string][]} */
  const frames = film.kind === 'turn' ? [['repeat', String(film.frameCount)], ['orbit', String(360 / film.frameCount)]] : [['step', steps ?? '']];
  const shown = film.kind === 'steps' ? { ...state, selection } : state;
  return steps === null ? null : commandOf('render', source, state.dataset, [...wordsOfPicture(shown, drawn, film), ...frames,
    ['fps', String(film.framesPerSecond)], ['output', `film.${film.format}`]]);
}

/**
 * Returns the command that writes the same mesh.
 * @param {FrameRequest} state @param {string} format @param {Source} [source]
 */
export const meshToCommand = (state, format, source = {}) =>
  commandOf('export', source, state.dataset, [...stateToWords(stateOfMesh(state, format)), ['output', `mesh.${format}`]]);
