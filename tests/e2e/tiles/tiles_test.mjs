// Tiles, tilesets and manifests as other people's programs read them.
//
//     node tiles_test.mjs --bin build/dev/bin --modules FOLDER --schema proto/manifest.schema.json [--scans FOLDER]
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';
import { parseArgs } from 'node:util';
import { gunzipSync } from 'node:zlib';

import { ply, spherePoints } from '../browser/clouds.mjs';

const { values: options } = parseArgs({
    options: { bin: { type: 'string' }, modules: { type: 'string' }, schema: { type: 'string' }, scans: { type: 'string' } },
});
const modules = resolve(options.modules);
const folder = mkdtempSync(join(tmpdir(), 'stipple-tiles-'));
const require = createRequire(join(modules, 'package.json'));
const validator = require('gltf-validator');
const Ajv = require('ajv/dist/2020').default;
const load = (path) => import(pathToFileURL(join(modules, 'three', path)));
const THREE = await load('build/three.module.js');
const { GLTFLoader } = await load('examples/jsm/loaders/GLTFLoader.js');
const { MeshoptDecoder } = await load('examples/jsm/libs/meshopt_decoder.module.js');
const { readTile } = await importDecoder('glb_tile.js');
const fitsSchema = new Ajv({ allErrors: true }).compile(JSON.parse(readFileSync(options.schema, 'utf8')));

const run = (...args) => execFileSync(join(options.bin, 'stipple'), args, { stdio: ['ignore', 'pipe', 'inherit'] });

function written(name, points) {
    const file = join(folder, `${name}.ply`);
    const head = `ply\nformat ascii 1.0\nelement vertex ${points.length}\nproperty float x\nproperty float y\nproperty float z\nend_header\n`;
    writeFileSync(file, head + points.map((p) => `${p.join(' ')}\n`).join(''));
    return file;
}

function synthesized(...args) {
    const file = join(folder, 'synthetic.ply');
    run('synthesize', file, ...args, '--quiet');
    return file;
}

/** A decoder of the viewer, with three.js from the modules of the test. */
function importDecoder(name) {
    const source = readFileSync(new URL(`../../../viewer/src/decoding/${name}`, import.meta.url), 'utf8');
    const copy = join(folder, name.replace(/js$/, 'mjs'));
    writeFileSync(copy, source.replaceAll("'three/addons/", `'${pathToFileURL(join(modules, 'three/examples/jsm'))}/`));
    return import(pathToFileURL(copy));
}

function writtenWithAlpha() {
    const file = join(folder, 'alpha.ply');
    writeFileSync(file, ply(spherePoints(9000).map((place, i) => [...place, 200, 100, 50, i % 256]), true, { hasAlpha: true }));
    return file;
}

/** Half of the values are not finite. */
function writtenWithGaps() {
    const file = join(folder, 'gaps.ply');
    const head = 'ply\nformat ascii 1.0\nelement vertex 3000\nproperty float x\nproperty float y\nproperty float z\nproperty float value\nend_header\n';
    writeFileSync(file, head + spherePoints(3000).map((place, i) => `${place.join(' ')} ${['nan', '1.5', '-inf', '1.5', '1.5', 'nan'][i % 6]}\n`).join(''));
    return file;
}

const range = (n) => Array.from({ length: n }, (_, i) => i);
const clouds = {
    'one point': written('one', [[1, 2, 3]]),
    'a line': written('line', range(3000).map((i) => [i, 0, 0])),
    'a plane': written('plane', range(4000).map((i) => [i % 63, Math.floor(i / 63), 5])),
    'two clusters': written('clusters', range(4000).map((i) => [(i % 2) * 1e6 + Math.sin(i), Math.cos(1.7 * i), Math.sin(0.3 * i)])),
    'a point far off': written('far', [...range(3000).map((i) => [Math.sin(i), Math.cos(1.7 * i), Math.sin(0.3 * i)]), [1e4, 0, 0]]),
    'colours with alpha': writtenWithAlpha(),
    'values that are not finite': writtenWithGaps(),
    'a coloured scan': synthesized('--points', '60000'),
};
for (const scan of ['models/igea.ply', 'models/dragon_vrip.ply.gz', 'colour/frag_115.ply', 'lidar/small_gicp_target.ply', 'lidar/autzen_stadium_tile.ply.gz']) {
    const file = options.scans && join(options.scans, scan);
    if (file && existsSync(file)) clouds[scan] = scan.endsWith('.gz') ? unpacked(file) : file;
    else console.log(`SKIPPED: ${scan} is not here`);
}

function unpacked(packed) {
    const file = join(folder, `${Object.keys(clouds).length}.ply`);
    writeFileSync(file, gunzipSync(readFileSync(packed)));
    return file;
}

/** Calls visit(tile, box of the parent) for every tile of a tileset. */
function walk(tile, parent, visit) {
    visit(tile, parent);
    for (const child of tile.children ?? []) walk(child, tile, visit);
}

function bounds({ boundingVolume: { box } }) {
    const low = [0, 1, 2].map((k) => box[k] - box[3 + 4 * k]), high = [0, 1, 2].map((k) => box[k] + box[3 + 4 * k]);
    return { low, high, side: Math.max(...[0, 1, 2].map((k) => high[k] - low[k])) };
}

