// Fields and time steps: what a selection means, and how steps are played.
import assert from 'node:assert/strict';
import { test } from 'node:test';

import {
  Player, choiceOf, choicesOf, hasAllFields, histogramWords, indexOfStep, rangeOfBins, stepsOf, legendOf, titleOfColoring, valuesOf, withoutFields,
} from '../../../clients/web/series.js';

// As the gateway writes it: what is 0 or empty is left out.
const FLOW = {
  name: 'flow', timeUnit: 's',
  timeSteps: [{}, { value: 0.5, number: 2 }, { value: 0.75, number: 3 }],
  fields: [
    { name: 'pressure', longName: 'Static pressure', unit: 'Pa', components: [{ valueRange: { max: 9 } }], timeSteps: [0, 1, 2] },
    { name: 'velocity', unit: 'm/s', components: [{ name: 'x' }, { name: 'y' }, { name: 'magnitude' }], timeSteps: [0, 1] }],
};
const PLAIN = { name: 'head', valueRange: { max: 255 } };

test('the menu has each component of each field, with its unit', () => {
  assert.deepEqual(choicesOf(FLOW).map(({ word, label }) => [word, label]), [['pressure', 'Static pressure (Pa)'],
    ['velocity:x', 'velocity x (m/s)'], ['velocity:y', 'velocity y (m/s)'], ['velocity:magnitude', 'velocity magnitude (m/s)']]);
  assert.deepEqual(choicesOf(PLAIN), []);
  assert.deepEqual(choicesOf(null), []);
});

test('the range of a step is that of the bins with samples, within that of all steps', () => {
  const bins = [{ min: -2, max: -1 }, { min: -1, sampleCount: '3' }, { max: 1 }, { min: 1, max: 2, sampleCount: '1' }, { min: 2, max: 3, sampleCount: '0' }];
  assert.deepEqual(rangeOfBins({ bins, hasSampleCounts: true }, null), { min: -1, max: 2 });
  assert.deepEqual(rangeOfBins({ bins, hasSampleCounts: true }, { min: -0.5, max: 1.5 }), { min: -0.5, max: 1.5 });
  assert.equal(rangeOfBins({ bins }, null), null);
  assert.equal(rangeOfBins({ hasSampleCounts: true }, null), null);
});

test('what a selection leaves open is the first field and the magnitude', () => {
  for (const [selection, word] of [[undefined, 'pressure'], [{ timeStep: 1 }, 'pressure'], [{ field: 'velocity' }, 'velocity:magnitude'],
    [{ field: 'velocity', component: 'y' }, 'velocity:y'], [{ field: 'velocity', component: 'w' }, undefined], [{ field: 'hue' }, undefined]]) {
    assert.equal(choiceOf(FLOW, selection)?.word, word);
  }
  assert.equal(choiceOf(PLAIN, { field: 'velocity' }), null);
});

test('a step is the one of its number, the nearest to a time, or the last that is served of the field', () => {
  const steps = stepsOf(FLOW, FLOW.fields[0]);
  assert.deepEqual(steps, [{ number: 0, value: 0 }, { number: 2, value: 0.5 }, { number: 3, value: 0.75 }]);
  assert.equal(stepsOf(FLOW, FLOW.fields[1]).length, 2);
  for (const [selection, at] of [[undefined, 2], [{}, 2], [{ timeStep: -1 }, 2], [{ timeStep: 0 }, 0], [{ timeStep: 1 }, -1], [{ timeStep: 2 }, 1],
    [{ time: -5 }, 0], [{ time: 0.25 }, 0], [{ time: 0.26 }, 1], [{ time: 99 }, 2]]) {
    assert.equal(indexOfStep(steps, selection), at, JSON.stringify(selection));
  }
  assert.equal(indexOfStep([], undefined), -1);
  assert.equal(indexOfStep([], { time: 1 }), -1);
});

test('a histogram is of what is shown', () => {
  assert.equal(histogramWords(FLOW, undefined), '&field=pressure&step=3');
  assert.equal(histogramWords(FLOW, { field: 'velocity', time: 0 }), '&field=velocity&component=magnitude&step=0');
  assert.equal(histogramWords(PLAIN, undefined), '');
});

test('a picked point has the values of all fields, where all are served', () => {
  for (const [dataset, selection, expected] of [[FLOW, undefined, false], [FLOW, { timeStep: 2 }, true], [FLOW, { timeStep: 1 }, false],
    [FLOW, { field: 'velocity' }, true], [FLOW, { time: 0.1 }, true], [FLOW, { field: 'hue' }, false], [PLAIN, undefined, false],
    [{ ...FLOW, timeSteps: [], fields: FLOW.fields.map(({ timeSteps, ...rest }) => rest) }, undefined, true], [null, undefined, false]]) {
    assert.equal(hasAllFields(dataset, selection), expected, JSON.stringify(selection));
  }
  const point = { fieldValues: [{ field: 'pressure', unit: 'Pa', value: 1.5 }, { field: 'velocity', component: 'x', unit: 'm/s' },
    { field: 'velocity', component: 'y', value: 'NaN' }, { field: 'heat', value: '-Infinity' }] };
  assert.deepEqual(valuesOf(point, FLOW, String).map(({ name, text }) => [name, text]), [['Static pressure', '1.5 Pa'],
    ['velocity x', '0 m/s'], ['velocity y', 'no value'], ['heat', '-Infinity']]);
  assert.deepEqual(valuesOf({}, FLOW, String), []);
});

