// The state in the page's address: what is written is read again, number for number.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';

import { fileOf, filmToCommand, meshToCommand, stateToCommand } from '../../../clients/web/commands.js';
import { COLOR_MAP_POINTS } from '../../../clients/web/color-maps.js';
import { colorFromText } from '../../../clients/web/css-colors.js';
import { COLOR_MAPS, EFFECTS, FIRST_LOOK } from '../../../clients/web/parameters.js';
import {
  asksFirstLook, CAP_WINDOW, colorByFromKey, colorByToKey, colorMapToJson, defaultNanColor, drawnToWords, MESH_FORMATS,
  meshAddress, otherSideOf, pictureAddress, stateFromHash, stateToHash, tokenOfHash, tokenOfText, webpAddress,
  withFirstLook, withMaterialOf, withoutToken,
} from '../../../clients/web/view-state.js';

const FULL = {
  dataset: 'a name/with &=#%:, ünd',
  surfaces: [
    { isovalue: 60.1, color: { red: 0.8627, green: 0.1, blue: 1 / 3, alpha: 0.35 },
      colorBy: { quantity: 'QUANTITY_POSITION_X', colorMap: 'COLOR_MAP_COOL_WARM', range: { min: -1e-7, max: 3e22 },
        opacity: { atMin: 0, atMax: 0.75 } } },
    { isovalue: -0.1 + 0.3, color: { red: 1, green: 1, blue: 0, alpha: 1 }, colorBy: { quantity: 'QUANTITY_NORMAL' } },
    { isovalue: 5e-324 },
  ],
  camera: { eye: { x: 0.1 + 0.2, y: -1e-17, z: 1e300 }, target: { x: 1, y: 2, z: 3 }, up: { x: 0, y: 0, z: 1 },
    perspective: { fovYDegrees: 29.999999999999996 } },
  clip: { halfSpaces: [{ normal: { x: 1, y: 0, z: -0.5 }, offset: 12.5 }, { normal: { x: 0, y: 1, z: 0 }, offset: -3 }],
    box: { min: { x: 1, y: 2, z: 3 }, max: { x: 4, y: 5.5, z: 6 } } },
  caps: { colorMap: 'COLOR_MAP_GREY', range: { min: 0, max: 200 } }, nanColor: { red: 0.25, green: 0, blue: 1, alpha: 1 },
  lights: [{ direction: { x: -1, y: 1, z: 2 }, intensity: 0.7, color: { red: 1, green: 0.5, blue: 0.25, alpha: 1 }, space: 'SPACE_WORLD' },
    { direction: { x: 0, y: 0, z: 1 }, intensity: 1, space: 'SPACE_WORLD' }],
  samples: 4, ambientOcclusion: { radiusPx: 24, strength: 0.5 },
  silhouette: { widthPx: 3, color: { red: 1, green: 0, blue: 0, alpha: 1 } }, maxLayers: 12,
  backgroundColor: { red: 0.0431, green: 0.05, blue: 0.08, alpha: 0.5 },
};

test('a state with everything in it comes back from its hash, bit for bit', () => {
  const { state, problems } = stateFromHash(`#${stateToHash(FULL)}`);
  assert.deepEqual(problems, []);
  assert.deepEqual(state, FULL);
});

test('field and time are in the words of the command line, and come back', () => {
  const velocity = { quantity: 'QUANTITY_FIELD', field: 'velocity', component: 'x', colorMap: 'COLOR_MAP_MAGMA', range: { min: 0, max: 2 } };
  for (const [hash, state] of Object.entries({
    'field=pressure&step=3': { selection: { field: 'pressure', timeStep: 3 } },
    'field=velocity:x&time=0.30000000000000004': { selection: { field: 'velocity', component: 'x', time: 0.1 + 0.2 } },
    'step=0': { selection: { timeStep: 0 } },
    'step=last': { selection: { timeStep: -1 } },
    'surface=1&color-by=velocity:x:magma:0,2': { surfaces: [{ isovalue: 1, colorBy: velocity }] },
    'surface=1&color-by=heat:viridis': { surfaces: [{ isovalue: 1, colorBy: { quantity: 'QUANTITY_FIELD', field: 'heat', colorMap: 'COLOR_MAP_VIRIDIS' } }] },
  })) {
    assert.deepEqual(stateFromHash(hash), { state, problems: [] });
    assert.equal(stateToHash(state), hash);
  }
  assert.deepEqual(stateFromHash('step=first&field=a:b:2&component=y').state.selection, { timeStep: 0, field: 'a:b', component: 'y' });
  const { state, problems } = stateFromHash('#step=1.5&step=-2&step=&time=now&field=:x&field=v:&color-by=heat:');
  assert.deepEqual(state, {});
  assert.equal(problems.length, 6);
  assert.deepEqual(stateFromHash('#step=2&time=1'), { state: { selection: { timeStep: 2 } }, problems: ['time of this link was left out: it has a step, too.'] });
});

