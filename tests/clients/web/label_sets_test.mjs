// Surfaces of labels in a state: text, colours, names, and which labels are shown.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';

import { stateToCommand } from '../../../clients/web/commands.js';
import {
  LABEL_COLORS, allLabels, areSmooth, asShown, colorOfLabel, foundLabels, inOrder, indexOfLabel, indexWithLabel, isNothing, nameOfLabels,
  nothingOf, onlyLabel, textOfValues, valuesOfText, withColors, withHighlight, withLabels, withSmooth,
} from '../../../clients/web/label-sets.js';
import { stateFromHash, stateToHash, stateToLink, withMaterialOf } from '../../../clients/web/view-state.js';

// As the gateway writes it: what is 0 or empty is left out.
const BODY = { name: 'body', labels: [{ name: 'air' }, { value: 1, name: 'Left lung', color: { red: 1, blue: 0.2 } },
  { value: 2, name: 'left lung' }, { value: 3, name: 'liver, old' }, { value: 17.5 }] };
const RANGE = { min: -3.5, max: 17.5 };

test('sets are written as the command line takes them, and read again', () => {
  for (const [text, values] of Object.entries({ '3': [3], '3,4': [3, 4], '3-5': [3, 4, 5], '-2,-1,0-2,7,9.5': [-2, -1, 0, 1, 2, 7, 9.5],
    '1e+21': [1e21] })) {
    assert.equal(textOfValues(values), text);
    assert.deepEqual(valuesOfText(text, []), values);
  }
  assert.deepEqual(valuesOfText(' 7 , 3-5,4,-0', []), [0, 3, 4, 5, 7]);
  for (const text of ['', ',', '3,', 'lung', '5-3', '0-256', '1.5-3', 'NaN', 'Infinity', [...Array(257).keys()].join()]) {
    assert.equal(valuesOfText(text, []), null, text.slice(0, 20));
  }
  assert.equal(valuesOfText('0-255', []).length, 256);
});

test('names stand for values: the whole text first, and upper and lower case only where two names differ', () => {
  assert.deepEqual(valuesOfText('liver, old', BODY.labels), [3]);
  assert.deepEqual(valuesOfText('left lung', BODY.labels), [2]);
  assert.deepEqual(valuesOfText('AIR,Left lung,7', BODY.labels), [0, 1, 7]);
  assert.equal(valuesOfText('LEFT LUNG', BODY.labels), null);
  assert.equal(valuesOfText('spleen', BODY.labels), null);
  assert.equal(nameOfLabels(BODY, [1]), 'Left lung');
  assert.equal(nameOfLabels(BODY, [17.5, 2, 99]), 'label 17.5, left lung, 99');
});

test('a label has the colour of the dataset, else one of sixteen by its value', () => {
  assert.deepEqual(colorOfLabel(BODY, 1, 0.5), { red: 1, green: 0, blue: 0.2, alpha: 0.5 });
  assert.deepEqual(colorOfLabel(BODY, 17.5), { red: 0.164705882, green: 0.537254902, blue: 0.88627451, alpha: 1 });
  assert.deepEqual(colorOfLabel(null, -1), colorOfLabel(null, 15));
  const table = readFileSync(new URL('../../../docs/labels.md', import.meta.url), 'utf8');
  LABEL_COLORS.forEach((color, i) => assert.match(table, new RegExp(`\\| ${i} \`${color}\``)));
});

test('a label is shown and hidden, and a picture of none has a surface that is nowhere', () => {
  const nothing = asShown([], RANGE);
  assert.deepEqual(nothing.map(({ labels }) => labels), [[-5]]);
  assert.ok(isNothing(nothing[0], RANGE));
  const one = withLabels(nothing, [2], BODY, RANGE);
  assert.deepEqual(one, [{ labels: [2], color: colorOfLabel(BODY, 2) }]);
  const three = withLabels([...one, { isovalue: 60 }], [1, 3], BODY, RANGE);
  assert.deepEqual(three.map(({ isovalue, labels }) => isovalue ?? labels), [60, [2], [1, 3]]);
  assert.equal(indexOfLabel(three, 2), 1);
  assert.equal(indexOfLabel(three, 1), -1);
  assert.deepEqual(asShown([{ isovalue: 60 }, nothingOf(RANGE)], RANGE), [{ isovalue: 60 }]);
  assert.deepEqual(allLabels(BODY).map(({ labels }) => labels[0]), [1, 2, 3, 17.5]);
  assert.deepEqual(inOrder([{ labels: [1] }, { isovalue: 1 }, { labels: [0] }]), [{ isovalue: 1 }, { labels: [1] }, { labels: [0] }]);
});

