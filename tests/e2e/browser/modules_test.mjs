// What of the viewer needs no browser. Exits 0 or 1.
//
//     node modules_test.mjs --viewer viewer [--modules viewer/node_modules]
import assert from 'node:assert/strict';
import { resolve } from 'node:path';
import { test } from 'node:test';
import { pathToFileURL } from 'node:url';
import { parseArgs } from 'node:util';

import { spherePoints } from './clouds.mjs';

const { values: options } = parseArgs({ options: { viewer: { type: 'string' }, modules: { type: 'string' } }, strict: false });
const moduleOf = (name) => import(pathToFileURL(resolve(options.viewer, 'src', name)));

/** As build.mjs puts them into the page. */
async function shippedForms() {
    const { jobForms } = await import(pathToFileURL(resolve(options.viewer, 'job_forms.mjs')));
    return jobForms(resolve(options.viewer, '../openapi.yaml'), resolve(options.modules ?? resolve(options.viewer, 'node_modules')));
}

const floatOf = (value) => Buffer.from(Float32Array.of(value).buffer);

test('Estimated normals of a sphere point along its radius', async () => {
    const { estimateSurface } = await moduleOf('loading/surface_estimate.js');
    const points = spherePoints(3000);
    const surface = estimateSurface(Float32Array.from(points.flat()), null, 0.06);
    points.forEach((point, i) => {
        const along = point.reduce((sum, x, k) => sum + x * surface[4 * i + k], 0) / 32767;
        assert.ok(Math.abs(along) > Math.cos(2 * Math.PI / 180), `point ${i}: cosine ${along}`);
    });
});

test('Normals that are zero are estimated, others are kept', async () => {
    const { estimateSurface } = await moduleOf('loading/surface_estimate.js');
    const points = spherePoints(3000);
    const normals = new Float32Array(3 * points.length);  // as files of Gaussian splats have them
    normals.set([1, 0, 0], 3 * 7);
    const surface = estimateSurface(Float32Array.from(points.flat()), normals, 0.06);
    const along = (i, [x, y, z]) => Math.abs(x * surface[4 * i] + y * surface[4 * i + 1] + z * surface[4 * i + 2]) /
        Math.hypot(surface[4 * i], surface[4 * i + 1], surface[4 * i + 2]);
    points.forEach((point, i) => assert.ok(along(i, i === 7 ? [1, 0, 0] : point) > 0.999, `point ${i}`));
});

test('A point far off does not stretch the spacing, and many points in one place take no time', async () => {
    const { estimateSurface, robustSpacing } = await moduleOf('loading/surface_estimate.js');
    const points = Float32Array.from([...spherePoints(20_000), [1e8, 0, 0]].flat());
    const spacing = robustSpacing(points, 5000);
    assert.ok(spacing > 0.01 && spacing < 0.06, `spacing ${spacing}`);
    assert.equal(robustSpacing(points, 0.02), 0.02);
    const start = performance.now();
    estimateSurface(new Float32Array(3 * 50_000), null, 1);
    assert.ok(performance.now() - start < 15_000);
});

test('Points whose cells no number tells from the next are met, too', async () => {
    const { estimateSurface } = await moduleOf('loading/surface_estimate.js');
    const points = [...spherePoints(1000), [3e13, 0, 0], [0, -3e13, 0], [0, 0, 3e20]];
    const surface = estimateSurface(Float32Array.from(points.flat()), null, 0.0003);
    assert.equal(surface.length, 4 * points.length);
});

test('Opposite points of a random sphere are no neighbours', async () => {
    const { estimateSurface } = await moduleOf('loading/surface_estimate.js');
    const fraction = (i, step) => (i * step) % 1;
    const points = Array.from({ length: 20_000 }, (_, i) => {
        const z = 1 - 2 * fraction(i, 0.7548776662466927), angle = 2 * Math.PI * fraction(i, 0.5698402909980532);
        const radius = Math.sqrt(1 - z * z);
        return [radius * Math.cos(angle), radius * Math.sin(angle), z];
    });
    const surface = estimateSurface(Float32Array.from(points.flat()), null, 0.5 * Math.sqrt(4 * Math.PI / points.length));
    const wrong = points.filter((point, i) => Math.abs(point.reduce((sum, x, k) => sum + x * surface[4 * i + k], 0)) < 0.8 * 32767);
    assert.equal(wrong.length, 0);
});