test('what colours show is one word for a menu', () => {
  for (const [key, colorBy] of Object.entries({ x: { quantity: 'QUANTITY_POSITION_X' }, gradient: { quantity: 'QUANTITY_GRADIENT_MAGNITUDE' },
    'field:heat': { quantity: 'QUANTITY_FIELD', field: 'heat' }, 'field:v:z': { quantity: 'QUANTITY_FIELD', field: 'v', component: 'z' } })) {
    assert.equal(colorByToKey(colorBy), key);
    assert.deepEqual(colorByFromKey(key), colorBy);
  }
  assert.equal(colorByToKey(undefined), 'none');
});

test('the other side of a plane has the same plane: offset and normal change their signs', () => {
  const flipped = otherSideOf({ normal: { x: 1, z: -0.5 }, offset: 12.5 });
  assert.equal(JSON.stringify(flipped), JSON.stringify({ normal: { x: -1, y: 0, z: 0.5 }, offset: -12.5 }));
  const again = otherSideOf(flipped);
  assert.equal(JSON.stringify(again), JSON.stringify({ normal: { x: 1, y: 0, z: -0.5 }, offset: 12.5 }));
  assert.equal(otherSideOf({ normal: { y: 1 } }).offset, -0);
});

test('a parallel camera, a fitted view and an empty state come back', () => {
  for (const state of [{}, { clip: { box: { min: { x: 0, y: 0, z: 0 }, max: { x: 1, y: 1, z: 1 } } }, caps: {} },
    { surfaces: [{ isovalue: 1, colorBy: { quantity: 'QUANTITY_POSITION_Y', colorMap: 'COLOR_MAP_GREY', opacity: { atMin: 1, atMax: 0 } } }] }, { dataset: 'x', cameraFit: 'CAMERA_FIT_SURFACE' },
    { cameraFit: 'CAMERA_FIT_CELLS' },
    { camera: { eye: { x: 1, y: 0, z: 0 }, target: { x: 0, y: 0, z: 0 }, up: { x: 0, y: 1, z: 0 }, orthographic: { height: 7.25 } } }]) {
    assert.deepEqual(stateFromHash(stateToHash(state)).state, state);
  }
});

test('the first look is asked for where a state says nothing of the camera, and what it says stays', () => {
  assert.equal(asksFirstLook({ surfaces: [{ isovalue: 1 }] }), true);
  assert.equal(asksFirstLook({ camera: { eye: { z: 1 } } }), false);
  assert.equal(asksFirstLook({ cameraFit: 'CAMERA_FIT_SURFACE' }), false);
  const own = { diffuse: 0.5 };
  const first = withFirstLook({ dataset: 'x', surfaces: [{ isovalue: 1 }, { isovalue: 2, material: own }] }, 'CAMERA_FIT_CELLS');
  assert.deepEqual(first, { dataset: 'x', samples: FIRST_LOOK.samples, cameraFit: 'CAMERA_FIT_CELLS',
    surfaces: [{ isovalue: 1, material: FIRST_LOOK.material }, { isovalue: 2, material: own }] });
  assert.equal(withFirstLook({ samples: 1, surfaces: [] }, 'CAMERA_FIT_CELLS').samples, 1);
  assert.equal('cameraFit' in withFirstLook({ surfaces: [] }, 'CAMERA_FIT_SURFACE'), false, 'an older coordinator refuses it');
});

test('the material of the first look is one word of a link, for all surfaces or for none', () => {
  const { surfaces } = withFirstLook({ surfaces: [{ isovalue: 1 }, { isovalue: 2 }] }, '');
  const hash = stateToHash({ surfaces });
  assert.match(hash, /&material=soft$/);
  assert.deepEqual(stateFromHash(hash).state, { surfaces });
  assert.doesNotMatch(stateToHash({ surfaces: [surfaces[0], { isovalue: 2 }] }), /material/);
  assert.deepEqual(stateFromHash('#surface=1&material=glossy'), { state: { surfaces: [{ isovalue: 1 }] }, problems: [] });
  assert.equal(stateFromHash('#surface=1&material=wood').problems.length, 1);
});

