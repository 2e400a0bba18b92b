// Colour maps, effects and the first look, as the protos have them (isoscope/v1/options.proto).
// Written by page_parameters_test, with ISOSCOPE_REGENERATE_PAGE=1. Do not edit.
// @ts-check

/**
 * @typedef {object} EffectValue
 * @property {string} json name in messages
 * @property {'whole' | 'number' | 'color'} kind
 * @property {string} initial default, as people write it
 */
/**
 * @typedef {object} Effect
 * @property {string} flag
 * @property {string} json name in messages
 * @property {string} title
 * @property {EffectValue[]} values in the order in which people write them; the first is a number
 */

export const COLOR_MAPS = ['viridis', 'magma', 'cividis', 'turbo', 'cool-warm', 'grey'];
/** @type {Effect[]} */
export const EFFECTS = [
  { flag: 'ambient-occlusion', json: 'ambientOcclusion', title: 'Ambient occlusion', values: [
    { json: 'radiusPx', kind: 'whole', initial: '32' },
    { json: 'strength', kind: 'number', initial: '1' },
  ] },
  { flag: 'silhouette', json: 'silhouette', title: 'Silhouettes', values: [
    { json: 'widthPx', kind: 'whole', initial: '2' },
    { json: 'color', kind: 'color', initial: 'black' },
  ] },
];
/** What is asked for where people ask for no camera. */
export const FIRST_LOOK = { samples: 4, material: { diffuse: 0.78, specular: 0.1, shininess: 24 } };
