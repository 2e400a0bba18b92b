// The commands that the page shows, run by the real `isoscope render` of the folder ISOSCOPE_BIN, on a volume of 16³
// and on a flow of two steps.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { basename, join } from 'node:path';
import { after, test } from 'node:test';

import { ApngWriter } from '../../../clients/web/apng.js';
import { filmToCommand, meshToCommand, stateToCommand } from '../../../clients/web/commands.js';
import { COLOR_MAPS } from '../../../clients/web/parameters.js';
import { FLAGS, MESH_FORMATS, stateFromHash, withFirstLook } from '../../../clients/web/view-state.js';

const program = join(process.env.ISOSCOPE_BIN ?? '', 'isoscope');
const folder = mkdtempSync(join(tmpdir(), 'isoscope-command-'));
const volume = join(folder, 'it\'s a gyroid.nrrd');
after(() => rmSync(folder, { recursive: true, force: true }));

/** @param {string[]} words */
function run(words) {
  const result = spawnSync(program, words, { cwd: folder, encoding: 'utf8', env: { ...process.env, XDG_CACHE_HOME: folder } });
  return { status: result.status, text: result.stdout + result.stderr };
}
assert.equal(run(['generate', 'gyroid', '--dims', '16,16,16', '--type', 'uint8', '--output', volume]).status, 0);
const flow = join(folder, 'flow.pvd');
assert.equal(run(['generate', 'flow', '--dims', '12,12,12', '--steps', '2', '--output', flow]).status, 0);

/** Takes a command apart as a shell does. @param {string} command @returns {string[]} */
function wordsOf(command) {
  const result = spawnSync('sh', ['-c', `for word in ${command.replace(/^isoscope /, '')}; do printf '%s\\0' "$word"; done`], { encoding: 'utf8' });
  assert.equal(result.status, 0, result.stderr);
  return result.stdout.split('\0').slice(0, -1);
}

/** @param {any} state */
const commandOf = (state) => stateToCommand(state, 'picture.png', { width: 24, height: 16 });

const SURFACE = { isovalue: 100, color: { red: 0.8627, green: 0.1, blue: 1 / 3, alpha: 1 } };
const CAMERA = { eye: { x: -30, y: -0.1 - 0.2, z: 1e-7 }, target: { x: 7, y: 7, z: 7 }, up: { x: 0, y: 0, z: 1 }, perspective: { fovYDegrees: 29.999999999999996 } };
const CLIP = { halfSpaces: [{ normal: { x: -1, y: 0, z: -0.5 }, offset: -12.5 }, { normal: { x: 0, y: 1, z: 0 }, offset: 3 }],
  box: { min: { x: -1, y: 2, z: 3 }, max: { x: 14, y: 12.5, z: 11 } } };
/** @param {string} quantity @param {any} [rest] */
const colored = (quantity, rest) => ({ ...SURFACE, colorBy: { quantity: `QUANTITY_${quantity}`, ...rest } });