test('new surfaces have the material that all others have', () => {
  const { surfaces } = withFirstLook({ surfaces: [{ isovalue: 1 }, { isovalue: 2 }] }, '');
  const other = { isovalue: 7 };
  const [soft] = withMaterialOf([other], surfaces);
  assert.deepEqual(soft, { isovalue: 7, material: FIRST_LOOK.material });
  assert.match(stateToHash({ surfaces: [soft] }), /&material=soft$/);
  assert.deepEqual(withMaterialOf([...surfaces, other], surfaces).map(({ material }) => material), Array(3).fill(FIRST_LOOK.material));
  for (const others of [[], [{ isovalue: 1 }], [surfaces[0], { isovalue: 2 }]]) {
    assert.deepEqual(withMaterialOf([other], others), [other]);
  }
});

test('the hash can be read by people, and survives a mail program that encodes it', () => {
  const hash = stateToHash({ dataset: 'head', surfaces: [{ isovalue: 60, color: { red: 1, green: 0.5, blue: 0, alpha: 1 } }] });
  assert.equal(hash, 'dataset=head&surface=60:1,0.5,0');
  assert.deepEqual(stateFromHash(hash.replace(/,/g, '%2C').replace(/:/g, '%3A')), stateFromHash(hash));
});

test('what is wrong in a link is left out with a sentence, and the rest is kept', () => {
  const { state, problems } = stateFromHash('#surface=x&surface=60:1,2&surface=30&eye=1,2&fov-y=wide&clip-box=1,2,3&' +
    'clip-plane=0,0,NaN,1&light=Infinity,0,0&color-by=x:heat&caps=heat&bogus=1&__proto__=1&constructor=2&samples=5&background=reddish');
  assert.deepEqual(state, { surfaces: [{ isovalue: 30 }] });
  assert.equal(problems.length, 13);
  problems.forEach((sentence) => assert.match(sentence, /of this link was left out: .+\.$/));
});

test('no link makes the reader throw', () => {
  let seed = 7;
  const random = (n) => {
    seed = (seed * 48271) % 2147483647;
    return seed % n;
  };
  const alphabet = [...'surface=60:1,2&eye%#;+ -.eE0NaNé\u0000'];
  const whole = [...stateToHash(FULL)];
  for (let i = 0; i < 2000; ++i) {
    const text = [...whole];
    for (let k = 0; k < 1 + random(8); ++k) {
      text[random(text.length)] = alphabet[random(alphabet.length)];
    }
    stateFromHash(text.join(''));
  }
});

test('an isovalue alone, as isoscope view names it, is a surface', () => {
  assert.deepEqual(stateFromHash('dataset=head&isovalue=60').state, { dataset: 'head', surfaces: [{ isovalue: 60 }] });
  assert.equal(stateFromHash('isovalue=x').problems.length, 1);
});

test('a colour of a link may be a name of CSS or hexadecimal digits, in any case', () => {
  const { state, problems } = stateFromHash('#surface=60:Tomato&surface=70:#0f8:0.5&surface=80:%23336699CC&light=0,0,1:1:gold&' +
    'silhouette=2:DarkSlateGrey&background=rebeccapurple');
  assert.deepEqual(problems, []);
  assert.deepEqual(state.surfaces.map((surface) => surface.color), [
    { red: 1, green: 99 / 255, blue: 71 / 255, alpha: 1 }, { red: 0, green: 1, blue: 136 / 255, alpha: 0.5 },
    { red: 0.2, green: 0.4, blue: 0.6, alpha: 0.8 }]);
  assert.deepEqual(state.lights[0].color, { red: 1, green: 215 / 255, blue: 0, alpha: 1 });
  assert.deepEqual(state.silhouette.color, colorFromText('#2f4f4f'));
  assert.deepEqual(state.backgroundColor, colorFromText('#639'));
  // Written with numbers, which come back the same.
  assert.deepEqual(stateFromHash(stateToHash(state)).state, state);
  for (const text of ['', 'reddish', '#12345', '#gg0000', 'ff0000', '#', 'constructor']) {
    assert.equal(colorFromText(text), null, text);
  }
  assert.equal(colorFromText('transparent').alpha, 0);
});

