// When a page works: in animation frames, and while its tab is shown. A hidden tab asks for nothing.
// @ts-check

/** @param {() => void} changed called when the tab is hidden or shown @returns {() => void} ends that */
export function watchTab(changed) {
  document.addEventListener('visibilitychange', changed);
  return () => document.removeEventListener('visibilitychange', changed);
}

/** Waits until the tab is shown. A hidden tab asks for nothing. @returns {Promise<void>} */
export async function untilShown() {
  if (globalThis.document?.hidden) {
    await new Promise((resolve) => {
      const stop = watchTab(() => {
        if (!document.hidden) {
          stop();
          resolve(undefined);
        }
      });
    });
  }
}

/**
 * Calls `ask` every `ms` while the tab is shown, and at once when it is shown again.
 * @param {() => void} ask @param {number} ms @returns {() => void} ends it
 */
export function whileShown(ask, ms) {
  let timer = document.hidden ? undefined : setInterval(ask, ms);
  const stop = watchTab(() => {
    clearInterval(timer);
    timer = undefined;
    if (!document.hidden) {
      ask();
      timer = setInterval(ask, ms);
    }
  });
  return () => {
    clearInterval(timer);
    stop();
  };
}

/** Draws in the next animation frame that is asked for, and once the tab is hidden or shown. */
export class AnimationLoop {
  isEnded = false;
  #draw;
  #request = 0;
  #unwatch = watchTab(() => this.schedule());

  /** @param {() => void} draw */
  constructor(draw) {
    this.#draw = draw;
  }

  schedule() {
    if (!this.#request && !this.isEnded) {
      this.#request = requestAnimationFrame(() => {
        this.#request = 0;
        this.#draw();
      });
    }
  }

  end() {
    this.isEnded = true;
    cancelAnimationFrame(this.#request);
    this.#unwatch();
  }
}