test('Splats leave no gap between points that stand in bunches', async () => {
    const { estimateSurface, kLargestRadius } = await moduleOf('loading/surface_estimate.js');
    const side = 12, spacing = 0.2;
    const bunch = Array.from({ length: 7 }, (_, i) => (i === 0 ? [0, 0] : [spacing * Math.cos(i * Math.PI / 3), spacing * Math.sin(i * Math.PI / 3)]));
    const points = Array.from({ length: side * side }, (_, i) => [i % side, Math.floor(i / side)])
        .flatMap(([x, y]) => bunch.map(([dx, dy]) => [x + dx, y + dy, 0]));
    const surface = estimateSurface(Float32Array.from(points.flat()), null, spacing);
    const radius = (i) => kLargestRadius * spacing * surface[4 * i + 3] / 32767;
    for (const [x, y] of [[5.5, 5.5], [5.5, 5], [5, 5.5]]) {
        assert.ok(points.some(([px, py], i) => Math.hypot(px - x, py - y) < radius(i)), `a gap at ${x}, ${y}`);
    }
});

test('Splats close a part that is much sparser than the rest, but for a few strays', async () => {
    const { estimateSurface, kLargestRadius } = await moduleOf('loading/surface_estimate.js');
    const spacing = 0.01, gap = 0.3;
    const sheet = (side, step) => Array.from({ length: side * side }, (_, i) => [step * (i % side), step * Math.floor(i / side), 0]);
    const sparse = sheet(30, gap).map(([x, y, z]) => [x + 5, y, z]);
    const strays = [[0, 0, 40], [0, 40, 40], [40, 0, 40]];
    const radiiOf = (points) => {
        const surface = estimateSurface(Float32Array.from(points.flat()), null, spacing);
        return points.map((_, i) => kLargestRadius * spacing * surface[4 * i + 3] / 32767);
    };
    const radii = radiiOf([...sheet(100, spacing), ...sparse]).slice(-sparse.length);
    assert.ok(Math.min(...radii) > gap / Math.sqrt(2) && Math.max(...radii) < 3 * gap, `radii ${Math.min(...radii)} to ${Math.max(...radii)}`);
    assert.ok(Math.max(...radiiOf([...sheet(100, spacing), ...strays])) < 3 * spacing);
});

test('A spacing that is not told is that of most points, and of one place none', async () => {
    const { robustSpacing } = await moduleOf('loading/surface_estimate.js');
    const points = Float32Array.from({ length: 300 }, (_, k) => (k % 3 === 0 ? k / 3 : 0));
    assert.equal(robustSpacing(points, 0), 1);
    assert.equal(robustSpacing(new Float32Array(30), 0), 0);
});

test('A PLY file that is written is read as it was, doubles and attributes of several values too', async () => {
    const { plyOf, readPly } = await moduleOf('decoding/ply_cloud.js');
    const cloud = {
        count: 2, origin: [5e6, 0, -3], positions: Float32Array.of(0.25, 1, 2, 3, 4, 5, 9, 9, 9), normals: Float32Array.of(0, 0, 1, 0, 1, 0),
        colors: Uint8Array.of(1, 2, 3, 4, 5, 6), colorComponents: 3,
        attributes: [
            { name: 'axis', type: 'float32', components: 3, values: [0, 1, 2, 3, 4, 5] }, { name: 'class', type: 'uint16', components: 1, values: [7, 65_535] },
            { name: 'object', type: 'uint32', components: 1, values: [4_000_000_001, 4_000_000_002] },
        ],
    };
    const read = readPly(plyOf(cloud).buffer);
    assert.deepEqual([...read.positions], [5e6 + 0.25, 1, -1, 5e6 + 3, 4, 2]);
    assert.deepEqual(read.normals, cloud.normals);
    assert.deepEqual([...read.colors], [1, 2, 3, 255, 4, 5, 6, 255]);
    assert.deepEqual(Object.keys(read.attributes), ['axis', 'class', 'object']);
    assert.deepEqual([...read.attributes.object.values], [4_000_000_001, 4_000_000_002]);
    assert.deepEqual([...read.attributes.axis.values, ...read.attributes.class.values], [0, 1, 2, 3, 4, 5, 7, 65_535]);
    assert.throws(() => readPly(plyOf(cloud).buffer.slice(0, -1)), /ends before/);
});

