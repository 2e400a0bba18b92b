// The figures of picked points, in the panel and as a table.
import assert from 'node:assert/strict';
import { test } from 'node:test';

import { csvOf, figuresOf } from '../../../clients/web/point-figures.js';

const HEAD = { name: 'head', patientFrame: 'LPS' };
const FLOW = { name: 'flow', lengthUnit: 'm', fields: [{ name: 'pressure', unit: 'Pa', components: [{}] }, { name: 'v', unit: 'm/s', components: [{ name: 'x' }] }] };
/** @param {any} point @param {any} [rest] */
const pick = (point, rest) => ({ position: [0.1 + 0.2, -2, 1e-7], isovalue: 60, point, selection: undefined, of: '', ...rest });
/** @param {number[]} position */
const texts = (position) => position.map((value) => value.toFixed(1));
const rowsOf = (/** @type {any} */ one, /** @type {any} */ dataset) => figuresOf(one, dataset, texts).map(({ name, text }) => [name, text]);

test('figures have the names of axes and units, and no numbers of blocks', () => {
  assert.deepEqual(rowsOf(pick({ gradient: { x: 3, y: 4 }, normal: { z: 1 }, blockId: '7', shardIndex: 1 }), HEAD),
    [['L, P, S', '0.3, -2.0, 0.0 mm'], ['value', '60'], ['normal', '0.000, 0.000, 1.000'], ['gradient', '5 1/mm']]);
  assert.deepEqual(rowsOf(pick({ gradient: { x: 3, y: 4 }, fieldValues: [{ field: 'v', component: 'x', unit: 'm/s', value: 2 }] }), FLOW),
    [['x, y, z', '0.3, -2.0, 0.0 m'], ['value', '60 Pa'], ['v x', '2 m/s'], ['gradient', '5 Pa/m']]);
  assert.deepEqual(rowsOf(pick({ label: 3, labelName: 'heart' }), { name: 'plain' }), [['x, y, z', '0.3, -2.0, 0.0'], ['label', 'heart (3)']]);
});

test('a table has a column for each figure of any point, with every digit', () => {
  const csv = csvOf([pick({ normal: { x: -1 } }), pick({ label: 3, labelName: 'heart' })], HEAD);
  assert.equal(csv, 'point,L (mm),P (mm),S (mm),value,normal L,normal P,normal S,label,label name\r\n' +
    'A,0.30000000000000004,-2,1e-7,60,-1,0,0,,\r\n' +
    'B,0.30000000000000004,-2,1e-7,,,,,3,heart\r\n');
  assert.match(csvOf([pick({ gradient: { x: 3, y: 4 }, fieldValues: [{ field: 'v', component: 'x', unit: 'm/s', value: 'NaN' }] })], FLOW),
    /^point,x \(m\),y \(m\),z \(m\),value \(Pa\),v x \(m\/s\),gradient \(Pa\/m\)\r\nA,.*,60,NaN,5\r\n$/);
});

test('names of a file are text in a spreadsheet', () => {
  const cells = (/** @type {string} */ labelName) => csvOf([pick({ label: 1, labelName })], {}).split('\r\n')[1].split(',').slice(5).join(',');
  assert.equal(cells('left, "old"'), '"left, ""old"""');
  assert.equal(cells('=HYPERLINK("http://x")'), '"\'=HYPERLINK(""http://x"")"');
  assert.equal(cells('@x'), '\'@x');
});
