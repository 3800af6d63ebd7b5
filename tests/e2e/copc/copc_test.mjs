// COPC files in other people's readers: every node by its range of bytes (copc.js), also from a server, and the file as
// a whole (LASzip).
//
//     node copc_test.mjs --bin build/dev/bin --modules node_modules
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { parseArgs } from 'node:util';
import { startServer } from '../browser/server.mjs';

const { values: options } = parseArgs({ options: { bin: { type: 'string' }, modules: { type: 'string' } } });
const from = createRequire(join(resolve(options.modules), 'from.js'));
const { Copc, Las } = from('copc'), proj4 = from('proj4');
const lazPerf = await Las.PointData.createLazPerf();
const folder = mkdtempSync(join(tmpdir(), 'stipple-copc-'));
const convert = (...args) => execFileSync(join(options.bin, 'stipple'), ['convert', ...args, '--quiet']);

/** Columns of a cloud, as a PLY file has them: name, type and value of each point. */
function writePly(file, points, columns) {
    const sizes = { uchar: 1, ushort: 2, short: 2, uint: 4, int: 4, float: 4, double: 8 };
    const put = { uchar: 'writeUInt8', ushort: 'writeUInt16LE', short: 'writeInt16LE', uint: 'writeUInt32LE', int: 'writeInt32LE', float: 'writeFloatLE', double: 'writeDoubleLE' };
    const header = ['ply', 'format binary_little_endian 1.0', `element vertex ${points}`,
        ...columns.map(({ name, type }) => `property ${type} ${name}`), 'end_header', ''].join('\n');
    const stride = columns.reduce((sum, { type }) => sum + sizes[type], 0);
    const rows = Buffer.alloc(points * stride);
    for (let i = 0, at = 0; i < points; ++i) {
        for (const { type, value } of columns) {
            rows[put[type]](value(i), at);
            at += sizes[type];
        }
    }
    writeFileSync(file, Buffer.concat([Buffer.from(header), rows]));
}

/** All that a file holds, node by node, and the points as records in the order of the file. */
async function read(file) {
    const bytes = readFileSync(file);
    const get = async (begin, end) => new Uint8Array(bytes.subarray(begin, end));
    const copc = await Copc.create(get);
    const nodes = [];
    const walk = async (page) => {
        const hierarchy = await Copc.loadHierarchyPage(get, page);
        for (const [key, node] of Object.entries(hierarchy.nodes)) {
            const records = await Copc.loadPointDataBuffer(get, copc.header, node, lazPerf);
            nodes.push({ key: key.split('-').map(Number), ...node, records, view: Las.View.create(records, copc.header, copc.eb) });
        }
        for (const below of Object.values(hierarchy.pages)) await walk(below);
    };
    await walk(copc.info.rootHierarchyPage);
    return { copc, nodes, bytes };
}

/** What holds for every file. */
async function checkForm({ copc, nodes, bytes }, points) {
    const { header, info } = copc;
    assert.equal(header.pointCount, points);
    assert.equal(nodes.reduce((sum, node) => sum + node.pointCount, 0), points);
    // The chunks lie one behind the other, those of the upper depths first, and are one LAZ file.
    nodes.sort((a, b) => a.pointDataOffset - b.pointDataOffset);
    let at = header.pointDataOffset + 8, depth = 0;
    for (const node of nodes) {
        assert.equal(node.pointDataOffset, at);
        assert.ok(node.key[0] >= depth);
        at += node.pointDataLength;
        depth = node.key[0];
    }
    const whole = await Las.PointData.decompressFile(new Uint8Array(bytes), lazPerf);
    assert.ok(Buffer.concat(nodes.map((node) => node.records)).equals(whole), 'node by node and as a whole');

    const low = info.cube.slice(0, 3), side = info.cube[3] - info.cube[0];
    const least = [Infinity, Infinity, Infinity], most = [-Infinity, -Infinity, -Infinity];
    for (const { key: [d, ...place], view } of nodes) {
        const size = side / 2 ** d;
        const coordinates = ['X', 'Y', 'Z'].map((axis) => view.getter(axis));
        for (let i = 0; i < view.pointCount; ++i) {
            coordinates.forEach((get, axis) => {
                const x = get(i), off = x - (low[axis] + place[axis] * size);
                assert.ok(off >= -1e-9 * side && off < size + 1e-9 * side, `a point in the cube of its node, ${off} of ${size}`);
                least[axis] = Math.min(least[axis], x);
                most[axis] = Math.max(most[axis], x);
            });
        }
    }
    assert.deepEqual([header.min, header.max], [least, most]);
}

