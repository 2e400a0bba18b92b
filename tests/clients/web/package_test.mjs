// The npm package: packed twice, unpacked as npm does, and used by a program and by a TypeScript program that know
// nothing else of this repository.
import assert from 'node:assert/strict';
import { spawn, spawnSync } from 'node:child_process';
import { mkdirSync, mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, test } from 'node:test';
import { fileURLToPath } from 'node:url';

const root = fileURLToPath(new URL('../../../', import.meta.url));
const folder = mkdtempSync(join(tmpdir(), 'isoscope-package-'));
after(() => rmSync(folder, { recursive: true, force: true }));

/** @param {string} program @param {string[]} words @param {string} [cwd] */
function run(program, words, cwd = folder) {
  const result = spawnSync(program, words, { cwd, encoding: 'utf8' });
  assert.equal(result.status, 0, `${program} ${words.join(' ')}\n${result.stdout}${result.stderr}`);
  return result.stdout;
}

/** @param {string} name of a folder for the tarball */
const pack = (name) => run('/usr/bin/python3', [join(root, 'scripts/package_web.py'), '--output', join(folder, name)]).trim();

const tarball = pack('first');
const installed = join(folder, 'node_modules', 'isoscope-view');
mkdirSync(installed, { recursive: true });
run('tar', ['-xzf', tarball, '--strip-components=1', '-C', installed]);
writeFileSync(join(folder, 'package.json'), '{"type": "module"}');

/** Runs a program of the folder that uses the package. @param {string} text */
function use(text) {
  writeFileSync(join(folder, 'use.mjs'), text);
  return JSON.parse(run('node', ['use.mjs']));
}

test('one tree gives one file, so that a package can be checked', () => {
  assert.deepEqual(readFileSync(pack('second')), readFileSync(tarball));
});

test('it has the version of the project, a licence and nothing of the page', () => {
  const manifest = JSON.parse(readFileSync(join(installed, 'package.json'), 'utf8'));
  assert.equal(manifest.name, 'isoscope-view');
  assert.equal(manifest.version, run('bash', [join(root, 'scripts/version.sh')]).trim());
  assert.equal(manifest.private, undefined, 'npm refuses to publish what is private');
  assert.deepEqual(readdirSync(installed).sort(),
    ['LICENSE', 'README.md', 'isoscope-view.d.ts', 'isoscope-view.js', 'json.d.ts', 'json.js', 'package.json', 'view']);
});

test('a program imports it by its name', () => {
  const of = use(`import * as isoscope from 'isoscope-view';
    const box = isoscope.boxOfDataset({ geometry: { sampleDims: { x: '11', y: '21', z: '31' }, spacing: { x: 1, y: 1, z: 1 } } });
    console.log(JSON.stringify({ names: Object.keys(isoscope), box, front: isoscope.namedCamera('front', box).target }));`);
  for (const name of ['mount', 'View', 'Client', 'default', 'NAMED_VIEWS']) {
    assert.ok(of.names.includes(name), name);
  }
  assert.deepEqual(of.box, { min: [0, 0, 0], max: [10, 20, 30] });
  assert.deepEqual(of.front, [5, 10, 15]);
});

test('its client asks a gateway', async () => {
  const gateway = spawn('node', [fileURLToPath(new URL('mock_gateway.mjs', import.meta.url))], { stdio: ['ignore', 'pipe', 'inherit'] });
  after(() => gateway.kill());
  const port = Number(await new Promise((resolve) => gateway.stdout.once('data', (bytes) => resolve(String(bytes)))));
  const of = use(`import { Client } from 'isoscope-view';
    globalThis.document = Object.assign(new EventTarget(), { hidden: false, visibilityState: 'visible', baseURI: 'http://127.0.0.1:${port}/' });
    const { datasets } = await new Client('http://127.0.0.1:${port}/').get('v1/datasets');
    let error;
    await new Client('http://127.0.0.1:${port}/').get('v1/datasets/none').catch((thrown) => { error = thrown.status; });
    console.log(JSON.stringify({ names: datasets.map((dataset) => dataset.name), error }));`);
  assert.ok(of.names.includes('ball'));
  assert.equal(of.error, 404);
});

// Each line below that is wrong says so; tsc fails on a line that is said to be wrong and is right.
const TYPED = `
import { mount, type View } from 'isoscope-view';
import type { Dataset, Label, OutputOptionsImageFormat, PickSurfaceResponse, RenderIsosurfaceRequest } from 'isoscope-view/json';

const format: OutputOptionsImageFormat = 'IMAGE_FORMAT_JPEG';
const request: RenderIsosurfaceRequest = { dataset: 'head', isovalue: 60, viewport: { widthPx: 640, heightPx: 480 },
  output: { imageFormat: format }, surfaces: [{ isovalue: 60, color: { red: 1, alpha: 0.5 } }] };
// @ts-expect-error there is no such field
const misspelt: RenderIsosurfaceRequest = { isovaleu: 60 };
// @ts-expect-error 64-bit integers are text
const seed: RenderIsosurfaceRequest = { raySeed: 7 };

const view: View = mount(document.body, { url: '/isoscope/', state: { dataset: 'head', surfaces: [{ isovalue: 60 }] }, axes: true });
view.setState({ dataset: 'head', clip: null });
// @ts-expect-error no option has this name
mount(document.body, { adress: '/isoscope/' });
// @ts-expect-error the picture's size is the view's own
view.setState({ viewport: { widthPx: 8 } });

export function describe(dataset: Dataset, picked: PickSurfaceResponse): string {
  const names: string[] = (dataset.labels ?? []).map((label: Label) => label.name ?? '');
  const low = Number(dataset.valueRange?.min ?? 0);
  return [...names, String(low), String(picked.points?.length ?? 0), String(request), String(misspelt), String(seed)].join();
}
`;

test('a TypeScript program uses its types', () => {
  writeFileSync(join(folder, 'typed.ts'), TYPED);
  for (const resolution of [{ module: 'node16', moduleResolution: 'node16' }, { module: 'es2022', moduleResolution: 'node' }]) {
    writeFileSync(join(folder, 'tsconfig.json'), JSON.stringify({ files: ['typed.ts'], compilerOptions: {
      strict: true, noEmit: true, target: 'es2022', lib: ['es2022', 'dom', 'dom.iterable'], types: [], ...resolution } }));
    run('tsc', ['--project', 'tsconfig.json']);
  }
});

test('the types have the comments of the protos', () => {
  const text = readFileSync(join(installed, 'json.d.ts'), 'utf8');
  assert.match(text, /\/\*\* Second component; finite\. \*\/\n  y\?: JsonNumber;/);
  assert.match(text, /export type Culling =\n {2}'CULLING_UNSPECIFIED'/);
});