test('Lists of a PLY file are read whatever integers count them', async () => {
    const { readPly } = await moduleOf('decoding/ply_cloud.js');
    const counts = { char: 'Int8', uint8: 'UInt8', short: 'Int16LE', uint16: 'UInt16LE', int: 'Int32LE', uint32: 'UInt32LE' };
    for (const [type, kind] of Object.entries(counts)) {
        const header = ['ply', 'format binary_little_endian 1.0', 'element vertex 2', ...['x', 'y', 'z'].map((name) => `property float ${name}`),
            `property list ${type} float embedding`, 'property ushort class', 'end_header', ''].join('\n');
        const row = ([x, y, z, a, b, number]) => {
            const count = Buffer.alloc(parseInt(kind.match(/\d+/)[0], 10) / 8);
            count[`write${kind}`](2);
            return [...[x, y, z].map(floatOf), count, floatOf(a), floatOf(b), Buffer.from(Uint16Array.of(number).buffer)];
        };
        const { buffer } = Uint8Array.from(Buffer.concat([Buffer.from(header), ...row([1, 2, 3, 4, 5, 6]), ...row([7, 8, 9, 10, 11, 12])]));
        const { positions, attributes } = readPly(buffer);
        assert.deepEqual([...positions], [1, 2, 3, 7, 8, 9], type);
        assert.deepEqual(attributes.embedding, { values: Float32Array.of(4, 5, 10, 11), components: 2 }, type);
        assert.deepEqual([...attributes.class.values], [6, 12], type);
    }
});

test('A stream is taken in small pieces without being copied for each', async () => {
    const { ProgressiveDecoder } = await moduleOf('decoding/progressive_cloud.js');
    const stream = new Uint8Array(2 ** 20 - 1);  // of which the header lacks one byte
    const decoder = new ProgressiveDecoder();
    stream.set([0x53, 0x54, 0x50, 0x43, 3, 0, 0, 0, 0, 0, 16, 0]);
    let copies = 0;
    for (let at = 0; at < stream.length; at += 2048) {
        const { buffer } = decoder.pending;
        decoder.feed(stream.subarray(at, at + 2048));
        copies += decoder.pending.buffer === buffer ? 0 : 1;
    }
    assert.ok(copies < 20, `${copies} copies`);
    assert.deepEqual(decoder.pending, stream);
});

test('A splat reaches where the cells of its neighbours meet, and not much farther', async () => {
    const { estimateSurface, kLargestRadius } = await moduleOf('loading/surface_estimate.js');
    const side = 40;
    const points = Array.from({ length: side * side }, (_, i) => [i % side + 0.5 * (Math.floor(i / side) % 2), Math.sqrt(0.75) * Math.floor(i / side), 0]);
    const surface = estimateSurface(Float32Array.from(points.flat()), null, 1);
    const middle = side * side / 2 + side / 2;
    const radius = kLargestRadius * surface[4 * middle + 3] / 32767;
    assert.ok(radius > Math.sqrt(1 / 3) && radius < 1, `radius ${radius}`);  // of hexagons of width 1
});

test('Splats of evenly spaced points leave no gap at a border, and reach little beyond it', async () => {
    const { estimateSurface, kLargestRadius } = await moduleOf('loading/surface_estimate.js');
    const side = 40, row = Math.sqrt(0.75);
    const points = Array.from({ length: side * side }, (_, i) => [i % side + 0.5 * (Math.floor(i / side) % 2), row * Math.floor(i / side), 0]);
    const surface = estimateSurface(Float32Array.from(points.flat()), null, 1);
    const radius = (i) => kLargestRadius * surface[4 * i + 3] / 32767;
    for (let x = 2; x < side - 2; x += 1) {
        assert.ok(radius(x) < 1.3, `point ${x}: radius ${radius(x)}`);
        for (const [px, py] of [[x + 0.5, 0], [x + 0.5, row / 3], [x, 2 * row / 3]]) {
            assert.ok(points.some(([qx, qy], i) => Math.hypot(qx - px, qy - py) < radius(i)), `a gap at ${px}, ${py}`);
        }
    }
});

test('The two sides of a thin wall are planes where their normals tell them apart', async () => {
    const { estimateSurface } = await moduleOf('loading/surface_estimate.js');
    const side = 40;
    const points = [0, 1].flatMap((z) => Array.from({ length: side * side }, (_, i) => [i % side, Math.floor(i / side), z]));
    const shortest = (normalOf) => {
        const surface = estimateSurface(Float32Array.from(points.flat()), Float32Array.from(points.flatMap(normalOf)), 1);
        return Math.min(...points.map((_, i) => Math.hypot(...surface.subarray(4 * i, 4 * i + 3)) / 32767));
    };
    assert.ok(shortest(([, , z]) => [0, 0, 2 * z - 1]) > 0.99);
    assert.ok(shortest(() => [0, 0, 1]) < 0.9);
});