test('a level is in a link by its number, or by the distance of its samples', () => {
  const surfaces = [{ isovalue: 60 }];
  for (const [level, word] of /** @type {[any, string][]} */ ([[{ level: 2 }, 'level=2'], [{ level: 0 }, 'level=0'],
    [{ maxSpacingPx: 1.1 }, 'max-spacing=1.1']])) {
    const hash = stateToHash({ surfaces, level });
    assert.equal(hash, `surface=60&${word}`);
    assert.deepEqual(stateFromHash(hash), { state: { surfaces, level }, problems: [] });
  }
  assert.equal(stateToHash({ surfaces }), 'surface=60');
});

test('wrong levels of a link are left out, with a sentence for each', () => {
  const left = (/** @type {string} */ hash) => stateFromHash(hash).problems;
  for (const word of ['level=24', 'level=-1', 'level=1.5', 'level=x', 'max-spacing=0', 'max-spacing=-2', 'max-spacing=NaN']) {
    assert.equal(left(word).length, 1, word);
    assert.match(left(word)[0], new RegExp(`^${word.replace('.', '\\.')} of this link was left out`));
  }
  const both = stateFromHash('level=1&max-spacing=2');
  assert.deepEqual(both.state, { level: { level: 1 } });
  assert.match(both.problems[0], /^max-spacing=2 .*another word/);
});

test('a colour of missing samples is in a link where colours show samples, and nowhere else', () => {
  const nanColor = { red: 0, green: 0.5, blue: 1, alpha: 1 };
  const byField = { quantity: 'QUANTITY_FIELD', field: 'heat' };
  for (const shows of [{ surfaces: [{ isovalue: 1 }, { isovalue: 2, colorBy: byField }] }, { caps: { colorMap: 'COLOR_MAP_GREY' } }]) {
    assert.match(stateToHash({ ...shows, nanColor }), /(^|&)nan-color=0,0.5,1(&|$)/);
    assert.deepEqual(stateFromHash(stateToHash({ ...shows, nanColor })).state.nanColor, nanColor);
    assert.doesNotMatch(stateToHash(shows), /nan-color/);
  }
  assert.equal(stateToHash({ surfaces: [{ isovalue: 1, colorBy: { quantity: 'QUANTITY_POSITION_X' } }], caps: {}, nanColor }).includes('nan-color'), false);
  // The server refuses one that is not opaque.
  assert.deepEqual(stateFromHash('#nan-color=%23ff000080').state.nanColor, { red: 1, green: 0, blue: 0, alpha: 1 });
  assert.equal(stateFromHash('#nan-color=reddish').problems.length, 1);
  assert.deepEqual(['grey', 'cividis', 'viridis', 'cool-warm'].map((name) => defaultNanColor(colorMapToJson(name))),
    ['#800080', '#800080', '#808080', '#808080']);
  assert.equal(defaultNanColor(undefined), '#808080');
});

test('isovalues with commas between them are surfaces, and a colour is that of all that have none', () => {
  const { state, problems } = stateFromHash('#isovalue=30,60.5&surface=70:#f00&color=white');
  assert.deepEqual(problems, []);
  const white = { red: 1, green: 1, blue: 1, alpha: 1 };
  assert.deepEqual(state.surfaces, [{ isovalue: 30, color: white }, { isovalue: 60.5, color: white },
    { isovalue: 70, color: { red: 1, green: 0, blue: 0, alpha: 1 } }]);
});

test('a word that is null or has no value counts as absent, and so does a part of a state', () => {
  const { state, problems } = stateFromHash('#dataset=&surface=60&background=null&fov-y=&clip-box=null&caps=null&samples=');
  assert.deepEqual([state, problems], [{ surfaces: [{ isovalue: 60 }] }, []]);
  assert.deepEqual(stateFromHash('#caps=&ambient-occlusion&silhouette=').state,
    { caps: {}, ambientOcclusion: { radiusPx: 32 }, silhouette: { widthPx: 2 } });
  const nothing = Object.fromEntries(Object.keys(FULL).map((name) => [name, null]));
  assert.equal(stateToHash(nothing), '');
  assert.equal(stateToHash({ ambientOcclusion: { radiusPx: null, strength: null }, silhouette: { widthPx: null, color: null },
    surfaces: [{ isovalue: null, color: null, colorBy: null }], lights: [{ direction: { x: 1, y: null }, intensity: null, color: null }],
    clip: { box: null, halfSpaces: null } }), 'surface=0&light=1,0,0:1&ambient-occlusion=32&silhouette=2');
});

