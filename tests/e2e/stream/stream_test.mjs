// Progressive streams in JavaScript and in C++.
//
//     node stream_test.mjs --bin build/dev/bin --viewer viewer
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { copyFileSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';
import { parseArgs } from 'node:util';

const { values: options } = parseArgs({ options: { bin: { type: 'string' }, viewer: { type: 'string' } } });
const folder = mkdtempSync(join(tmpdir(), 'stipple-stream-'));
const run = (...args) => execFileSync(join(options.bin, 'stipple'), [...args, '--quiet'], { stdio: ['ignore', 'pipe', 'inherit'] });

// Beside a package.json by which node takes them for modules.
writeFileSync(join(folder, 'package.json'), '{"type": "module"}');
for (const name of ['progressive_cloud.js', 'place_model.js', 'range_decoder.js', 'cell_surface.js']) {
    copyFileSync(resolve(options.viewer, 'src', name), join(folder, name));
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
    // Grids that cannot be are refused by the header: their bits, a batch coarser than the one before it, cells and blocks.
    const withByte = (at, value) => {
        const broken = Buffer.from(bytes.subarray(0, 6000));
        broken[at] = value;
        return broken;
    };
    const header = bytes.readUInt32LE(8), batches = bytes.readUInt16LE(18), batchBytes = 16, bitsAt = 6, shiftAt = 8;
    for (const bits of [0, 25, 255]) {
        assert.throws(() => new ProgressiveDecoder(1).feed(withByte(bitsAt, bits)), /^Error: the grid has/);
    }
    for (const batch of [0, batches - 1]) {
        const at = header - (batches - batch) * batchBytes + shiftAt;
        assert.throws(() => new ProgressiveDecoder(1).feed(withByte(at, 200)), /^Error: batch \d+ has a coarser grid/);
        for (const more of [1, 2]) {
            assert.throws(() => new ProgressiveDecoder(1).feed(withByte(at + more, 200)), /^Error: batch \d+ has cells of/);
        }
    }
    console.log('ok      grids that cannot be');
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