test('Where neighbours lie all around, as in leaves, a normal says that it is in doubt, given or not', async () => {
    const { estimateSurface } = await moduleOf('loading/surface_estimate.js');
    const fraction = (i, step) => (i * step) % 1;
    const inside = Array.from({ length: 4000 }, (_, i) => [fraction(i, 0.8191725), fraction(i, 0.6710436), fraction(i, 0.5497005)]);
    const up = Float32Array.from({ length: 3 * inside.length }, (_, k) => (k % 3 === 2 ? 1 : 0));
    const meanLength = (points, normals, spacing) => {
        const surface = estimateSurface(Float32Array.from(points.flat()), normals, spacing);
        return points.reduce((sum, _, i) => sum + Math.hypot(...surface.subarray(4 * i, 4 * i + 3)) / 32767, 0) / points.length;
    };
    assert.ok(meanLength(inside, up, 0.05) < 0.35);
    assert.ok(meanLength(inside, null, 0.05) < 0.7);
    assert.ok(meanLength(spherePoints(3000), null, 0.06) > 0.99);
});

test('Of a tree of tiles those are drawn that are fine enough, and coarser ones until all of these are there', async () => {
    const { select, treeOf } = await moduleOf('loading/tile_tree.js');
    const json = (error, children = []) => ({
        boundingVolume: { box: [children.length, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1] }, geometricError: 100,
        content: { uri: `${error}.glb` }, extras: { error: { p99: error }, spacing: 1 }, children,
    });
    const root = treeOf(json(8, [json(4), json(3, [json(1), json(1)])]));
    const [left, right] = root.children;
    const view = { sees: () => true, errorOf: (tile) => tile.error, pixels: 2, coarsestLevel: 0, finestLevel: 9, now: 1 };
    const load = (...tiles) => tiles.forEach((tile) => Object.assign(tile, { state: 'ready', cloud: {} }));
    const chosen = (changes) => select(root, { ...view, ...changes });

    assert.deepEqual(chosen().wanted, [root, left, right, ...right.children]);
    load(root, left, right);
    assert.deepEqual(chosen(), { drawn: [left, right], wanted: right.children });
    load(right.children[0]);
    assert.deepEqual(chosen().drawn, [left, right]);
    load(right.children[1]);
    assert.deepEqual(chosen(), { drawn: [left, ...right.children], wanted: [] });
    assert.deepEqual(chosen({ finestLevel: 1 }).drawn, [left, right]);
    assert.deepEqual(chosen({ pixels: 9 }).drawn, [root]);
    assert.deepEqual(chosen({ pixels: 9, coarsestLevel: 1 }).drawn, [left, right]);
    assert.deepEqual(chosen({ sees: (tile) => tile !== left }).drawn, right.children);
    right.measured.mean = 5;
    assert.deepEqual(chosen({ pixels: 9, coarsestLevel: 1, bound: 4 }).drawn, [left, ...right.children]);
    assert.deepEqual(chosen({ pixels: 9, coarsestLevel: 1, bound: 5 }).drawn, [left, right]);
});

test('Tiles of a group without content are chosen as if they stood in its place', async () => {
    const { select, treeOf } = await moduleOf('loading/tile_tree.js');
    const boundingVolume = { box: [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1] };
    for (const refine of ['REPLACE', 'ADD']) {
        const json = (error, children = []) => ({
            boundingVolume, geometricError: error, refine, content: { uri: `${error}.glb` },
            extras: { error: { p99: error }, spacing: error / 10 }, children,
        });
        const group = (children) => ({ boundingVolume, geometricError: 0.1, refine, children });
        const root = treeOf(group([json(8, [json(4), group([json(3), json(2)])])]));
        const [top] = root.children, [left, { children: members }] = top.children;
        const view = { sees: () => true, errorOf: (tile) => tile.error, pixels: 3.5, coarsestLevel: 0, finestLevel: 1, now: 1 };
        assert.deepEqual([top, left, ...members].map((tile) => tile.level), [0, 1, 1, 1]);
        const all = [top, left, ...members].map((tile) => Object.assign(tile, { state: 'ready', cloud: {} }));
        const adds = refine === 'ADD';
        assert.deepEqual(select(root, view), { drawn: adds ? all : all.slice(1), wanted: [] });
        assert.deepEqual(select(root, { ...view, finestLevel: 0 }).drawn, [top]);
        members[1].cloud = null;
        members[1].state = 'listed';
        const { drawn, wanted } = select(root, view);
        assert.deepEqual({ drawn, wanted }, { drawn: adds ? all.slice(0, 3) : [top], wanted: [members[1]] });
        if (adds) assert.equal(top.isLast, true);  // a member of the group is not there yet
    }
});