test('each effect is in links, with and without values', () => {
  for (const { flag, json, values } of EFFECTS) {
    const whole = Object.fromEntries(values.map((one) =>
      [one.json, one.kind === 'color' ? colorFromText('tomato') : one.kind === 'whole' ? 7 : 0]));
    assert.deepEqual(stateFromHash(stateToHash({ [json]: whole })).state, { [json]: whole });
    assert.deepEqual(stateFromHash(`#${flag}`).state, { [json]: { [values[0].json]: Number(values[0].initial) } });
    assert.equal(stateToHash({ [json]: {} }), `${flag}=${values[0].initial}`);
  }
});

test('the window of cuts is in links, and those of older versions have none', () => {
  const clip = 'clip-box=0,1,0,1,0,1';
  const caps = (/** @type {string} */ words) => stateFromHash(`#${clip}&${words}`).state.caps;
  assert.deepEqual(caps('caps=grey&cap-window=2,98'), { colorMap: 'COLOR_MAP_GREY', range: { percentiles: { low: 2, high: 98 } } });
  assert.deepEqual(caps('cap-window=0.5,50&caps=turbo').range, { percentiles: { low: 0.5, high: 50 } });
  for (const none of ['caps=grey', 'caps=grey&cap-window=none', 'caps=grey&cap-window=98,2', 'caps=grey&cap-window=0,101']) {
    assert.deepEqual(caps(none), { colorMap: 'COLOR_MAP_GREY' });
  }
  assert.deepEqual(caps('caps=grey:1,3&cap-window=2,98').range, { min: 1, max: 3 });
  for (const [state, words] of /** @type {[any, string][]} */ ([
    [{ colorMap: 'COLOR_MAP_GREY', range: CAP_WINDOW }, 'caps=grey&cap-window=2,98'],
    [{ colorMap: 'COLOR_MAP_GREY' }, 'caps=grey&cap-window=none'],
    [{ colorMap: 'COLOR_MAP_GREY', range: { min: 1, max: 3 } }, 'caps=grey:1,3'],
    [{}, 'caps='],
  ])) {
    assert.equal(stateToHash({ caps: state }), words);
    assert.deepEqual(stateFromHash(words).state.caps, state);
  }
  assert.deepEqual(stateFromHash('#cap-window=98,2').problems.length, 1);
});

test('links of older versions open as they did', () => {
  const { state, problems } = stateFromHash('#dataset=head&surface=60:0.9,0.8,0.7&surface=75:1,1,0.9:0.5&color-by=z:turbo:0,10:1,0.5&' +
    'color-by=none&eye=1,2,3&target=0,0,0&up=0,1,0&fov-y=30&clip-plane=1,0,0,5&clip-box=0,1,0,1,0,1&caps=grey:0,9&' +
    'light=1,2,3:0.5:1,1,1&light-space=world&samples=4&ambient-occlusion=24,0.5&silhouette=3:1,0,0&max-layers=4&background=0,0,0,0.5');
  assert.deepEqual(problems, []);
  assert.deepEqual(Object.keys(state), ['dataset', 'surfaces', 'clip', 'caps', 'lights', 'samples', 'ambientOcclusion', 'silhouette',
    'maxLayers', 'backgroundColor', 'camera']);
  assert.deepEqual(stateFromHash('#fit=surface&orthographic-height=7&eye=1,0,0&target=0,0,0&up=0,1,0').state.camera.orthographic, { height: 7 });
});

test('the token of a link with access is taken out of it, and the rest keeps its letters', () => {
  const token = 'a+b/c=~.-_9&#';
  const link = '#dataset=a%20b&surface=60:1,0.5,0';
  for (const hash of [`${link}&token=${encodeURIComponent(token)}`, `#token=${encodeURIComponent(token)}&${link.slice(1)}`]) {
    assert.equal(tokenOfHash(hash), token);
    assert.equal(`#${withoutToken(hash)}`, link);
  }
  assert.deepEqual([tokenOfHash(link), tokenOfHash(''), tokenOfHash('#token='), tokenOfHash('#token=a+b')], ['', '', '', 'a+b']);
});