// Integers as good as random, and everywhere the same.
const random = (i, salt) => {
    let x = (Math.imul(i + 1, 0x9E3779B1) ^ Math.imul(salt, 0x85EBCA6B)) >>> 0;
    x = Math.imul(x ^ (x >>> 15), 0x2C1B3C6D) >>> 0;
    x = Math.imul(x ^ (x >>> 12), 0x297A2D39) >>> 0;
    return (x ^ (x >>> 15)) >>> 0;
};
const part = (i, salt) => random(i, salt) / 2 ** 32;

// Ground on whole centimetres far from 0, of which a corner is denser, with all that LiDAR has.
const ground = (i) => {
    const dense = i % 3 === 0 ? 0.02 : 1;
    const x = Math.floor(dense * 100_000 * part(i, 1)), y = Math.floor(dense * 80_000 * part(i, 2));
    return [x, y, Math.floor(500 * Math.sin(x / 9000) * Math.cos(y / 7000)) + (random(i, 3) % 5)];
};
const returns = (i) => (i % 3 === 0 ? 1 : 1 + (random(i, 11) % 15));
const lidar = [
    { name: 'x', type: 'double', value: (i) => 636_000 + ground(i)[0] / 100 },
    { name: 'y', type: 'double', value: (i) => 849_000 + ground(i)[1] / 100 },
    { name: 'z', type: 'double', value: (i) => 400 + ground(i)[2] / 100 },
    { name: 'red', type: 'uchar', value: (i) => (i % 7 === 0 ? 9 : random(i, 4) % 256) },
    { name: 'green', type: 'uchar', value: (i) => (i % 7 === 0 ? 9 : random(i, 5) % 256) },
    { name: 'blue', type: 'uchar', value: (i) => (i % 7 === 0 ? 9 : random(i, 6) % 256) },
    { name: 'Intensity', type: 'ushort', value: (i) => random(i, 7) % 65_536 },
    { name: 'scalar_Classification', type: 'float', value: (i) => random(i, 8) % 23 },
    { name: 'number', type: 'uint', value: (i) => i },
    { name: 'time', type: 'double', value: (i) => 1e9 + i * 0.00125 },
    { name: 'angle', type: 'short', value: (i) => (random(i, 9) % 60_000) - 30_000 },
    { name: 'constant', type: 'int', value: () => -5 },
    // Pulses of six flights that cross, some with one return, some with many.
    { name: 'GpsTime', type: 'double', value: (i) => 3.1e8 + 700 * (random(i, 10) % 6) + (i >> 1) * 2e-5 },
    { name: 'return_number', type: 'uchar', value: (i) => 1 + (random(i, 12) % returns(i)) },
    { name: 'scalar_Number_Of_Returns', type: 'float', value: (i) => returns(i) },
    { name: 'point_source_id', type: 'int', value: (i) => 65_530 + (random(i, 10) % 6) },
    { name: 'UserData', type: 'uchar', value: (i) => random(i, 13) % 256 },
    ...['synthetic', 'key_point', 'Withheld', 'scalar_Overlap', 'ScanDirectionFlag', 'edge_of_flight_line'].map((name, flag) => (
        { name, type: 'uchar', value: (i) => (random(i, 20 + flag) % (2 + flag) === 0 ? 1 : 0) })),
];