test('A stream stands for the levels that have not come before it, but not where tiles show a large one by view', async () => {
    globalThis.location = new URL('http://host/?whole=1000');
    const { isByTiles, kMostPoints, withStream } = await moduleOf('loading/level_plan.js');
    const level = (number, points, ...formats) => ({ level: number, points, files: formats.map((format) => ({ format })) });
    const coarse = level(0, 500, 'drc', 'glb'), fine = level(1, 900, 'drc', 'glb', 'stpc'), large = level(1, 2000, 'drc', 'glb', 'glb', 'stpc');
    assert.deepEqual([coarse, fine, large, level(0, 2000, 'glb'), level(1, 2000, 'drc')].map(isByTiles), [false, false, true, false, false]);
    assert.equal(withStream([coarse, fine], true), fine);
    assert.equal(withStream([fine], false), fine);
    assert.equal(withStream([coarse], true), undefined);  // it comes with the last one
    assert.equal(withStream([coarse, large], true), undefined);
    const untiled = level(1, kMostPoints + 1, 'drc', 'stpc');
    assert.equal(withStream([untiled], true), untiled);  // as far as a browser's memory goes
    assert.equal(withStream([untiled], false), undefined);
});

test('The error of tiles is the mean over their surface, and the largest of any', async () => {
    const { errorOfTiles, treeOf } = await moduleOf('loading/tile_tree.js');
    const tile = (points, spacing, error, refine = 'REPLACE') => treeOf({
        boundingVolume: { box: [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1] }, refine, extras: { points, spacing, error },
    });
    const coarse = tile(100, 2, { mean: 4, max: 9, meanConfidence: 0.3 }), fine = tile(400, 0.5, { mean: 1, max: 12, meanConfidence: 1.6 });
    assert.deepEqual(errorOfTiles([coarse, fine], 10), { mean: (400 * 4 + 100 * 1) / 500 / 10, confidence: 200 / 500 / 10, max: 1.2 });
    assert.equal(errorOfTiles([], 10), null);
    assert.equal(errorOfTiles([coarse, tile(100, 2)], 10), null);
    // Of tiles that add to others those that have nothing added to them, all above included.
    const above = Object.assign(tile(100, 2, { mean: 8, max: 20 }, 'ADD'), { isLast: false });
    assert.deepEqual(errorOfTiles([above, tile(100, 1, { mean: 2, max: 5 }, 'ADD')], 10), { mean: 0.2, confidence: 0, max: 0.5 });
});

test('Of tiles that add to each other a tile is drawn with those above it, in splats as small as theirs', async () => {
    const { select, treeOf } = await moduleOf('loading/tile_tree.js');
    const json = (error, children = []) => ({
        boundingVolume: { box: [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1] }, geometricError: 100, refine: 'ADD',
        content: { uri: `${error}.glb` }, extras: { error: { p99: error }, spacing: error / 10 }, children,
    });
    const root = treeOf(json(8, [json(4), json(3, [json(1)])]));
    const [left, right] = root.children, [finest] = right.children;
    const view = { sees: () => true, errorOf: (tile) => tile.error, pixels: 2, coarsestLevel: 0, finestLevel: 9, now: 1 };
    const load = (...tiles) => tiles.forEach((tile) => Object.assign(tile, { state: 'ready', cloud: {} }));

    assert.deepEqual(select(root, view), { drawn: [], wanted: [root] });
    load(root);
    assert.deepEqual(select(root, view), { drawn: [root], wanted: [left, right] });
    assert.equal(root.shownSpacing, 0.8);
    load(left);
    select(root, view);
    assert.deepEqual([root.isLast, left.isLast], [true, true]);  // in a part of it nothing is added yet
    load(left, right, finest);
    assert.deepEqual(select(root, view), { drawn: [root, left, right, finest], wanted: [] });
    assert.deepEqual([root, left, right, finest].map((tile) => tile.shownSpacing), [0.4, 0.4, 0.1, 0.1]);
    assert.deepEqual([root, left, right, finest].map((tile) => tile.isLast), [false, true, false, true]);
    assert.deepEqual(select(root, { ...view, finestLevel: 1 }).drawn, [root, left, right]);
    assert.deepEqual(select(root, { ...view, pixels: 9 }).drawn, [root]);
});

test('A mean that was estimated is no bound, unless what its file rounds is much more than what it may be off by', async () => {
    const { errorText, intervalText, wholeErrorOf } = await moduleOf('loading/level_error.js');
    const levelOf = (mean, half, rounding, samples = 100) => ({
        file: { error: { mean: mean + rounding, max: 1 } },
        error: { mean, diagonal: 1, relative: { mean, max: 1 }, forward: { samples, relative: { mean_confidence: half } } },
    });
    const told = (level, how) => errorText(wholeErrorOf(level), how).replaceAll('\u00a0', ' ');
    assert.equal(told(levelOf(0.002, 0.000312, 1e-5)), '0.201 % \u00b1 0.031 %');
    assert.equal(told(levelOf(0.002, 0.000312, 1e-5), { isShort: true }), '\u2248 0.201 %');
    assert.equal(told(levelOf(0.002, 0.0015, 1e-5)), '\u2248 0.201 %');  // of few samples that met an error
    assert.equal(told(levelOf(0.002, 0, 1e-5, 1)), '\u2248 0.201 %');  // of one
    assert.equal(told(levelOf(0.002, 1e-5, 0.001)), '\u2264 0.3 %');
    assert.equal(told(levelOf(0, 0, 0.001, 0)), '\u2264 0.1 %');
    assert.equal(told({ ...levelOf(0.002, 0.0001, 0), file: undefined }), '0.2 % \u00b1 0.01 %');
    assert.equal(told({ error: { relative: { mean: 0.002 } } }), '0.2 %');  // of a stream
    assert.equal(intervalText({ mean: 0.002, confidence: Infinity }), '');
});