test('surfaces of labels come back from their link, behind those of isovalues', () => {
  const state = { surfaces: [{ isovalue: 60 }, { labels: [3, 4, 5, 9], color: { red: 1, green: 0.25, blue: 0, alpha: 0.4 },
    colorBy: { quantity: 'QUANTITY_NORMAL' } }, { labels: [0], color: { red: 0, green: 0, blue: 0, alpha: 1 } }] };
  const hash = 'surface=60&label=3-5,9:1,0.25,0:0.4&label=0:0,0,0&color-by=none&color-by=normal&color-by=none';
  assert.equal(stateToHash(state), hash);
  assert.deepEqual(stateFromHash(hash), { state, problems: [] });
  const mixed = stateFromHash('#label=7&isovalue=60&color=red&label=1:teal').state;
  assert.deepEqual(mixed.surfaces.map(({ isovalue, labels, color }) => [isovalue ?? labels, color?.red]), [[60, 1], [[7], undefined], [[1], 0]]);
  assert.equal(stateToHash({ surfaces: [state.surfaces[1], state.surfaces[0]] }),
    'surface=60&label=3-5,9:1,0.25,0:0.4&color-by=none&color-by=normal');
  assert.match(stateToCommand(state, 'p.png'), /--surface 60 .*--label 3-5,9:1,0.25,0:0.4/s);
});

test('what isoscope view names gets its colour from the dataset, and keeps its opacity', () => {
  const { surfaces } = stateFromHash('label=1&label=17.5::0.5&label=2:1,0,0').state;
  assert.deepEqual(withColors(surfaces, BODY), [{ labels: [1], color: colorOfLabel(BODY, 1) }, { labels: [17.5], color: colorOfLabel(BODY, 17.5, 0.5) },
    { labels: [2], color: { red: 1, green: 0, blue: 0, alpha: 1 } }]);
});

test('a wrong label of a link is left out with a sentence', () => {
  const { state, problems } = stateFromHash('#label=lung&label=3:1,2&label=3::x&label=5-3&label=4');
  assert.deepEqual(state.surfaces, [{ labels: [4] }]);
  assert.equal(problems.length, 4);
  problems.forEach((sentence) => assert.match(sentence, /^label=.+ of this link was left out: .+\.$/));
});

test('a chosen label is found in its surface, shown alone, and highlighted among others', () => {
  const surfaces = [{ isovalue: 60 }, { labels: [3, 4], color: colorOfLabel(BODY, 3) }, { labels: [4], color: colorOfLabel(BODY, 4) }, { labels: [1] }];
  assert.equal(indexWithLabel(surfaces, 4), 2);
  assert.equal(indexWithLabel(surfaces, 3), 1);
  assert.equal(indexWithLabel(surfaces, 60), -1);
  assert.deepEqual(onlyLabel(surfaces, 1), [surfaces[0], surfaces[1]]);
  const lit = withHighlight(surfaces, 3, BODY);
  assert.deepEqual(lit.map(({ color }) => color?.alpha), [undefined, 0.15, 0.15, 1]);
  assert.deepEqual(lit[3].color, colorOfLabel(BODY, 1));
  assert.equal(surfaces[1].color.alpha, 1);
});

test('a link of any number of surfaces opens with as many as a picture may have, and one sentence', () => {
  const words = (count) => Array.from({ length: count }, (_, i) => `label=${i}`).join('&');
  for (const [link, leftOut] of [[words(128), 0], [words(129), 1], [words(20000), 19872], ['labels=1-200', 72], ['labels=1-200&label=3:1,0,0&label=150:1,0,0', 72],
    [`labels=1-127&${words(2)}`, 0], [`isovalue=${Array(128).fill(1).join()}&surface=2`, 1], [Array(300).fill('surface=1').join('&'), 172]]) {
    const { state, problems } = stateFromHash(`#${link}`);
    assert.equal(state.surfaces.length, 128, link.slice(0, 40));
    const sentence = `The last ${leftOut === 1 ? 'surface' : `${leftOut.toLocaleString('en')} surfaces`} of this link ${leftOut === 1 ? 'was' : 'were'} ` +
      'left out: a picture has at most 128.';
    assert.deepEqual(problems, leftOut === 0 ? [] : [sentence]);
  }
  const { state } = stateFromHash('#labels=1-200&label=3:1,0,0');
  assert.deepEqual(state.surfaces[2], { labels: [3], color: { red: 1, green: 0, blue: 0, alpha: 1 } });
});

test('a highlight changes no material, also where only some surfaces have one', () => {
  const material = { diffuse: 0.5 };
  const surfaces = [{ isovalue: 60, color: { red: 1, alpha: 1 }, material }, { labels: [3], color: colorOfLabel(BODY, 3) }, { labels: [1], color: colorOfLabel(BODY, 1), material }];
  const lit = withHighlight(surfaces, 2, BODY);
  // As a change of the page does it: its surfaces are those that were given, so the highlight can end.
  assert.equal(withMaterialOf(lit, surfaces), lit);
  assert.deepEqual(lit.map((one) => one.material), [material, undefined, material]);
  assert.equal(withMaterialOf(surfaces, lit), surfaces);
});