test('what people paste at the door is a token, or an address with one', () => {
  for (const [text, token] of [[' abc\n', 'abc'], ['http://host:8080/?token=a%2Bb&dataset=head', 'a+b'], ['http://host/?theme=dark&token=x', 'x'],
    ['http://host/#surface=6&token=x%2F', 'x/'], ['a+b/c=', 'a+b/c='], ['http://host/?token=%zz', '%zz'], ['', '']]) {
    assert.equal(tokenOfText(text), token);
  }
});

test('the command of a state quotes what a shell would read otherwise', () => {
  const command = stateToCommand({ dataset: 'it\'s; rm -rf', surfaces: [{ isovalue: 60 }], caps: {} }, 'a.png');
  assert.equal(command, 'isoscope render --server HOST:50051 \\\n  --dataset \'it\'\\\'\'s; rm -rf\' \\\n  --surface 60 \\\n  --caps \\\n  --output a.png');
});

test('the command reads the file of isoscope view, else a server, with its token where there is one', () => {
  const state = { dataset: 'head-0123456789abcdef', surfaces: [{ isovalue: 60 }], samples: 4 };
  const size = { width: 640, height: 480 };
  /** @param {any} source */
  const first = (source) => stateToCommand(state, 'a.png', size, source).split(' \\\n  ').slice(0, 3);
  assert.deepEqual(first({ file: 'my head.nii.gz' }), ['isoscope render \'my head.nii.gz\'', '--surface 60', '--samples 4']);
  assert.deepEqual(first({ file: '-x.nrrd' })[0], 'isoscope render ./-x.nrrd');
  assert.deepEqual(first({ hasToken: true }), ['isoscope render --server HOST:50051', '--token-file TOKEN_FILE', '--dataset head-0123456789abcdef']);
  assert.deepEqual(first({}), ['isoscope render --server HOST:50051', '--dataset head-0123456789abcdef', '--surface 60']);
  const head = { name: 'head', source: 'head.nii.gz' };
  assert.equal(fileOf(head, 'http://127.0.0.1:8080/', 'http://127.0.0.1:8080/?theme=dark#dataset=head'), 'head.nii.gz');
  for (const [told, page] of [['http://127.0.0.1:8080/', 'http://127.0.0.1:8081/'], ['https://host/', 'https://host/'], ['', 'http://127.0.0.1:8080/'],
    ['no address', 'http://127.0.0.1:8080/']]) {
    assert.equal(fileOf(head, told, page), '', `${told} and ${page}`);
  }
  assert.equal(fileOf(null, 'http://localhost:1/', 'http://localhost:1/'), '');
});

test('the legend has the colours of the pictures', () => {
  const source = readFileSync(new URL('../../../core/picture/color_map.cc', import.meta.url), 'utf8');
  for (const [name, word] of [['viridis', 'Viridis'], ['magma', 'Magma'], ['cividis', 'Cividis'], ['turbo', 'Turbo'], ['cool-warm', 'CoolWarm']]) {
    const table = source.match(new RegExp(`k${word} = \\{([^}]*)\\}`))?.[1].match(/0x[0-9a-f]{6}/g)?.map((hex) => hex.replace('0x', '#'));
    assert.deepEqual(COLOR_MAP_POINTS[name], table);
  }
  assert.deepEqual(Object.keys(COLOR_MAP_POINTS), COLOR_MAPS);
});

test('a picture is posted to an address with what is drawn over it, and the command has the same but for the record', () => {
  const drawn = { axes: true, scaleBar: true, legend: true, caption: 'at {isovalue} & "{time}"' };
  assert.equal(pictureAddress('a b', {}, false), 'v1/datasets/a%20b/render');
  assert.equal(pictureAddress('ball', { axes: false, caption: '' }, true), 'v1/datasets/ball/render?record');
  const address = new URL(pictureAddress('ball', drawn, true), 'http://gateway/');
  assert.deepEqual([...address.searchParams], [['axes', ''], ['scale-bar', ''], ['legend', ''], ['caption', drawn.caption], ['record', '']]);
  const command = stateToCommand({ surfaces: [{ isovalue: 1 }] }, 'a.png', { width: 2, height: 3 }, {}, drawn);
  assert.match(command, /--axes \\\n {2}--scale-bar \\\n {2}--legend \\\n {2}--caption 'at \{isovalue\} & "\{time\}"' \\\n {2}--width 2/);
  assert.deepEqual(drawnToWords({ legend: true }), [['legend', '']]);
  assert.doesNotMatch(stateToCommand({ surfaces: [{ isovalue: 1 }] }, 'a.png'), /--axes|--caption|--record/);
});

