// Levels of datasets, and what an exact picture may cost, as menus and links have them. Pure: no element, no view.
// @ts-check

/** @typedef {import('./view/refinement.js').Limits} Limits */
/** @typedef {Record<string, any>} LevelChoice LevelChoice as JSON */

/**
 * What the page lets an exact picture cost by itself.
 * @type {Limits}
 */
export const DEFAULT_LIMITS = { seconds: 10, bytes: 4e9 };
/** What "by spacing" begins with, in pixels: about a sample a pixel. */
export const DEFAULT_SPACING_PX = 1.1;

const NO_LIMIT = 'none';

/**
 * The limits as a word of a link, "60,none": seconds, gigabytes. '' for those of the page.
 * @param {Limits} [limits]
 */
export function textOfLimits(limits = DEFAULT_LIMITS) {
  const { seconds, bytes } = limits;
  const isDefault = seconds === DEFAULT_LIMITS.seconds && bytes === DEFAULT_LIMITS.bytes;
  return isDefault ? '' : [seconds, bytes === null ? null : bytes / 1e9].map((value) => value ?? NO_LIMIT).join();
}

/**
 * A limit that people write; null where there is none, undefined where it is wrong.
 * @param {string} text
 */
function limitOfText(text) {
  const value = text === NO_LIMIT ? null : text.trim() === '' ? NaN : Number(text);
  return value === null || value > 0 && value <= 1e9 ? value : undefined;
}

/**
 * The limits of a word of a link; null if it is none.
 * @param {string} text @returns {Limits | null}
 */
export function limitsOfText(text) {
  const [seconds, gigabytes, ...rest] = text.split(',').map(limitOfText);
  return seconds === undefined || gigabytes === undefined || rest.length > 0 ? null
    : { seconds, bytes: gigabytes === null ? null : gigabytes * 1e9 };
}

/**
 * What a menu of levels offers: 'finest', 'spacing', and each number with the size of its level.
 * @param {any} dataset @returns {[string, string][]} values and texts; none if the dataset has no levels
 */
export function levelMenu(dataset) {
  /** @type {any[]} */
  const levels = dataset?.levels ?? [];
  return levels.length === 0 ? [] : [['finest', 'finest (exact)'], ['spacing', 'by spacing'],
    ...levels.map(({ level, geometry }) => {
      const { x, y, z } = geometry?.sampleDims ?? {};
      return /** @type {[string, string]} */ ([String(level), `level ${level}${x ? `: ${x} × ${y} × ${z}` : ''}`]);
    })];
}

/**
 * The entry of the menu that a state has; level 0 is the finest.
 * @param {LevelChoice | undefined} choice
 */
export const levelKey = (choice) => choice?.maxSpacingPx ? 'spacing' : choice?.level ? String(choice.level) : 'finest';

/**
 * What an entry of the menu chooses.
 * @param {string} key @param {number} spacingPx of "by spacing" @returns {LevelChoice | undefined}
 */
export const levelOfKey = (key, spacingPx) => key === 'finest' ? undefined : key === 'spacing' ? { maxSpacingPx: spacingPx }
  : { level: Number(key) };

/**
 * What a level hides, for people; '' if nothing is known to be hidden.
 * @param {any} statistics of a picture
 */
export function unresolvedText(statistics) {
  const count = Number(statistics?.unresolvedBlockCount ?? 0);
  return count === 0 ? '' : count === 1 ? '1 block of the surface is not resolved at this level.'
    : `${count.toLocaleString('en')} blocks of the surface are not resolved at this level.`;
}