try {
    const ply = join(folder, 'in.ply'), file = join(folder, 'out.copc.laz');
    const points = 70_000;
    writePly(ply, points, lidar);
    convert(ply, file);
    const whole = await read(file);
    await checkForm(whole, points);
    assert.ok(whole.nodes.length > 8 && whole.nodes.some(({ key }) => key[0] > 1), 'a tree');
    assert.deepEqual(whole.copc.header.scale, [0.01, 0.01, 0.01]);
    assert.equal(whole.copc.header.pointDataRecordFormat, 7);
    const named = { x: 'X', y: 'Y', z: 'Z', red: 'Red', green: 'Green', blue: 'Blue', scalar_Classification: 'Classification', return_number: 'ReturnNumber', scalar_Number_Of_Returns: 'NumberOfReturns', point_source_id: 'PointSourceId', synthetic: 'Synthetic', key_point: 'KeyPoint', scalar_Overlap: 'Overlap', edge_of_flight_line: 'EdgeOfFlightLine' };
    const seen = new Set();
    for (const { view } of whole.nodes) {
        const number = view.getter('number');
        const columns = lidar.map(({ name, value }) => ({ name, value, get: view.getter(named[name] ?? name) }));
        for (let i = 0; i < view.pointCount; ++i) {
            const n = number(i);
            seen.add(n);
            for (const { name, value, get } of columns) {
                const expected = value(n), got = get(i);
                if (name.length === 1) assert.ok(Math.abs(got - expected) < 1e-6, `${name} of ${n}: ${got}, not ${expected}`);
                else assert.equal(/red|green|blue/.test(name) ? got / 256 : got, expected, `${name} of ${n}`);
            }
        }
    }
    assert.equal(seen.size, points);
    const all = (name) => Array.from({ length: points }, (_, i) => lidar.find((column) => column.name === name).value(i));
    const times = all('GpsTime').reduce(([least, most], t) => [Math.min(least, t), Math.max(most, t)], [Infinity, -Infinity]);
    assert.deepEqual(whole.copc.info.gpsTimeRange, times);
    const numbers = all('return_number');
    assert.deepEqual(whole.copc.header.pointCountByReturn, Array.from({ length: 15 }, (_, r) => numbers.filter((n) => n === r + 1).length));
    assert.equal(whole.copc.header.globalEncoding & 1, 1, 'times since 1980, not of the week');
    assert.ok(!whole.copc.eb.some(({ name }) => /gps|return|source|user|synthetic|key|withheld|overlap|flag|edge/i.test(name)), 'fields of LAS are no extra bytes');
    console.log(`ok      ${points} points in ${whole.nodes.length} nodes, every value`);

    convert(ply, file, '--threads', '1');
    assert.ok(readFileSync(file).equals(whole.bytes), 'the same bytes on one thread');
    convert(ply, file, '--precision', '0.5');
    const coarse = await read(file);
    await checkForm(coarse, points);
    assert.deepEqual(coarse.copc.header.scale, [1, 1, 1]);
    assert.ok(coarse.bytes.length < whole.bytes.length);
    console.log('ok      one thread; a precision');

    // Numbers that LAS has no room for stay what they are.
    const odd = { return_number: (i) => i % 4, scalar_Number_Of_Returns: () => 2, UserData: (i) => i % 300, point_source_id: (i) => -1 - i, GpsTime: (i) => 604_800 * part(i, 14) };
    writePly(ply, points, lidar.map((column) => ({ ...column, type: column.name === 'UserData' ? 'int' : column.type, value: odd[column.name] ?? column.value })));
    convert(ply, file);
    const strange = await read(file);
    await checkForm(strange, points);
    assert.equal(strange.copc.header.globalEncoding & 1, 0, 'times of the week');
    assert.deepEqual(strange.copc.header.pointCountByReturn, [points, ...Array(14).fill(0)]);
    for (const { view } of strange.nodes) {
        const number = view.getter('number');
        for (const [name, value] of Object.entries(odd)) {
            const get = view.getter(name);
            for (let i = 0; i < view.pointCount; ++i) assert.equal(get(i), value(number(i)), name);
        }
    }
    console.log('ok      numbers that are no returns, sources and users');
    writePly(ply, points, lidar);

    // The coordinate system, as another program understands it.
    assert.match(whole.copc.wkt, /^LOCAL_CS\["unknown",/);
    // `cs2cs EPSG:<epsg> EPSG:4326` of PROJ 9.1.
    for (const [epsg, place, longitude, latitude] of [[25832, [691_607.86, 5_334_760.38], 11.57555599, 48.13722193],
        [32617, [630_084, 4_833_438], -79.38714287, 43.64256178], [32733, [300_000, 5_500_000], 12.63531921, -40.62663973],
        [32601, [300_000, 5_500_000], -179.76905775, 49.61941719]]) {
        convert(ply, file, '--epsg', String(epsg));
        const { copc } = await read(file);
        const [x, y] = proj4(copc.wkt, 'WGS84', place);
        assert.ok(Math.hypot(x - longitude, y - latitude) < 1e-7, `${epsg}: ${x}, ${y}`);
    }
    console.log('ok      coordinate systems');

    // A deep tree: points ever denser towards a corner.
    const deep = Array.from({ length: 160_000 }, (_, i) => [1, 2, 3].map((salt) => part(i, salt) * 2 ** -Math.floor(i / 8000)));
    writePly(ply, deep.length, ['x', 'y', 'z'].map((name, axis) => ({ name, type: 'float', value: (i) => deep[i][axis] })));
    convert(ply, file);
    const deepest = await read(file);
    await checkForm(deepest, deep.length);
    assert.equal(deepest.copc.header.pointDataRecordFormat, 6);
    assert.ok(deepest.nodes.some(({ key }) => key[0] > 10));
    console.log(`ok      ${deepest.nodes.length} nodes`);

    // Degenerate clouds.
    const few = { 'one point': () => [1.5, -2, 1e6], 'all equal': () => [7.25, 0.1, -3], 'a line': (i) => [i * 0.37, 0, 0] };
    for (const [what, place] of Object.entries(few)) {
        const count = what === 'one point' ? 1 : 50_000;
        writePly(ply, count, ['x', 'y', 'z'].map((name, axis) => ({ name, type: 'double', value: (i) => place(i)[axis] })));
        convert(ply, file);
        const result = await read(file);
        await checkForm(result, count);
        const [x, y, z] = ['X', 'Y', 'Z'].map((axis) => result.nodes[0].view.getter(axis)(0));
        assert.ok(Math.abs(y - place(0)[1]) < 1e-6 && Math.abs(z - place(0)[2]) < 1e-6 && Number.isFinite(x), what);
        console.log(`ok      ${what}, ${result.nodes.length} nodes`);
    }
    // From a server, as a viewer does: the head, the hierarchy, and of the points those of the root.
    const server = await startServer(options.bin);
    try {
        writePly(ply, points, lidar);
        const request = async (path, init) => {
            const reply = await fetch(server.url + path, init);
            assert.ok(reply.ok, `${path}: ${reply.status}`);
            return reply.json();
        };
        const cloud = await request('/v1/clouds', { method: 'POST', body: readFileSync(ply) });
        const { id } = await request('/v1/jobs', {
            method: 'POST', headers: { 'Content-Type': 'application/json' },
            body: JSON.stringify({ type: 'pyramid', input: cloud.id, formats: ['ply', 'copc.laz'], tiles: { epsg: 32610 } }),
        });
        let job;
        do job = await request(`/v1/jobs/${id}?wait=20`); while (job.status === 'accepted' || job.status === 'running');
        assert.equal(job.status, 'successful');
        const { levels } = await request(`/v1/pyramids/${id}/manifest.json`);
        const [octree, ...others] = levels.flatMap(({ files }) => files.filter(({ format }) => format === 'copc.laz'));
        assert.equal(others.length, 0);
        const url = server.url + octree.href;
        const found = await Copc.create(url);
        assert.match(found.wkt, /^PROJCS\["WGS 84 \/ UTM zone 10N"/);
        const { nodes } = await Copc.loadHierarchyPage(url, found.info.rootHierarchyPage);
        const root = await Copc.loadPointDataView(url, found, nodes['0-0-0-0'], { lazPerf });
        const number = root.getter('number'), intensity = root.getter('Intensity');
        assert.ok(root.pointCount > 1000 && root.pointCount < points);
        for (let i = 0; i < root.pointCount; ++i) assert.equal(intensity(i), lidar[6].value(number(i)));
        const head = await fetch(url, { method: 'HEAD' });
        assert.equal(head.headers.get('content-type'), 'application/vnd.laszip+copc');
        assert.equal(Number(head.headers.get('content-length')), octree.bytes);
        console.log(`ok      ${root.pointCount} of ${found.header.pointCount} points from a server`);
    } finally {
        await server.stop();
    }
} catch (error) {
    console.error(error);  // here: laz-perf would print all of itself with it
    process.exitCode = 1;
} finally {
    rmSync(folder, { recursive: true, force: true });
}
