// Numbers and colours as the page writes them.
import assert from 'node:assert/strict';
import { test } from 'node:test';

import { PALETTE, fromHex, isSameRange, nextColor, paintedApart, rangesOfChart, tidy, tidyRange, toHex, unitedRange, whyBeyond } from '../../../clients/web/values.js';

test('suggested values have the digits that their range can tell apart, and no more', () => {
  for (const [value, span, text] of [[30.000000000004, 100, '30'], [87.49999999, 255, '87.5'], [127.4, 4095, '127'], [0.123456, 1, '0.123'],
    [-0.30000000000000004, 2, '-0.3'], [1.23456e-7, 1e-6, '1.23e-7'], [123456789, 1e9, '123000000'], [1e300, 3e300, '1e+300'],
    [0, 10, '0'], [3.14159, 0, '3.142']]) {
    assert.equal(String(tidy(value, span)), text, `${value} of ${span}`);
  }
});

test('a range of few digits has all of the other one within', () => {
  for (const [min, max] of [[0, 255], [-1024.37, 3071.9], [1.00004, 2.00003], [-7e-9, 2e-9], [273.15, 301.77], [-2, -1]]) {
    const range = tidyRange({ min, max });
    assert.ok(range.min <= min && range.max >= max, `${min} to ${max}: ${JSON.stringify(range)}`);
    assert.ok(range.max - range.min <= (max - min) * 1.003);
    assert.ok(String(range.min).replace(/e.*|[-.]/g, '').length <= 8 && String(range.max).replace(/e.*|[-.]/g, '').length <= 8);
  }
  assert.deepEqual(tidyRange({ min: 3, max: 3 }), { min: 3, max: 3 });
});

test('ranges are united, and told apart beyond errors of rounding', () => {
  assert.deepEqual(unitedRange([{ min: 1, max: 2 }, { min: -1, max: 1.5 }]), { min: -1, max: 2 });
  assert.equal(unitedRange([]), null);
  assert.ok(isSameRange({ min: 0, max: 203.20000000000002 }, { min: 0, max: 203.2 }));
  assert.ok(!isSameRange({ min: 0, max: 203.2 }, { min: 0, max: 203.1 }) && !isSameRange({ min: 1e-3, max: 1 }, { min: 0, max: 1 }));
  assert.ok(!isSameRange(undefined, { min: 0, max: 1 }));
});

test('the axis of a histogram ends with the values, not with the edge of the last bin', () => {
  const bins = [{ max: 1 }, { min: 1, max: 254 }, { min: 254, max: 255 }];
  assert.deepEqual(rangesOfChart(bins, { max: 254 }), { values: { min: 0, max: 254 }, edges: { min: 0, max: 255 } });
  // A field has no bins here, and one value alone a chart about it.
  assert.deepEqual(rangesOfChart([], { min: -2, max: 50 }), { values: { min: -2, max: 50 }, edges: { min: -2, max: 50 } });
  assert.deepEqual(rangesOfChart([], { min: 3, max: 3 }), { values: { min: 3, max: 3 }, edges: { min: 2.5, max: 3.5 } });
  assert.deepEqual(rangesOfChart(bins, { min: '-Infinity', max: 'Infinity' }).values, { min: 0, max: 255 });
  assert.deepEqual(rangesOfChart([], undefined), { values: { min: 0, max: 1 }, edges: { min: 0, max: 1 } });
});

test('surfaces take the colours of the row in turn, each once', () => {
  assert.equal(new Set(PALETTE).size, 8);
  const used = [];
  for (let i = 0; i < 8; ++i) {
    used.push(nextColor(used));
  }
  assert.deepEqual(used, PALETTE);
  assert.ok(PALETTE.includes(nextColor(used)));
});

test('surfaces without a colour are told apart; the first one and those with a colour keep theirs', () => {
  const red = { red: 1, green: 0, blue: 0, alpha: 1 };
  const alone = [{ isovalue: 1 }];
  assert.deepEqual(paintedApart(alone), alone);
  const painted = paintedApart([{ isovalue: 1 }, { isovalue: 2, color: red }, { isovalue: 3 }, { labels: [4], color: red }]);
  assert.deepEqual([painted[0], painted[1], painted[3]], [{ isovalue: 1 }, { isovalue: 2, color: red }, { labels: [4], color: red }]);
  assert.equal(toHex(painted[2].color), PALETTE[1]);
  // One that has the first colour of the row already.
  assert.equal(toHex(paintedApart([{ isovalue: 1, color: fromHex(PALETTE[0]) }, { isovalue: 2 }])[1].color), PALETTE[1]);
});

test('an isovalue without a surface is seen by the range of all samples, of which infinite ones have surfaces, too', () => {
  const beyond = 'Isovalue 400 has no surface: the samples are from 0 to 100 HU.';
  assert.equal(whyBeyond(400, { max: 100 }, 'HU'), beyond);
  assert.match(whyBeyond(0, { max: 100 }), /^Isovalue 0 has no surface/, 'all samples are inside');
  for (const [isovalue, range] of [[100, { max: 100 }], [0.1, { max: 100 }], [400, { max: 'Infinity' }], [-400, { min: '-Infinity', max: 1 }], [5, undefined]]) {
    assert.equal(whyBeyond(isovalue, range), '', `${isovalue} of ${JSON.stringify(range)}`);
  }
});