test('What comes packed counts as it came over the line', async () => {
    pretendBrowser({ storage: () => ({ getItem: () => null }) });
    const { getBytes } = await moduleOf('api/api.js');
    const headers = { 'Content-Encoding': 'br', 'Content-Length': '400' };
    for (const [sent, expected] of [[headers, 400], [{ 'Content-Length': '1000' }, 1000], [{ 'Content-Encoding': 'br' }, 1000]]) {
        globalThis.fetch = async () => new Response(new Uint8Array(1000), { headers: sent });
        let [unpacked, onLine] = [0, 0];
        const buffer = await getBytes('v1/file', undefined, (bytes, came) => {
            unpacked += bytes;
            onLine += came;
        });
        assert.deepEqual([buffer.byteLength, unpacked, onLine], [1000, 1000, expected]);
    }
});

test('The ends of a range differ, and are told in one notation', async () => {
    const { ends } = await moduleOf('page/format.js');
    assert.deepEqual(ends(5_247_003.6, 5_247_297.2), ['5,247,004', '5,247,297']);
    assert.deepEqual(ends(300_000_096, 300_009_920), ['300,000,096', '300,009,920']);
    assert.deepEqual(ends(7.2e-7, 0.000156), ['0.000001', '0.000156']);
    assert.deepEqual(ends(-0.9812, 0.98), ['\u22120.98', '0.98']);
    assert.deepEqual(ends(-1.5e30, 2e30), ['\u22121.50e+30', '2.00e+30']);
    assert.deepEqual(ends(-1e-9, 1), ['0', '1']);
    assert.deepEqual(ends(5, 5), ['5', '5']);
    assert.deepEqual(ends(1_700_000_038_912, 1_700_900_000_000, 200_000), ['1,700,000,000,000', '1,700,900,000,000']);
    assert.deepEqual(ends(123_456.789, 123_456.912, 2 ** -6), ['123,456.79', '123,456.91']);
});

test('A value has the digits that it has', async () => {
    const { value } = await moduleOf('page/format.js');
    assert.equal(value(1_300_000_047), '1,300,000,047');
    assert.equal(value(1_300_000_123.5), '1,300,000,123.5');
    assert.equal(value(Math.fround(0.1)), '0.1');
    assert.equal(value(-2), '\u22122');
    assert.equal(value(2e-9), '2.00e\u22129');
    assert.equal(value(1_700_000_038_912, 200_000), '\u2248\u00a01,700,000,000,000');
    assert.equal(value(1_300_000_047, 1), '\u2248\u00a01,300,000,047');
    assert.equal(value(0, 1), '\u2248\u00a00');
    assert.equal(value(1.5, 2 ** -22), '1.5');
});

test('A share of points is two numbers where they differ as they are shown', async () => {
    const { compactShare, share, ago } = await moduleOf('page/format.js');
    assert.equal(compactShare(435_545, 437_645), '436K of 438K');
    assert.equal(compactShare(1_268_065, 1_268_079), '1.27M');
    assert.equal(share(312_000, 2_000_000), '312K of 2M');
    assert.equal(share(2_000_000, 2_000_000), '2,000,000');
    const now = Date.parse('2030-01-01T00:01:00Z');
    assert.deepEqual([50_000, 70_000].map((past) => ago(new Date(now - past).toISOString(), now)), Array(2).fill('1 minute ago'));
});

test('Results are called by what was asked for, so that one is told from the next', async () => {
    const { summaryOf } = await moduleOf('clouds/library.js');
    const named = (type, request) => summaryOf({ type, request }).replaceAll('\u00a0', ' ');
    const simplified = (target) => named('simplify', { ...target, method: 'voxel' });
    assert.equal(simplified({ points: 2000 }), '2,000 points, voxel');
    assert.equal(simplified({ ratio: 0.1 }), '10 % of the points, voxel');
    assert.equal(simplified({ max_error: '0.1%' }), 'Within 0.1%, voxel');
    const bounds = ['max_cluster_size', 'max_variation', 'voxel_size'];
    assert.equal(new Set(bounds.map((bound) => simplified({ [bound]: 0.2 }))).size, bounds.length);
    assert.equal(named('upsample', { points: 5000 }), '5,000 points');
    assert.equal(named('upsample', { ratio: 4 }), '4 × the points');
    const built = (...formats) => summaryOf({ type: 'pyramid', levels_ready: 5, request: { formats, method: 'voxel' } });
    assert.deepEqual([built('stpc', 'copc.laz'), built('drc', 'stpc'), built('drc', 'glb'), built('copc.laz')],
        ['Stream', '5 levels, stream', '5 levels, voxel', 'COPC']);
});

