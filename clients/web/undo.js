// Undo and redo: states of the view, each of them a whole one.
//
// A drag, a slider or a play changes the state many times. It becomes one entry once it rests: `rested` is called when
// nothing is held and no change has come for a while.
// @ts-check

/** @template T @typedef {{key: string, state: T}} Entry */

/** The oldest entries are forgotten. */
const MAX_ENTRIES = 100;

/** @template T */
export class Undo {
  /** @type {Entry<T>[]} */
  #entries = [];
  /** The entry that is shown. */
  #at = -1;

  /** @param {(state: T) => string} keyOf equal for states that look the same */
  constructor(keyOf) {
    this.keyOf = keyOf;
  }

  get canUndo() {
    return this.#at > 0;
  }

  get canRedo() {
    return this.#at < this.#entries.length - 1;
  }

  /**
   * @param {T} state @returns {boolean} whether it looks as the entry that is shown
   */
  isAt(state) {
    return this.#entries[this.#at]?.key === this.keyOf(state);
  }

  /**
   * Keeps a state, unless it is the one that is shown. What was undone before is forgotten.
   * @param {T} state not to be changed later @returns {boolean} whether it is kept
   */
  rested(state) {
    if (this.isAt(state)) {
      return false;
    }
    this.#entries.splice(this.#at + 1, Infinity, { key: this.keyOf(state), state });
    this.#entries.splice(0, Math.max(0, this.#entries.length - MAX_ENTRIES));
    this.#at = this.#entries.length - 1;
    return true;
  }

  /** @returns {T | null} the state before, to be shown; null: there is none */
  undo() {
    return this.canUndo ? this.#entries[this.#at -= 1].state : null;
  }

  /** @returns {T | null} the state that was undone last; null: there is none */
  redo() {
    return this.canRedo ? this.#entries[this.#at += 1].state : null;
  }
}
