// Undo and redo: which states are kept, and which come back.
import assert from 'node:assert/strict';
import { test } from 'node:test';

import { Undo } from '../../../clients/web/undo.js';

/** @param {number[]} states */
function kept(states) {
  const undo = new Undo(String);
  states.forEach((state) => undo.rested(state));
  return undo;
}

test('states come back in turn, and forward again', () => {
  const undo = kept([1, 2, 3]);
  assert.deepEqual([undo.undo(), undo.undo(), undo.undo()], [2, 1, null]);
  assert.deepEqual([undo.canUndo, undo.canRedo], [false, true]);
  assert.deepEqual([undo.redo(), undo.redo(), undo.redo()], [2, 3, null]);
  assert.deepEqual([undo.canUndo, undo.canRedo], [true, false]);
});

test('a state that looks like the one that is shown is no entry, so that an undo that rests keeps the way forward', () => {
  const undo = kept([1, 2, 2]);
  assert.equal(undo.undo(), 1);
  assert.deepEqual([undo.isAt(1), undo.isAt(2)], [true, false]);
  assert.equal(undo.rested(1), false);
  assert.equal(undo.redo(), 2);
});

test('a change after an undo forgets what was undone', () => {
  const undo = kept([1, 2, 3]);
  undo.undo();
  assert.equal(undo.rested(4), true);
  assert.equal(undo.canRedo, false);
  assert.deepEqual([undo.undo(), undo.undo()], [2, 1]);
});

test('the oldest of more than a hundred entries are forgotten', () => {
  const undo = kept(Array.from({ length: 250 }, (_, i) => i));
  let last = 249;
  for (let state = undo.undo(); state !== null; state = undo.undo()) {
    assert.equal(state, last - 1);
    last = state;
  }
  assert.equal(last, 150);
});