test('Few whole numbers are categories: classes by their names, others by themselves, each with a colour of its own', async () => {
    const { categoriesOf } = await moduleOf('drawing/categories.js');
    const classes = categoriesOf('classification', [2, 6, 2, 5, 42]);
    assert.deepEqual(classes.values.map(classes.nameOf), ['Ground', 'High vegetation', 'Building', '42']);
    for (const values of [[1, 2, 3], [0, 12, 24], [-1, 0]]) {
        const labels = categoriesOf('label', values);
        assert.equal(new Set(values.map(labels.colorOf)).size, values.length);
    }
    for (const others of [[1], [1, 2], [15, 27]]) {
        assert.equal(categoriesOf('label', [3, ...others]).colorOf(3), categoriesOf('label', [3]).colorOf(3));
    }
    assert.equal(categoriesOf('height', [1, 2.5]), null);
    assert.equal(categoriesOf('intensity', Array.from({ length: 200 }, (_, i) => i)), null);
    assert.equal(categoriesOf('empty', []), null);
});

test('The lines for other programs name the result, and are complete', async () => {
    const { kPrograms } = await moduleOf('cards/program_lines.js');
    const AsyncFunction = (async () => {}).constructor;
    const result = { server: 'https://levels.example', id: '0123abcd', hasKey: false };
    for (const part of [{ collection: 'pyramids', manifest: 'manifest.json' }, { collection: 'jobs', manifest: 'results' }]) {
        for (const { name, needs, linesFor } of kPrograms) {
            const lines = linesFor({ ...result, ...part });
            assert.ok(lines.includes(`https://levels.example/v1/${needs === 'glb' ? 'pyramids' : part.collection}/0123abcd/`), name);
            if (name !== 'curl') {
                assert.doesNotThrow(() => new AsyncFunction('viewer', 'scene', 'camera', 'renderer', lines.replace(/^import .*$/gm, '')), name);
            }
        }
    }
    const { linesFor: forCesium } = kPrograms.find(({ name }) => name === 'Cesium');
    for (const isPlaced of [false, true]) {
        const lines = forCesium({ ...result, isPlaced });
        const [imports] = lines.split('\n');
        assert.equal(lines.includes('modelMatrix'), !isPlaced);
        assert.ok(lines.includes('/0123abcd/tileset.json?error=spacing\''), lines);
        for (const [name] of imports.matchAll(/\b[CT]\w+/g)) {
            assert.ok(lines.slice(imports.length).includes(`${name}.`), `${name} is imported for nothing`);
        }
        assert.doesNotThrow(() => new AsyncFunction('viewer', lines.replace(/^import .*$/gm, '')));
    }
    const { linesFor } = kPrograms.find(({ name }) => name === 'curl');
    assert.match(linesFor({ ...result, collection: 'jobs', manifest: 'results', hasKey: true }), /Bearer \$/);
});

test('The address of another result says nothing of the one before, and keeps the rest', async () => {
    globalThis.location = new URL('http://host/scans/?whole=1000&pyramid=abc&level=2&view=1,2,3,0,0,0#there');
    const { addressOf, readAddress } = await moduleOf('page/address.js');
    assert.equal(readAddress().chosen, 1);
    assert.equal(addressOf({ id: 'def', type: 'simplify' }), 'http://host/scans/?whole=1000&job=def#there');
    assert.equal(addressOf(null), 'http://host/scans/?whole=1000#there');
});

