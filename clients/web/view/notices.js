// Sentences over the picture, and for screen readers.
// @ts-check

/** Screen readers get at most one sentence in this time. */
const SPEECH_MS = 2000;

/**
 * Passes sentences to a screen reader, one at a time. Of those that come within SPEECH_MS of the
 * last one, the newest is spoken after that time.
 */
export class Announcer {
  /**
   * @param {(sentence: string) => void} write @param {(action: () => void, ms: number) => void} [later]
   */
  constructor(write, later = (action, ms) => { setTimeout(action, ms); }) {
    this.write = write;
    this.later = later;
    this.isResting = false;
    /** @type {string | null} */
    this.next = null;
  }

  /** @param {string} sentence */
  say(sentence) {
    if (this.isResting) {
      this.next = sentence;
      return;
    }
    this.isResting = true;
    this.write(sentence);
    this.later(() => {
      this.isResting = false;
      const { next } = this;
      this.next = null;
      if (next !== null) {
        this.say(next);
      }
    }, SPEECH_MS);
  }
}

const DRAWING = 'Drawing the picture …';

/** The one sentence over the picture: a problem, or the thing that is waited for. */
export class Notices {
  #element;
  #changed;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;

  /**
   * @param {HTMLElement} element @param {(sentence: string) => void} announce takes words for screen readers
   * @param {(detail: {sentence: string, isError: boolean}) => void} changed
   */
  constructor(element, announce, changed) {
    this.#element = element;
    this.announce = announce;
    this.#changed = changed;
  }

  /** The sentence; '' if there is none. */
  get text() {
    return this.#element.hidden ? '' : this.#element.textContent ?? '';
  }

  /** @param {string} sentence '' removes it @param {'' | 'busy' | 'error'} kind */
  show(sentence, kind) {
    if (sentence === '' && this.#element.hidden) {
      return;
    }
    this.#element.textContent = sentence;
    this.#element.className = `notice ${kind}`;
    this.#element.hidden = sentence === '';
    this.#changed({ sentence, isError: kind === 'error' });
  }

  clear() {
    this.show('', '');
  }

  /**
   * Shows a problem, and announces it unless it is shown already.
   * @param {string} sentence
   */
  problem(sentence) {
    if (this.text !== sentence) {
      this.announce(sentence);
    }
    this.show(sentence, 'error');
  }

  /**
   * A frame is there: what was waited for is the exact one, and a wait that is told of lasts until then.
   * @param {boolean} isExact
   */
  framed(isExact) {
    if (!isExact && !this.#element.hidden && this.#element.classList.contains('busy')) {
      this.show(DRAWING, 'busy');
    } else {
      this.clear();
    }
  }

  /** Tells after a second that a picture is awaited, and after ten that none comes; until `endWaiting`. */
  beginWaiting() {
    this.endWaiting();
    this.#timer = setTimeout(() => {
      if (this.#element.hidden) {
        this.show(DRAWING, 'busy');
      }
      this.#timer = setTimeout(() => {
        const sentence = 'No picture for 10 s. The first one of a large dataset can take long; if none comes, see the ' +
          'log of isoscope-coordinator.';
        this.show(sentence, 'busy');
        this.announce(sentence);
      }, 9000);
    }, 1000);
  }

  endWaiting() {
    clearTimeout(this.#timer);
  }
}