/** Each control of the page, and each part that only a link can bring. @type {Record<string, any>} */
const STATES = {
  'an isovalue alone': { surfaces: [{ isovalue: 100 }] },
  'an isovalue of zero, and one below': { surfaces: [{ isovalue: 0 }, { isovalue: -1e-7 }] },
  'translucent surfaces': { surfaces: [{ isovalue: 60, color: { ...SURFACE.color, alpha: 0.35 } }, SURFACE], maxLayers: 12 },
  'one coloured surface of two': { surfaces: [colored('POSITION_X'), SURFACE] },
  'labels, one a set': { surfaces: [{ labels: [100], color: SURFACE.color }, { labels: [3, 4, 5, 90.5], color: { ...SURFACE.color, alpha: 0.4 } }] },
  'smooth labels': { surfaces: [{ labels: [100], color: SURFACE.color, smoothLabels: true }] },
  'an isovalue and no label': { surfaces: [SURFACE, { labels: [-1], color: SURFACE.color }] },
  normal: { surfaces: [colored('NORMAL')] },
  gradient: { surfaces: [colored('GRADIENT_MAGNITUDE', { opacity: { atMin: 0.2, atMax: 1 } })] },
  ...Object.fromEntries(COLOR_MAPS.map((name) => [name, { surfaces: [colored('POSITION_Y',
    { colorMap: `COLOR_MAP_${name.toUpperCase().replace('-', '_')}`, range: { min: -1, max: 12.5 }, opacity: { atMin: 0, atMax: 0.75 } })] }])),
  camera: { surfaces: [SURFACE], camera: CAMERA },
  'parallel projection': { surfaces: [SURFACE], camera: { eye: { x: 1, y: 2, z: 40 }, target: { x: 1 }, up: { y: 1 }, orthographic: { height: 7.25 } } },
  'a view from a side': { surfaces: [SURFACE], camera: CAMERA, cameraFit: 'CAMERA_FIT_SURFACE' },
  'the first look, before the answer': withFirstLook({ surfaces: [SURFACE, { isovalue: 60 }] }, 'CAMERA_FIT_CELLS'),
  'the default camera, fitted': { surfaces: [SURFACE], cameraFit: 'CAMERA_FIT_SURFACE' },
  'clip planes and box': { surfaces: [SURFACE], clip: CLIP },
  'filled cuts': { surfaces: [SURFACE], clip: CLIP, caps: {} },
  'cuts with samples': { surfaces: [SURFACE], clip: CLIP, caps: { colorMap: 'COLOR_MAP_GREY' } },
  'cuts with a range of samples': { surfaces: [SURFACE], clip: CLIP, caps: { colorMap: 'COLOR_MAP_COOL_WARM', range: { min: -5, max: 200 } } },
  'cuts with a window of samples': { surfaces: [SURFACE], clip: CLIP, caps: { colorMap: 'COLOR_MAP_GREY', range: { percentiles: { low: 2, high: 98 } } } },
  'lights of the view': { surfaces: [SURFACE], lights: [{ direction: { x: -1, y: 1.2, z: 1.6 }, intensity: 0.85 },
    { direction: { x: 1, y: 0, z: 1 }, intensity: 0.3, color: { red: 0.75, green: 0.85, blue: 1, alpha: 1 } }] },
  'lights of the world': { surfaces: [SURFACE], lights: [{ direction: { x: -1 }, space: 'SPACE_WORLD' }] },
  effects: { surfaces: [SURFACE], samples: 4, ambientOcclusion: { radiusPx: 32 }, silhouette: { widthPx: 2 } },
  'effects of a link': { surfaces: [SURFACE], samples: 16, ambientOcclusion: { radiusPx: 24, strength: 0.5 },
    silhouette: { widthPx: 3, color: { red: 1, green: 0, blue: 0, alpha: 1 } } },
  'a level by the distance of its samples': { surfaces: [SURFACE], level: { maxSpacingPx: 1.1 } },
  'the samples, by their number': { surfaces: [SURFACE], level: { level: 0 } },
  'a background': { surfaces: [SURFACE], backgroundColor: { red: 0.0431, green: 0.05, blue: 0.08, alpha: 1 } },
  'a transparent background': { surfaces: [SURFACE], backgroundColor: { red: 0, green: 0, blue: 0 } },
  'names of colours': stateFromHash('#surface=100:tomato:0.5&silhouette=2:#639&light=0,0,1:1:gold&background=#11223344').state,
  'names of datasets': { dataset: 'it\'s --help; $HOME', surfaces: [SURFACE] },
  'a dataset that begins as a flag does': { dataset: '--output', surfaces: [SURFACE] },
};

const WARM = { isovalue: 300, color: SURFACE.color };
/** Of a dataset with fields and steps. @type {Record<string, any>} */
const SERIES_STATES = {
  'a field and a step': { selection: { field: 'temperature', timeStep: 1 }, surfaces: [WARM] },
  'a component and a time': { selection: { field: 'velocity', component: 'x', time: 0.1 + 0.2 }, surfaces: [{ isovalue: -1e-3 }] },
  'the last step': { selection: { field: 'temperature', timeStep: -1 }, surfaces: [WARM] },
  'colours by a field': { selection: { field: 'temperature', timeStep: 0 }, surfaces: [{ ...WARM, colorBy: { quantity: 'QUANTITY_FIELD', field: 'pressure' } }] },
  'colours by a component': { selection: { field: 'temperature', timeStep: 0 }, surfaces: [{ ...WARM, colorBy: { quantity: 'QUANTITY_FIELD',
    field: 'velocity', component: 'magnitude', colorMap: 'COLOR_MAP_MAGMA', range: { min: -1e-7, max: 0.25 }, opacity: { atMin: 0.5, atMax: 1 } } }] },
};
SERIES_STATES['missing values'] = { ...SERIES_STATES['colours by a field'], nanColor: { red: 1, green: 0.5, blue: 0, alpha: 1 } };
const ALL_STATES = { ...STATES, ...SERIES_STATES };

test('no command has a flag that isoscope render does not have, and each flag is among those tried', () => {
  const { text } = run(['render', '--help-all']);
  const known = new Set(text.match(/(?<=^\s+(?:-\w, )?)--[a-z-]+/gm));
  assert.ok(known.has('--surface') && known.has('--output'), text);
  const printed = new Set(Object.values(ALL_STATES).flatMap((state) => wordsOf(commandOf(state))
    .filter((word) => /^--[a-z-]/.test(word)).map((word) => word.replace(/=.*/s, ''))));
  assert.deepEqual([...printed].filter((flag) => !known.has(flag)), []);
  assert.deepEqual(FLAGS.filter((name) => !printed.has(`--${name}`)), [], 'a flag that the page can print is not tried here');
});

for (const [name, state] of Object.entries(ALL_STATES)) {
  test(`the command draws a picture: ${name}`, () => {
    const words = wordsOf(commandOf(state));
    assert.deepEqual(words.slice(0, 3), ['render', '--server', 'HOST:50051']);
    // The volume in place of a server and its dataset.
    const rest = words.slice(3);
    if (state.dataset) {
      assert.deepEqual(rest.splice(0, 2), ['--dataset', state.dataset]);
    }
    const { status, text } = run(['render', name in SERIES_STATES ? flow : volume, '--renderer', 'cpu', ...rest]);
    assert.equal(status, 0, `${words.join(' ')}\n${text}`);
    assert.ok(existsSync(join(folder, 'picture.png')));
    rmSync(join(folder, 'picture.png'));
  });
}