test('the legend has the name and the unit of a field', () => {
  assert.equal(titleOfColoring({ quantity: 'QUANTITY_FIELD', field: 'velocity', component: 'x' }, FLOW), 'velocity x (m/s)');
  assert.equal(titleOfColoring({ quantity: 'QUANTITY_FIELD', field: 'hue' }, FLOW), 'hue');
  assert.equal(titleOfColoring({ quantity: 'QUANTITY_POSITION_Z' }, FLOW), 'position z');
  assert.equal(titleOfColoring({ quantity: 'QUANTITY_POSITION_Z' }, { patientFrame: 'LPS' }), 'position S');
  assert.equal(titleOfColoring({ quantity: 'QUANTITY_GRADIENT_MAGNITUDE' }, PLAIN), 'gradient');
});

test('the legend has a bar for each map, once, and for cuts that show samples', () => {
  const range = { min: 1, max: 2 };
  const nanColor = { red: 128 / 255, green: 128 / 255, blue: 128 / 255, alpha: 1 };
  const byField = { quantity: 'QUANTITY_FIELD', field: 'pressure', colorMap: 'COLOR_MAP_TURBO', range };
  assert.deepEqual(legendOf({}, FLOW), []);
  assert.deepEqual(legendOf(null, FLOW), []);
  assert.deepEqual(legendOf({ colorings: [{ colorBy: { quantity: 'QUANTITY_NORMAL' } }] }, FLOW), []);
  const bar = { title: 'Static pressure (Pa)', colorMap: 'COLOR_MAP_TURBO', range };
  assert.deepEqual(legendOf({ colorings: [{ colorBy: byField, nanColor }, { surfaceIndex: 1, colorBy: byField, nanColor }] }, FLOW),
    [{ ...bar, nan: '' }]);
  // A swatch, if one of the surfaces shows missing values.
  for (const shows of [[true, false], [false, true]]) {
    assert.deepEqual(legendOf({ colorings: shows.map((showsNan) => ({ colorBy: byField, nanColor, showsNan })) }, FLOW),
      [{ ...bar, nan: '#808080' }]);
  }
  const byHeight = { quantity: 'QUANTITY_POSITION_Z', range };
  const capsColoring = { caps: { colorMap: 'COLOR_MAP_GREY', range }, nanColor, showsNan: true };
  assert.deepEqual(legendOf({ colorings: [{ colorBy: byHeight }], capsColoring, selection: { field: 'pressure' } }, FLOW),
    [{ title: 'position z', colorMap: undefined, range, nan: '' },
      { title: 'Static pressure (Pa) on cuts', colorMap: 'COLOR_MAP_GREY', range, nan: '#808080' }]);
  assert.equal(legendOf({ capsColoring }, PLAIN)[0].title, 'samples on cuts');
});

test('a link with fields opens a dataset without them, and says what is left out', () => {
  const state = () => ({ selection: { field: 'pressure' }, surfaces: [{ isovalue: 1, colorBy: { quantity: 'QUANTITY_FIELD', field: 'heat' } },
    { isovalue: 2, colorBy: { quantity: 'QUANTITY_NORMAL' } }] });
  const plain = state();
  const problems = withoutFields(plain, PLAIN);
  assert.deepEqual(plain, { surfaces: [{ isovalue: 1 }, { isovalue: 2, colorBy: { quantity: 'QUANTITY_NORMAL' } }] });
  assert.equal(problems.length, 2);
  assert.match(problems[1], /color-by=heat/);
  const flow = state();
  assert.deepEqual(withoutFields(flow, FLOW), []);
  assert.deepEqual(flow, state());
});

/** A player of three steps with a clock that stands. */
function playerOf(steps) {
  const log = [];
  const later = [];
  const clock = { now: 0 };
  const player = new Player({ next: () => steps.shift() ?? null, stopped: () => log.push('stopped') },
    (action, ms) => { log.push(ms); later.push(action); }, () => clock.now);
  return { player, log, later, clock };
}

test('the next step comes when the last one is on the screen, at most ten times a second', () => {
  const { player, log, later, clock } = playerOf([4, 5, 6]);
  player.start();
  assert.equal(player.awaited, 4);
  player.shown(3);
  assert.deepEqual(log, [], 'a frame of before starts nothing');
  clock.now = 30;
  player.shown(4);
  player.shown(4);
  assert.deepEqual(log, [70], 'the exact frame of a step counts once');
  later.shift()();
  assert.equal(player.awaited, 5);
  clock.now += 5000;
  player.shown(5);
  assert.equal(log.at(-1), 0, 'a slow step is followed at once');
  later.shift()();
  player.shown(6);
  later.shift()();
  assert.equal(log.at(-1), 'stopped');
  assert.equal(player.isPlaying, false);
});

test('a stop ends the step that would come', () => {
  const { player, log, later } = playerOf([4, 5, 6, 7]);
  player.start();
  player.shown(4);
  player.stop();
  player.stop();
  assert.deepEqual(log, [100, 'stopped']);
  player.start();
  assert.equal(player.awaited, 5);
  later.shift()();
  assert.equal(player.awaited, 5, 'the timer of the run before does nothing');
});
