// Panels over the picture that people move: by a drag of their handle, or by its arrow keys.
// @ts-check

/** An arrow key moves a panel so far, in CSS pixels. */
const STEP_PX = 16;
/** @type {Record<string, [number, number]>} */
const STEPS_OF_ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/**
 * Keeps a panel within what surrounds it.
 * @param {HTMLElement} panel @param {number} left @param {number} top
 */
function place(panel, left, top) {
  const { clientWidth = 0, clientHeight = 0 } = panel.offsetParent ?? {};
  panel.style.left = `${Math.max(0, Math.min(left, clientWidth - panel.offsetWidth))}px`;
  panel.style.top = `${Math.max(0, Math.min(top, clientHeight - panel.offsetHeight))}px`;
}

/** @param {HTMLElement} panel with a place of its own @param {HTMLElement} handle in it, which takes the focus */
export function makeMovable(panel, handle) {
  /** @type {{x: number, y: number} | null} from the pointer to the corner of the panel */
  let grip = null;
  handle.addEventListener('pointerdown', (event) => {
    if (/** @type {Element} */ (event.target).closest('button') === null) {
      grip = { x: panel.offsetLeft - event.clientX, y: panel.offsetTop - event.clientY };
      handle.setPointerCapture(event.pointerId);
    }
  });
  handle.addEventListener('pointermove', (event) => grip && place(panel, event.clientX + grip.x, event.clientY + grip.y));
  const end = () => { grip = null; };
  handle.addEventListener('pointerup', end);
  handle.addEventListener('pointercancel', end);
  handle.addEventListener('keydown', (event) => {
    const arrow = event.target === handle ? STEPS_OF_ARROWS[event.key] : undefined;
    if (arrow) {
      event.preventDefault();
      place(panel, panel.offsetLeft + STEP_PX * arrow[0], panel.offsetTop + STEP_PX * arrow[1]);
    }
  });
  window.addEventListener('resize', () => panel.style.left && !panel.hidden && place(panel, panel.offsetLeft, panel.offsetTop));
}