function isInside(place, { low, high, side }) {
    return [0, 1, 2].every((k) => place[k] >= low[k] - 1e-5 * side && place[k] <= high[k] + 1e-5 * side);
}

async function check(tile, bytes) {
    const report = await validator.validateBytes(new Uint8Array(bytes));
    const found = report.issues.messages.filter(({ severity }) => severity < 2);
    assert.deepEqual(found, [], 'the validator finds errors or warnings');

    const loader = new GLTFLoader().setMeshoptDecoder(MeshoptDecoder);
    const { scene } = await loader.parseAsync(new Uint8Array(bytes).buffer, '');
    scene.rotation.x = Math.PI / 2;  // as viewers of 3D Tiles do: y up becomes z up
    scene.updateMatrixWorld(true);
    let points = 0;
    scene.traverse((object) => {
        if (!object.isPoints) return;
        const position = object.geometry.getAttribute('position');
        const box = bounds(tile), at = new THREE.Vector3();
        points += position.count;
        for (let i = 0; i < position.count; ++i) {
            at.fromBufferAttribute(position, i).applyMatrix4(object.matrixWorld);
            assert.ok(isInside(at.toArray(), box), `point ${i} at ${at.toArray()} outside ${JSON.stringify(box)}`);
        }
    });
    assert.equal(points, tile.extras.points);
}

/** What the viewer reads: alpha is none of the attributes of the cloud. */
async function checkAlpha(bytes) {
    const { buffer } = new Uint8Array(bytes);
    const { colors, attributes } = await readTile(buffer);
    assert.deepEqual(Object.keys(attributes), []);
    assert.deepEqual([...colors.subarray(0, 3)], [200, 100, 50]);
}

/** What the viewer reads: where there was no value it has none, though glTF has a number there. */
async function checkGaps(bytes) {
    const { attributes: { value: { values } } } = await readTile(new Uint8Array(bytes).buffer);
    assert.ok(values.some(Number.isNaN) && values.every((value) => Number.isNaN(value) || value === 1.5));
}

/** The tiles together are where the cloud is; what is far off, as floats tell. */
function checkPlace({ transform }, tiles, { min, max }, rounding) {
    for (const k of [0, 1, 2]) {
        const near = (told, is) => assert.ok(Math.abs(told - is) <= rounding + 2 ** -24 * (max[k] - min[k]), `axis ${k}: ${told}, not ${is}`);
        near(transform[12 + k] + Math.min(...tiles.map((tile) => bounds(tile).low[k])), min[k]);
        near(transform[12 + k] + Math.max(...tiles.map((tile) => bounds(tile).high[k])), max[k]);
    }
}

const pyramids = Object.entries(clouds).map(([name, file]) => ({ name, file, by: [] }));
for (const method of ['multiphase', 'iterative', 'particles', 'incremental', 'voxel', 'random'])
    pyramids.push({ name: `a plane, ${method}`, file: clouds['a plane'], by: ['--method', method] });
let failed = 0;
for (const { name, file, by } of pyramids) {
    try {
        const out = join(folder, 'pyramid');
        run('pyramid', file, out, '--base-points', '1000', '--tile-points', '8000', '--tile-attributes', '--quiet', ...by);
        const manifest = JSON.parse(readFileSync(join(out, 'manifest.json'), 'utf8'));
        assert.ok(fitsSchema(manifest), JSON.stringify(fitsSchema.errors, null, 1));
        const tiles = [];
        const { root } = JSON.parse(readFileSync(join(out, 'tileset.json'), 'utf8'));
        walk(root, null, (tile, parent) => {
            assert.ok(tile.geometricError > 0 && bounds(tile).side > 0);
            if (parent) assert.ok(tile.geometricError <= parent.geometricError);
            if (tile.content) tiles.push(tile);
        });
        // A point alone is the same tile of each level.
        const files = new Set(tiles.map((tile) => tile.content.uri));
        assert.equal(files.size, readdirSync(out).filter((entry) => entry.endsWith('.glb')).length);
        const finest = tiles.filter(({ children }) => !children);
        const step = Math.max(...manifest.levels.at(-1).files.map(({ tile }) => tile?.step ?? 0));
        checkPlace(root, finest, manifest.source.bounds, 1.5 * step);
        for (const tile of tiles) {
            const bytes = readFileSync(join(out, tile.content.uri));
            await check(tile, bytes);
            if (name === 'colours with alpha') await checkAlpha(bytes);
            if (name === 'values that are not finite') await checkGaps(bytes);
        }
        console.log(`ok    ${name}: ${tiles.length} tiles`);
        rmSync(out, { recursive: true });
    } catch (error) {
        ++failed;
        console.log(`FAILED ${name}: ${error.stack}`);
    }
}
const broken = { schema: 'stipple-pyramid/1', complete: 'yes', request: {}, levels: [{}] };
if (fitsSchema(broken)) {
    ++failed;
    console.log('FAILED the schema takes a manifest that is none');
}
rmSync(folder, { recursive: true, force: true });
process.exit(failed ? 1 : 0);