test('the command of a file draws in its folder as it stands', () => {
  const words = wordsOf(stateToCommand({ dataset: 'gyroid-0123456789abcdef', surfaces: [SURFACE], samples: 4 }, 'picture.png', { width: 24, height: 16 },
    { file: basename(volume) }));
  const { status, text } = run([...words, '--renderer', 'cpu']);
  assert.equal(status, 0, text);
  assert.ok(existsSync(join(folder, 'picture.png')));
});

test('the command draws axes, scale bar, legend and caption over the picture', () => {
  const words = wordsOf(stateToCommand({ surfaces: [colored('POSITION_X')] }, 'drawn.png', { width: 240, height: 160 }, { file: basename(volume) },
    { axes: true, scaleBar: true, legend: true, caption: '-- it\'s at {isovalue}' }));
  const { status, text } = run([...words, '--renderer', 'cpu']);
  assert.equal(status, 0, text);
});

test('a film of pictures has the bytes of the film of the command line', async () => {
  const turn = ['render', volume, '--isovalue', '100', '--width', '40', '--height', '30', '--repeat', '3', '--orbit', '120', '--renderer', 'cpu'];
  for (const output of [['turn.apng', '--fps', '7.5'], ['turn-%d.png']]) {
    const { status, text } = run([...turn, '--output', ...output]);
    assert.equal(status, 0, text);
  }
  const writer = new ApngWriter({ frameCount: 3, framesPerSecond: 7.5 });
  for (let i = 0; i < 3; ++i) {
    writer.add(new Uint8Array(readFileSync(join(folder, `turn-${i}.png`))));
  }
  const film = Buffer.from(await writer.finish().arrayBuffer());
  assert.ok(film.equals(readFileSync(join(folder, 'turn.apng'))));
});

test('the command of a film draws its frames, of a turn and of steps', () => {
  const film = { format: 'apng', frameCount: 3, steps: [0, 1], framesPerSecond: 7.5, width: 40, height: 30 };
  const state = { surfaces: [{ ...SURFACE, color: undefined }], samples: 4, camera: CAMERA };
  for (const [kind, source, of, count] of [['turn', volume, state, 3], ['steps', flow, { selection: { field: 'temperature', timeStep: 1 }, surfaces: [WARM] }, 2]]) {
    const words = wordsOf(filmToCommand({ ...film, kind }, [0, 1], of, { file: basename(source) }, { axes: true }) ?? '');
    const { status, text } = run([...words, '--renderer', 'cpu']);
    assert.equal(status, 0, text);
    // Frames are counted by the chunk acTL: its length, its type, then their number.
    const drawn = readFileSync(join(folder, 'film.apng'));
    assert.equal(drawn.readUInt32BE(drawn.indexOf('acTL') + 4), count, kind);
    rmSync(join(folder, 'film.apng'));
  }
});

test('the command of a mesh writes it in each format, with its surfaces and cuts', () => {
  const surfaces = [{ ...SURFACE, color: { ...SURFACE.color, alpha: 0.4 } }, { isovalue: 140 }];
  for (const [format] of MESH_FORMATS) {
    const { status, text } = run(wordsOf(meshToCommand({ surfaces, clip: CLIP, samples: 4, camera: CAMERA, caps: {} }, format, { file: basename(volume) })));
    assert.equal(status, 0, text);
    assert.ok(readFileSync(join(folder, `mesh.${format}`)).length > 1000);
  }
  for (const [name, state] of Object.entries({ ...SERIES_STATES, labels: STATES['labels, one a set'], smooth: STATES['smooth labels'] })) {
    const { status, text } = run(wordsOf(meshToCommand(state, 'glb', { file: basename(name in SERIES_STATES ? flow : volume) })));
    assert.equal(status, 0, `${name}: ${text}`);
  }
});

test('the command of a server that asks for a token has a flag of the program for it', () => {
  assert.match(run(['render', '--help-all']).text, /--token-file/);
  assert.ok(wordsOf(stateToCommand({ surfaces: [SURFACE] }, 'a.png', undefined, { hasToken: true })).includes('--token-file'));
});

test('the program takes the dataset of the command as its value, whatever its name', () => {
  for (const dataset of ['--output', '-x', 'it\'s --help; $HOME']) {
    const words = wordsOf(commandOf({ dataset, surfaces: [SURFACE] }));
    // Nobody listens there: it gets as far as the connection.
    words[words.indexOf('HOST:50051')] = '127.0.0.1:1';
    const { status, text } = run([...words, '--timeout', '1']);
    assert.equal(status !== 0 && /127\.0\.0\.1:1/.test(text) && !/Usage/i.test(text), true, `${status}: ${text}`);
  }
});
