// Progressive streams in JavaScript and in C++.
//
//     node stream_test.mjs --bin build/dev/bin --viewer viewer
import assert from 'node:assert/strict';
import { execFileSync, spawnSync } from 'node:child_process';
import { copyFileSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';
import { parseArgs } from 'node:util';

import { ply, spherePoints } from '../browser/clouds.mjs';
import { ReferenceDecoder } from './reference_decoder.mjs';

const { values: options } = parseArgs({ options: { bin: { type: 'string' }, viewer: { type: 'string' } } });
const folder = mkdtempSync(join(tmpdir(), 'stipple-stream-'));
const run = (...args) => execFileSync(join(options.bin, 'stipple'), [...args, '--quiet'], { stdio: ['ignore', 'pipe', 'inherit'] });

// Beside a package.json by which node takes them for modules.
writeFileSync(join(folder, 'package.json'), '{"type": "module"}');
for (const name of ['progressive_cloud.js', 'progressive_layout.js', 'place_model.js', 'range_decoder.js', 'cell_surface.js']) {
    copyFileSync(resolve(options.viewer, 'src/decoding', name), join(folder, name));
}
const { ProgressiveDecoder } = await import(pathToFileURL(join(folder, 'progressive_cloud.js')));

const sizes = { char: 1, uchar: 1, int8: 1, uint8: 1, short: 2, ushort: 2, int16: 2, uint16: 2, int: 4, uint: 4, int32: 4, uint32: 4, float: 4, float32: 4, double: 8, float64: 8 };

/** The bytes of some properties of a binary PLY file, row by row. */
function column(file, names) {
    const bytes = readFileSync(file);
    const end = bytes.indexOf('end_header\n') + 'end_header\n'.length;
    const properties = bytes.subarray(0, end).toString().split('\n').filter((line) => line.startsWith('property'))
        .map((line) => line.split(' ')).map(([, type, name]) => ({ name, size: sizes[type] }));
    const row = properties.reduce((sum, { size }) => sum + size, 0);
    const places = names.map((name) => {
        const at = properties.findIndex((property) => property.name === name);
        return [properties.slice(0, at).reduce((sum, { size }) => sum + size, 0), properties[at].size];
    });
    const rows = [];
    for (let at = end; at < bytes.length; at += row) {
        rows.push(...places.map(([from, size]) => bytes.subarray(at + from, at + from + size)));
    }
    return Buffer.concat(rows);
}

const raw = (array) => Buffer.from(array.buffer, array.byteOffset, array.byteLength);

try {
    const scan = join(folder, 'scan.ply');
    const stream = join(folder, 'scan.stpc');
    run('synthesize', scan, '--points', '20000', '--seed', '3');
    run('convert', scan, stream);
    const bytes = readFileSync(stream);
    for (const points of [1, 2, 1000, 7777, 20_000]) {
        const first = join(folder, 'first.ply');
        run('convert', stream, first, '--points', String(points));
        for (const piece of [bytes.length, 5000, 61]) {
            const decoder = new ProgressiveDecoder(points);
            for (let at = 0; at < bytes.length && !decoder.done; at += piece) {
                decoder.feed(bytes.subarray(at, at + piece));
            }
            assert.equal(decoder.size, points);
            assert.deepEqual(raw(decoder.positions()), column(first, ['x', 'y', 'z']), `positions of ${points}`);
            if (decoder.layout.normals) {
                assert.deepEqual(raw(decoder.pointNormals()), column(first, ['nx', 'ny', 'nz']), `normals of ${points}`);
            }
            if (decoder.layout.colors) {
                assert.deepEqual(raw(decoder.colors()), column(first, ['red', 'green', 'blue']), `colours of ${points}`);
            }
            decoder.layout.attributes.forEach(({ name, components }, number) => {
                if (components === 1) {
                    assert.deepEqual(raw(decoder.attribute(number)), column(first, [name]), `${name} of ${points}`);
                }
            });
        }
        console.log(`ok      ${points} points`);
    }
    // Headers that cannot be are refused by both, in the same words: `write(header, value, at)`.
    const attributes = 76, header = bytes.readUInt32LE(8), batches = bytes.readUInt16LE(18), batchBytes = 16;
    const nameLength = bytes[attributes], type = attributes + 1 + nameLength;
    assert.ok(bytes.readUInt16LE(16) > 0, 'the scan has an attribute');
    const byte = (broken, value, at) => { broken[at] = value; };
    const half = (broken, value, at) => broken.writeUInt16LE(value, at);
    const word = (broken, value, at) => broken.writeUInt32LE(value, at);
    const double = (broken, value, at) => broken.writeDoubleLE(value, at);
    const both = (broken, [kind, value], at) => { broken[at] = kind; broken[at + 3] = value; };
    const batch = (number, at) => header - (batches - number) * batchBytes + at;
    const impossible = [
        [byte, 88, 0, 'starts? with'], [byte, 4, 4, 'of version 4: expected 3'],
        [word, 11, 8, 'length of the header'], [word, 2 ** 20 + 1, 8, 'length of the header'], [word, header + 1, 8, 'longer than its contents'],
        [word, header - 1, 8, 'ends too early'], [byte, 16, 5, 'flags 16'], [byte, 4, 5, 'alpha without colours'],
        ...[0, 25, 255].map((bits) => [byte, bits, 6, `bits of the grid ${bits}`]), ...[1, 17].map((bits) => [byte, bits, 7, `bits of normals ${bits}`]),
        [word, 0, 12, 'points 0'], [word, 50_000_000, 12, 'do not add up'], [word, 1000, 12, 'points up to a batch'],
        ...[0, 65].map((count) => [half, count, 18, `number of batches ${count}`]),
        ...[NaN, Infinity].map((step) => [double, step, 20, 'the step of the grid is not a finite number']),
        ...[0, -1, -1e300].map((step) => [double, step, 20, 'the step of the grid is not positive']), [double, 1e308, 20, 'across: expected at most 4'],
        ...[28, 36, 44].flatMap((at) => [
            ...[NaN, -Infinity].map((low) => [double, low, at, 'the corner of the grid is not a finite number']),
            ...[1e308, -4e38].map((low) => [double, low, at, 'from the origin: expected at most 3.4028']),
        ]),
        ...[52, 60, 68].flatMap((at) => [NaN, Infinity].map((origin) => [double, origin, at, 'the origin is not a finite number'])),
        [byte, 0, attributes, 'the name of an attribute'], ...[7, 32, 127, 200].map((code) => [byte, code, attributes + 1, 'the name of an attribute']),
        [byte, 8, type, 'type of an attribute 8'], [byte, 0, type + 1, 'components of an attribute 0'], [byte, 5, type + 2, 'reduction of an attribute 5'],
        [both, [7, 175], type, 'bits of an attribute 175: expected 0\\.\\.0'], [both, [6, 33], type, 'bits of an attribute 33: expected 0\\.\\.32'],
        [double, NaN, type + 4, 'the lowest value of an attribute'], [double, Infinity, type + 12, 'the step of an attribute'],
        [word, 0, batch(0, 0), 'points up to a batch 0'], [word, 1, batch(1, 0), 'points up to a batch 1'], [word, 2 ** 31, batch(1, 0), 'points up to a batch'],
        [word, 0, batch(batches - 1, 4), 'a batch of 0 bytes cannot hold'],
        ...[0, batches - 1].flatMap((number) => [
            [byte, 200, batch(number, 8), 'shift of a batch 200'], [byte, 200, batch(number, 9), 'lift of a batch 200'],
            [byte, 200, batch(number, 10), 'bits of the blocks of a batch 200'],
        ]),
        [byte, 1, batch(batches - 1, 8), 'do not add up|shift of a batch 1:'], [byte, 1, batch(batches - 1, 11), 'do not add up'],
    ];
    const brokenStream = join(folder, 'broken.stpc'), refused = join(folder, 'refused.ply');
    for (const [write, value, at, words] of impossible) {
        const broken = Buffer.from(bytes);
        write(broken, value, at);
        const pattern = new RegExp(words);
        const decoder = new ProgressiveDecoder();
        assert.throws(() => decoder.feed(broken), pattern, `${value} at ${at}`);
        writeFileSync(brokenStream, broken);
        const { status, stderr } = spawnSync(join(options.bin, 'stipple'), ['convert', brokenStream, refused, '--quiet'], { encoding: 'utf8' });
        assert.notEqual(status, 0, `${value} at ${at}`);
        assert.match(stderr.replace(/\s+/g, ' '), pattern);
    }
    console.log(`ok      ${impossible.length} headers that cannot be`);
    // A decoder written from the document has the same cells and channels, and shows them in the same places, after each batch.
    const range = (n) => Array.from({ length: n }, (_, i) => i);
    const written = (name, points, isColored, properties) => {
        writeFileSync(join(folder, name), ply(points, isColored, properties));
        return name;
    };
    run('synthesize', join(folder, 'small.ply'), '--points', '1500', '--seed', '5');
    const ofAlpha = spherePoints(700).map((place, i) => [...place, i % 256, (7 * i) % 256, 50, (3 * i) % 256]);
    const clusters = range(600).map((i) => [5e6 + (i % 2) * 1e4 + Math.sin(i), Math.cos(1.7 * i), Math.sin(0.3 * i)]);
    const clouds = [
        ['small.ply'], ['small.ply', '--precision', '2e-5'],
        [written('alpha.ply', ofAlpha, true, { hasAlpha: true, scalars: { gap: ([x]) => (x > 0 ? Infinity : x), height: ([, , z]) => z } })],
        [written('sphere.ply', spherePoints(1200), false)], [written('double.ply', clusters, false, { type: 'double' })],
        [written('line.ply', range(500).map((i) => [i, 0, 0]), false)], [written('plane.ply', range(900).map((i) => [i % 30, Math.floor(i / 30), 5]), false)],
        [written('places.ply', range(300).map((i) => [i % 5 + 1e-4 * i, 0, 0]), false), '--precision', '0.1'],
        [written('one.ply', [[1, 2, 3]], false)], [written('two.ply', [[1, 2, 3], [1, 2, 4]], false)],
    ];
    for (const [name, ...how] of clouds) {
        const packed = join(folder, 'packed.stpc'), unpacked = join(folder, 'unpacked.ply');
        run('convert', join(folder, name), packed, ...how);
        const stored = readFileSync(packed);
        const reference = new ReferenceDecoder(stored);
        for (const { points, shift } of reference.header.batches) {
            reference.decodeBatch();
            const decoder = new ProgressiveDecoder(points);
            decoder.feed(stored.subarray(0, reference.at));
            const what = `${name}, ${points} points`;
            assert.equal(decoder.size, points, what);
            assert.deepEqual(reference.cells.flat(), [...decoder.shownPlaces()].map((place) => (place / 2 ** shift - 1) / 2), what);
            assert.deepEqual(reference.channels.flat(), [...decoder.values.subarray(0, points * decoder.layout.channels.length)], what);
            run('convert', packed, unpacked, '--bytes', String(reference.at));
            const { has, origin } = reference.header, shown = reference.positions();
            const inFile = has(8) ? Float64Array.from(shown, (x, k) => origin[k % 3] + x) : shown;
            assert.deepEqual(raw(inFile), column(unpacked, ['x', 'y', 'z']), what);
        }
        console.log(`ok      the reference's ${name}: ${reference.cells.length} points, ${reference.header.batches.length} batches`);
    }
    // Hostile bytes end in an error or in fewer points, not in a hang.
    let seed = 1;
    const random = (n) => { seed = (Math.imul(seed, 1103515245) + 12345) >>> 0; return (seed >>> 8) % n; };
    for (let i = 0; i < 200; ++i) {
        const broken = Buffer.from(bytes.subarray(0, 6000));
        broken[random(i % 2 ? 400 : broken.length)] = random(256);
        try {
            new ProgressiveDecoder(100_000).feed(broken);
        } catch (error) {
            assert.ok(error instanceof Error);
        }
    }
    console.log('ok      200 broken streams');
} finally {
    rmSync(folder, { recursive: true, force: true });
}