test('labels are found by a part of their name, or by their value', () => {
  assert.deepEqual(foundLabels(BODY.labels, ' LUNG ').map(({ value }) => value), [1, 2]);
  assert.deepEqual(foundLabels(BODY.labels, '17.5').map(({ value }) => value), [17.5]);
  assert.deepEqual(foundLabels(BODY.labels, 'label 17').map(({ value }) => value), [17.5]);
  assert.deepEqual(foundLabels(BODY.labels, 'spleen'), []);
  assert.equal(foundLabels(BODY.labels, ''), BODY.labels);
});

test('surfaces of labels are smooth together, and so they are in a link', () => {
  const rough = [{ isovalue: 60 }, { labels: [3] }, { labels: [1, 2] }];
  assert.equal(areSmooth(rough), false);
  assert.equal(areSmooth([{ isovalue: 60 }]), false);
  const smooth = withSmooth(rough, true);
  assert.ok(areSmooth(smooth));
  assert.equal(smooth[0].smoothLabels, undefined);
  assert.equal(stateToHash({ surfaces: smooth }), 'surface=60&label=3&label=1,2&smooth-labels=');
  assert.deepEqual(stateFromHash('smooth-labels=&surface=60&label=3&label=1,2').state.surfaces, smooth);
  assert.deepEqual(stateFromHash('surface=60&label=3&label=1,2').state.surfaces, rough);
  assert.deepEqual(withSmooth(smooth, false), rough);
  assert.match(stateToCommand({ surfaces: smooth }, 'p.png'), /--smooth-labels \\/);
});

test('a link of many labels is short, and opens with the same surfaces in the same order', () => {
  const single = (value, paint = {}) => ({ labels: [value], color: { ...colorOfLabel(BODY, value), ...paint } });
  const many = Array.from({ length: 116 }, (_, i) => single(i + 1));
  const set = { labels: [200, 300], color: { red: 1, green: 0, blue: 0, alpha: 0.5 } };
  for (const [surfaces, words] of [
    [many, 'labels=1-116'],
    [[{ isovalue: 60 }, ...many, set], 'surface=60&labels=1-116&label=200,300:1,0,0:0.5'],
    [[single(5), single(7), single(6), single(1), set, single(9)], null],
    [[...many.slice(0, 3), single(4, { red: 0, alpha: 0.3 }), ...many.slice(4, 9)], null],
    [many.map((one, i) => i < 50 ? one : { ...one, color: { ...one.color, alpha: 0.25 } }), 'labels=1-50&labels=51-116:0.25'],
  ]) {
    const state = { dataset: 'body', surfaces };
    const link = stateToLink(state, BODY);
    if (words !== null) {
      assert.equal(link, `dataset=body&${words}`);
    }
    const read = stateFromHash(link);
    assert.deepEqual(read.problems, []);
    assert.deepEqual(withColors(read.state.surfaces, BODY), surfaces);
  }
  // What the gateway and the command line read has a word for each.
  assert.equal(stateToHash({ surfaces: many }).match(/label=/g).length, 116);
});

test('a link has no colour that the dataset gives its labels, however few', () => {
  const own = (labels) => ({ labels, color: colorOfLabel(BODY, labels[0]) });
  const red = { labels: [9], color: { red: 1, green: 0, blue: 0, alpha: 1 } };
  for (const [surfaces, words] of [
    [[own([3])], 'labels=3'],
    [onlyLabel([own([1]), own([3])], 1), 'labels=3'],
    [[own([3]), own([4])], 'labels=3,4'],
    [[own([3, 7, 8, 9])], 'label=3,7-9'],
    [[{ ...own([3, 4]), color: { ...colorOfLabel(BODY, 3), alpha: 0.5 } }], `label=3,4:${own([3]).color.red},${own([3]).color.green},${own([3]).color.blue}:0.5`],
    [[red], 'label=9:1,0,0'],
    [[own([3]), red], 'labels=3,9&label=9:1,0,0'],
  ]) {
    assert.equal(stateToLink({ surfaces }, BODY), words);
    assert.deepEqual(withColors(stateFromHash(words).state.surfaces, BODY), surfaces);
  }
});

test('a wrong list of labels is left out with a sentence', () => {
  const { state, problems } = stateFromHash('#labels=lung&labels=1-3:x&labels=5-3&labels=4-6');
  assert.deepEqual(state.surfaces.map(({ labels }) => labels), [[4], [5], [6]]);
  assert.equal(problems.length, 3);
  problems.forEach((sentence) => assert.match(sentence, /^labels=.+ of this link was left out: .+\.$/));
});