test('the command of a film has its frames, and steps only where numbers can name them', () => {
  const FILM = { format: 'webp', kind: 'turn', frameCount: 5, steps: [], framesPerSecond: 7.5, width: 64, height: 48 };
  const state = { dataset: 'flow', selection: { field: 'p', timeStep: 3 }, surfaces: [{ isovalue: 60 }], samples: 4, cameraFit: 'CAMERA_FIT_CELLS' };
  assert.equal(filmToCommand(FILM, [], state, { hasToken: true }, { axes: true }), ['isoscope render --server HOST:50051', '--token-file TOKEN_FILE', '--dataset flow',
    '--field p', '--step 3', '--surface 60', '--fit cells', '--samples 4', '--axes', '--width 64', '--height 48', '--repeat 5', '--orbit 72', '--fps 7.5',
    '--output film.webp'].join(' \\\n  '));
  const stepsOf = (steps, served) => /--step (\S+)/.exec(filmToCommand({ ...FILM, kind: 'steps', steps }, served, state) ?? '')?.[1];
  assert.equal(stepsOf([0, 1, 2], [0, 1, 2]), '0:2');
  assert.equal(stepsOf([0, 2, 4], [0, 1, 2, 3, 4, 5]), '0:4:2');
  assert.equal(stepsOf([0, 2, 7], [0, 2, 7]), '0:7', 'every step that is served');
  assert.equal(stepsOf([10, 30], [10, 20, 30, 40]), '10:30:20');
  assert.equal(stepsOf([0, 7], [0, 2, 7, 8]), '0:7:7');
  assert.equal(stepsOf([0, 7, 9], [0, 2, 7, 8, 9]), undefined);
  assert.doesNotMatch(filmToCommand({ ...FILM, kind: 'steps', steps: [0, 1] }, [0, 1], state) ?? '', /repeat|orbit/);
});

test('a WebP is asked for by the words of its state, as a link, with its size and what is drawn over it', () => {
  const request = { dataset: 'a b', surfaces: [{ isovalue: 60 }], samples: 4, camera: FULL.camera, viewport: { widthPx: 640, heightPx: 480 } };
  const address = webpAddress(request, { axes: true, caption: '50 % & more' });
  assert.match(address, /^v1\/datasets\/a%20b\/render\?surface=60&eye=/);
  const words = [...new URL(address, 'http://gateway/').searchParams];
  assert.deepEqual(words.slice(-5), [['width', '640'], ['height', '480'], ['format', 'webp'], ['axes', ''], ['caption', '50 % & more']]);
  assert.deepEqual(stateFromHash(new URLSearchParams(words.slice(0, -5)).toString()).state, { surfaces: request.surfaces, samples: 4, camera: FULL.camera });
});

test('meshes have their selection and clip region, opaque colours, and as STL none', () => {
  const state = { dataset: 'ball', selection: { field: 'p', timeStep: 3 }, samples: 4, caps: {}, clip: { halfSpaces: [{ normal: { x: 1 }, offset: 2 }] },
    surfaces: [{ isovalue: 60, color: { red: 1, green: 0.5, blue: 0, alpha: 0.25 }, colorBy: { quantity: 'QUANTITY_NORMAL' } }, { labels: [3, 4, 5], smoothLabels: true }] };
  assert.equal(meshAddress(state, 'ply'), 'v1/datasets/ball/mesh.ply?field=p&step=3&surface=60:1,0.5,0&label=3-5&smooth-labels=&clip-plane=1,0,0,2');
  assert.equal(meshAddress(state, 'stl'), 'v1/datasets/ball/mesh.stl?field=p&step=3&surface=60&label=3-5&smooth-labels=&clip-plane=1,0,0,2');
  assert.equal(meshToCommand(state, 'ply', { file: 'a b.nrrd' }), ['isoscope export \'a b.nrrd\'', '--field p', '--step 3', '--surface 60:1,0.5,0', '--label 3-5',
    '--smooth-labels', '--clip-plane 1,0,0,2', '--output mesh.ply'].join(' \\\n  '));
  assert.doesNotMatch(meshToCommand(state, 'stl'), /1,0.5,0/);
  assert.deepEqual(MESH_FORMATS.map(([format]) => format).sort(), ['glb', 'obj', 'ply', 'stl', 'vtp']);
});