test('No form says what the contract says of other methods alone', async () => {
    const { worded } = await moduleOf('clouds/job_fields.js');
    const allOf = (fields) => fields.flatMap((field) => [field, ...allOf(field.fields ?? [])]);
    const forms = await shippedForms();
    const all = forms.flatMap((form) => [form, ...allOf(form.fields)]).map(({ description }) => description);
    assert.ok(all.some((description) => description.includes('another method is refused')), 'the contract says so no more');
    for (const description of all) {
        assert.doesNotMatch(worded(description), /another method|unless it has its default|Give either|  |`/);
    }
});

test('A field for numbers takes what is one alone', async () => {
    globalThis.document = { createElement: () => ({ append(...children) { this.children = children; } }) };
    const { fieldOf } = await moduleOf('clouds/job_fields.js');
    const takes = (field, text) => {
        const [, { pattern }] = fieldOf({ name: 'a', description: '', ...field }, {}).row.children;
        return new RegExp(`^(?:${pattern})$`, 'v').test(text);
    };
    const fields = [[{ kind: 'quantity' }, ''], [{ kind: 'list', of: 'number' }, ''], [{ kind: 'list', of: 'number' }, '1, '],
        [{ kind: 'map', of: { kind: 'number' } }, 'height: '], [{ kind: 'map', of: { kind: 'number' } }, 'height: 1, class: ']];
    for (const [field, before] of fields) {
        for (const number of ['1', '-0.5', '.5', '1.', '+2e-3', '1E6']) {
            assert.ok(takes(field, before + number), `${field.kind} ${before}${number}`);
        }
        for (const other of ['1e', '--', '.', '-', '1.2.3', 'e5', '1e999', 'x']) {
            assert.ok(!takes(field, before + other), `${field.kind} ${before}${other}`);
        }
    }
    assert.ok(takes({ kind: 'quantity' }, '0.1 %') && !takes({ kind: 'quantity' }, '%'));
});

test('A message of the server is told in the words of the form, with the field that it begins with', async () => {
    const { wordedProblem } = await moduleOf('clouds/job_fields.js');
    const fields = (await shippedForms()).find(({ type }) => type === 'pyramid').fields;
    const told = {
        'max_displacement -1: expected a finite number above 0': ['max displacement -1: expected a finite number above 0', 'max_displacement'],
        'tiles.max_points: -3: expected an integer': ['tiles, max points: -3: expected an integer', 'tiles/max_points'],
        'regions[0].sphere.radius: missing: this field is required': ['region 1, sphere, radius: missing: this field is required', 'regions/0/sphere/radius'],
        'attribute_weights.my_points: -1: expected 0 or more': ['attribute weights, my_points: -1: expected 0 or more', 'attribute_weights/my_points'],
        'k: belongs to multiphase': ['neighbours (k): belongs to multiphase', 'k'],
        'expected one of base_points and my_points': ['expected one of base points and my_points', ''],
        'Connection lost; trying again': ['Connection lost; trying again', ''],
        'my_points: unknown field': ['my_points: unknown field', ''],
    };
    for (const [message, [text, path]] of Object.entries(told)) {
        assert.deepEqual(wordedProblem(message, fields), { text, path: path.split('/').filter(Boolean) });
    }
});

/** As far as modules ask for them. */
function pretendBrowser({ storage }) {
    const elements = {};
    globalThis.location = new URL('http://host/');
    globalThis.document = { getElementById: (id) => (elements[id] ??= { showModal() {}, close() {} }) };
    globalThis.window = { get sessionStorage() { return storage(); }, get localStorage() { return storage(); } };
}

test('A key that the browser may not keep is used all the same', async () => {
    pretendBrowser({ storage: () => { throw new Error('SecurityError'); } });
    const { askForKey, authorization } = await moduleOf('api/api_key.js');
    assert.deepEqual(authorization(), {});
    const asked = askForKey('This server asks for an API key.');
    document.getElementById('key').value = ' right ';
    document.getElementById('key-form').onsubmit({ preventDefault() {} });
    await asked;
    assert.deepEqual(authorization(), { Authorization: 'Bearer right' });
});

test('An upload that is answered by a page ends', async () => {
    pretendBrowser({ storage: () => ({ getItem: () => null }) });
    globalThis.XMLHttpRequest = class {
        upload = {};
        status = 200;
        responseText = '<html>Sign in</html>';
        open() {}
        setRequestHeader() {}
        send() { setTimeout(() => this.onload()); }
    };
    const { uploadCloud } = await moduleOf('api/upload.js');
    await assert.rejects(uploadCloud(new File(['ply'], 'a.ply')), { title: 'The server cannot be reached' });
});

test('A button says what it does until that is over, once at a time, also where it fails', async () => {
    const { whileSaying } = await moduleOf('page/element.js');
    const button = { textContent: 'Save' };
    const asked = [];
    const onclick = whileSaying('Saving', () => new Promise((...ends) => asked.push(ends)));
    for (const [end, expected] of [[0, undefined], [1, 'failed']]) {
        const first = onclick({ currentTarget: button });
        const second = onclick({ currentTarget: button });
        assert.equal(button.textContent, 'Saving');
        asked.at(-1)[end]('failed');
        assert.equal(await first.catch((error) => error), expected);
        await second;
        assert.equal(button.textContent, 'Save');
    }
    assert.equal(asked.length, 2);
});
