// The keys of a view.
// @ts-check

import { basisOf, spanAt } from './camera.js';
import { pan, turn } from './moves.js';
import { PATIENT_VIEWS, WORLD_VIEWS } from './named-views.js';

/** An arrow key turns by 5 degrees, in the quarter turns that `turn` takes; with Shift it moves the scene by this. */
const TURN_STEP = 5 / 90;
const PAN_STEP = 0.1;
/** @type {Record<string, [number, number]>} */
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/**
 * Acts on a key of a view.
 * @param {KeyboardEvent} event @param {import('./steering.js').Steering} steering @param {import('./view.js').View} view
 */
export function pressKey(event, steering, view) {
  const { camera } = steering;
  if (!camera || event.altKey || event.ctrlKey || event.metaKey) {
    return;
  }
  const { key } = event;
  const arrow = ARROWS[key];
  /** @param {import('./types.js').Camera} moved */
  const move = (moved) => steering.move(moved, event.timeStamp);
  if (arrow && event.shiftKey) {
    move(pan(camera, arrow[0] * PAN_STEP, arrow[1] * PAN_STEP, basisOf(camera).distance));
  } else if (arrow) {
    move(turn(camera, arrow[0] * TURN_STEP, arrow[1] * TURN_STEP));
  } else if (key === ',' || key === '.') {
    move(turn(camera, 0, 0, (key === ',' ? 5 : -5) * Math.PI / 180));
  } else if (key === '+' || key === '=' || key === '-') {
    move(steering.zoomed(camera, key === '-' ? 1 / 1.15 : 1.15, camera.target));
  } else if (key === '0') {
    view.fit();
  } else if (key === 'Home') {
    view.reset();
  } else if (key >= '1' && key <= '6') {
    view.lookFrom((view.dataset?.patientFrame ? PATIENT_VIEWS : WORLD_VIEWS)[Number(key) - 1]);
  } else if (key === 'p') {
    const { distance } = basisOf(camera);
    move({ ...camera, height: camera.height > 0 ? 0 : 2 * spanAt({ ...camera, height: 0 }, distance) });
  } else if (key === 'b') {
    view.decorate({ box: !view.decorations.box });
  } else if (key === 'Enter' && !event.repeat) {
    steering.click(0.5, 0.5);
  } else {
    return;
  }
  event.preventDefault();
}
