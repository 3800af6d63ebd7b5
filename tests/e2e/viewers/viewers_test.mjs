// Pyramids of a real server as other people's viewers draw them, with the lines that the README shows. Exits 0, 1, or 77 (skipped)
// where a browser is missing.
//
//     node viewers_test.mjs --bin build/dev/bin --modules FOLDER --readme README.md --artifacts FOLDER [--scans FOLDER]
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { createHash } from 'node:crypto';
import { existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { basename, join, resolve } from 'node:path';
import { parseArgs } from 'node:util';
import { gunzipSync } from 'node:zlib';

import { Browser, findChromium } from '../browser/browser.mjs';
import { coloredTorusPoints, ply, spherePoints } from '../browser/clouds.mjs';
import { startServer } from '../browser/server.mjs';
import { readPly } from '../../../viewer/src/decoding/ply_cloud.js';
import { bundled, servePages } from './pages.mjs';
import { compare, meanColor, pictureOf } from './reference.mjs';

const kSkipped = 77;
const kSize = 640;
const kColor = [200, 100, 50];
const kViewers = ['tiles_renderer', 'cesium', 'draco_loader', 'loaders_gl_tiles', 'loaders_gl_draco'];
const kLevels = ['draco_loader', 'loaders_gl_draco'];  // that read one level
const kTiled = ['tiles_renderer', 'cesium', 'loaders_gl_tiles'];  // that read tiles

/** Scans that are drawn too, where they are there; `leastAlike`: colours that are nearly grey have no strongest channel. */
const kScans = [
    { file: 'models/igea.ply' },
    { file: 'models/dragon_vrip.ply.gz' },
    { file: 'colour/frag_115.ply', leastAlike: 0.8 },
    { file: 'lidar/autzen_stadium_tile.ply.gz', isTerrain: true, leastAlike: 0.8 },
];
const kScanLevels = [3000, 10_000, 30_000];  // as many as a processor draws at once
const kOfScans = ['tiles_renderer', 'cesium', 'draco_loader', 'loaders_gl_tiles'];

const { values: options } = parseArgs({
    options: {
        bin: { type: 'string' }, modules: { type: 'string' }, readme: { type: 'string' }, artifacts: { type: 'string' }, scans: { type: 'string' },
    },
});

const chromium = findChromium();
if (!chromium) {
    console.log('SKIPPED: no Chromium was found. Install it (apt-get install chromium) or name it in CHROMIUM.');
    process.exit(kSkipped);
}
const modules = resolve(options.modules);
const playwright = createRequire(join(modules, 'package.json'))('playwright-core');
mkdirSync(options.artifacts, { recursive: true });

// Lying tilted to every axis and far from the origin: nothing looks right that is turned or mirrored.
const kCentre = [310, -200, 95];
const cloud = coloredTorusPoints(60_000).map(([x, y, z, ...color]) =>
    [kCentre[0] + x, kCentre[1] + 0.8 * y - 0.6 * z, kCentre[2] + 0.6 * y + 0.8 * z, ...color]);
const torus = pictured(cloud, { eye: [311.3, -202.4, 97], target: kCentre, up: [0, 0, 1], fov: 50 });

const server = await startServer(options.bin);
const job = await pyramidOf(ply(cloud, true));
const adding = await pyramidOf(ply(cloud, true), { refine: 'add' });
const double = await pyramidOf(ply(cloud, true, { type: 'double' }));
const described = await pyramidOf(ply(cloud, true, { type: 'double', scalars: { gps_time: ([x]) => 1.3e9 + x, some: ([x, y]) => (y > kCentre[1] ? NaN : x) } }),
    { tiles: { max_points: 4_000, attributes: true } });  // its coarsest level has several
const bundles = Object.fromEntries(await Promise.all([...kViewers, 'cesium_globe'].map(
    async (name) => [name, await bundled(name, { readme: options.readme, modules })])));
const colors = await Promise.all([0, 128, 255].map(async (alpha) => {
    const file = ply(spherePoints(40_000).map((place) => [...place, ...kColor, alpha]), true, { hasAlpha: true });
    return [`alpha ${alpha}`, await pyramidOf(file)];
}));
const exported = mkdtempSync(join(tmpdir(), 'stipple-viewers-'));
const pages = await servePages(bundles, modules, { '/shelf/v1/pyramids/exported/': exported });

let failed = 0;
for (const name of kViewers) await check(name, () => checkPicture(name, job));
for (const name of kLevels) await check(`${name}, double coordinates`, () => checkPicture(name, double));
for (const name of kTiled) await check(`${name}, tiles that add`, () => checkPicture(name, adding));
for (const name of kTiled) await check(`${name}, attributes that have metadata`, () => checkPicture(name, described));
for (const [alpha, pyramid] of colors)
    for (const name of kViewers) await check(`${name}, ${alpha}`, () => checkColor(name, pyramid));
exportCloud();
for (const name of ['tiles_renderer', ...kLevels]) await check(`${name}, a folder of files`, () => checkPicture(name, 'exported', `${pages.url}/shelf`));
await check('cesium, on the globe', checkOnGlobe);
await check('inlined', checkInlined);
for (const scan of kScans) {
    await checkScan(scan);
}
pages.close();
rmSync(exported, { recursive: true });
await server.stop();
process.exit(failed > 0 ? 1 : 0);

async function check(name, body) {
    try {
        console.log(`ok      ${name}: ${await body() ?? 'as it should be'}`);
    } catch (error) {
        failed += 1;
        console.log(`FAILED  ${name}\n${error.stack}`);
    }
}

/** What the command line writes is drawn from a site that knows nothing but files, of which it has these under a path of its own. */
function exportCloud() {
    const file = join(exported, 'cloud.ply');
    writeFileSync(file, ply(cloud, true));
    execFileSync(join(options.bin, 'stipple'), ['pyramid', file, exported, '--base-points', '3000', '--formats', 'glb,drc', '--quiet']);
}

/** Whether a cloud of one colour has it, whatever its alpha says. */
async function checkColor(name, pyramid) {
    const view = { eye: [0, -3, 0], target: [0, 0, 0], up: [0, 0, 1], fov: 50, isFlat: true };
    const { pixels } = await shown(name, pyramid, { view, picture: `${name}-alpha` });
    const seen = meanColor(pixels), what = `${seen.map(Math.round)} for ${kColor}`;
    assert.ok(seen.every((value, k) => Math.abs(value - kColor[k]) <= 5), what);
    return what;
}

/** Whether a viewer draws all points of the cloud where they are. */
async function checkPicture(name, pyramid, site = server.url) {
    const { drawn, pixels } = await shown(name, pyramid, { site });
    // Points of coarse tiles that stay are as large as the gaps were between them alone, by the lines of README twice as large.
    const ofAdding = { mostSpilled: name === 'tiles_renderer' ? 0.12 : 0.01, leastAlike: 0.95 };
    return judge(drawn.points, compare(pixels, torus.small, torus.large), pyramid === adding ? ofAdding : {});
}

function judge(points, seen, { all = cloud.length, leastCovered = 0.9, mostSpilled = 0.005, leastAlike = 0.97 } = {}) {
    const share = (value) => `${(100 * value).toFixed(1)} %`;
    const what = `${points} points, covered ${share(seen.covered)}, spilled ${share(seen.spilled)}, alike ${share(seen.alike)}`;
    assert.equal(points, all, what);
    assert.ok(seen.covered > leastCovered && seen.spilled < mostSpilled && seen.alike > leastAlike, what);
    return what;
}

/** What a cloud looks like from somewhere, with small and with large points. */
function pictured(points, view, reach = 1) {
    return { view, small: pictureOf(points, view, kSize, reach), large: pictureOf(points, view, kSize, 7) };
}

/** A scan of somebody's in other people's viewers. */
async function checkScan({ file, isTerrain, ...thresholds }) {
    const path = options.scans && join(options.scans, file);
    if (!path || !existsSync(path)) {
        console.log(`SKIPPED ${file}: it is not here`);
        return;
    }
    const bytes = file.endsWith('.gz') ? gunzipSync(readFileSync(path)) : readFileSync(path);
    const pyramid = await pyramidOf(bytes, { base_points: undefined, levels: kScanLevels, formats: ['drc', 'glb', 'ply'] });
    const { source: { bounds: { min, max } }, levels } = await (await fetch(`${server.url}/v1/pyramids/${pyramid}/manifest.json`)).json();
    const { href } = levels.at(-1).files.find(({ format }) => format === 'ply');
    const { positions, colors } = readPly(await (await fetch(server.url + href)).arrayBuffer());
    const points = Array.from({ length: positions.length / 3 }, (_, i) =>
        [...positions.subarray(3 * i, 3 * i + 3), ...(colors ? colors.subarray(4 * i, 4 * i + 3) : [255, 255, 255])]);
    const target = min.map((x, k) => (x + max[k]) / 2);
    const reach = 1.1 * Math.hypot(...max.map((x, k) => x - min[k]));
    const [from, up] = isTerrain ? [[-0.4, -0.48, 0.78], [0.5, 0.6, 0.625]] : [[0.28, 0, 0.96], [0, 1, 0]];  // across each other, as Cesium asks
    const eye = target.map((x, k) => x + reach * from[k]);
    const scan = pictured(points, { eye, target, up, fov: 50 }, 0);  // at least the pixel where each point stands
    const checks = kOfScans.map((name) => () => check(`${name}, ${file}`, async () => {
        const { drawn, pixels } = await shown(name, pyramid, { view: scan.view, picture: `${name}-${basename(file).split('.')[0]}` });
        return judge(drawn.points, compare(pixels, scan.small, scan.large), {
            all: points.length, ...thresholds,
            // Points are as small as a pixel, which rounding moves. Cesium's eye-dome lighting blackens the far side that shows through.
            leastCovered: name === 'cesium' ? 0.65 : 0.8,
        });
    }));
    while (checks.length > 0) {
        await Promise.all(checks.splice(0, 2).map((run) => run()));
    }
}

/** A cloud with UTM coordinates stands upright in its place on the earth, where Cesium's camera flies to it. */
async function checkOnGlobe() {
    const easting = 300_000, northing = 5_500_000, height = 50;
    const onEarth = [4730326.4165, 1060415.2879, -4131075.7569];  // of that place of zone 33 south, by PROJ
    const placed = cloud.map(([x, y, z, ...color]) =>
        [easting + x - kCentre[0], northing + y - kCentre[1], height + z - kCentre[2], ...color]);
    const pyramid = await pyramidOf(ply(placed, true, { type: 'double' }), { tiles: { max_points: 16_000, epsg: 32733 } });
    const { drawn, pixels } = await shown('cesium_globe', pyramid, {});
    const away = Math.hypot(...drawn.center.map((x, k) => x - onEarth[k]));
    assert.ok(away < 0.5, `the tileset is ${away} m from its place`);

    const { root: { transform } } = await (await fetch(`${server.url}/v1/pyramids/${pyramid}/tileset.json`)).json();
    const { bounds: { min, max } } = (await (await fetch(`${server.url}/v1/pyramids/${pyramid}/manifest.json`)).json()).source;
    const middle = min.map((x, k) => (x + max[k]) / 2);
    const seenFrom = placed.map(([x, y, z, ...color]) => {
        const local = [x, y, z].map((value, k) => value - middle[k]);
        return [...[0, 1, 2].map((row) => transform[12 + row] - drawn.eye[row] +
            local.reduce((sum, value, k) => sum + transform[4 * k + row] * value, 0)), ...color];
    });
    const [near, wide] = [1, 7].map((reach) => pictureOf(seenFrom, drawn.view, kSize, reach));
    // From where its camera flies to, points as large as Cesium makes them cover a little less: 90.5 %.
    return judge(drawn.points, compare(pixels, near, wide), { leastCovered: 0.88 });
}

/** The id of a pyramid of several levels, the finest in several tiles. */
async function pyramidOf(file, changes = {}) {
    const send = async (path, body, type) => {
        const response = await fetch(server.url + path, { method: 'POST', headers: { 'Content-Type': type }, body });
        assert.ok(response.ok, await response.clone().text());
        return response.json();
    };
    const { id: input } = await send('/v1/clouds', file, 'application/octet-stream');
    const request = { type: 'pyramid', input, base_points: 3000, formats: ['drc', 'glb'], tiles: { max_points: 16_000 }, ...changes };
    const { id } = await send('/v1/jobs', JSON.stringify(request), 'application/json');
    const { status } = await (await fetch(`${server.url}/v1/jobs/${id}?wait=60`)).json();
    assert.equal(status, 'successful');
    return id;
}

/** With `inline` the coarsest level stands in what names it. */
async function checkInlined() {
    const at = `${server.url}/v1/pyramids/${job}`;
    const ask = async (path) => (await fetch(`${at}/${path}`)).json();
    const bytesOf = async (uri) => {
        assert.match(uri, /^data:/);
        return Buffer.from(await (await fetch(uri)).arrayBuffer());
    };
    const { levels } = await ask('manifest.json?inline=drc');
    const { href, sha256 } = levels[0].files.find(({ format }) => format === 'drc');
    assert.equal(createHash('sha256').update(await bytesOf(href)).digest('hex'), sha256);
    assert.ok(levels[1].files.every((file) => file.href.startsWith('/')));

    const named = (await ask('tileset.json')).root.content.uri;
    const tile = await bytesOf((await ask('tileset.json?inline=glb')).root.content.uri);
    assert.deepEqual(tile, Buffer.from(await (await fetch(`${at}/${named}`)).arrayBuffer()));
    assert.equal((await fetch(`${at}/tileset.json?inline=ply`)).status, 400);
}

/** What a viewer draws, in a browser of its own: its picture, and what its page says. */
async function shown(name, pyramid, { site = server.url, view = torus.view, picture = `${name}${pyramid === adding ? '-adding' : ''}` }) {
    const browser = await Browser.launch(playwright, chromium, pages.url, server.url);
    browser.faultLevels = ['error'];
    try {
        const asked = new URLSearchParams({ server: site, job: pyramid, view: JSON.stringify(view) });
        const page = await browser.open(`/pages/${name}/?${asked}`, { width: kSize, height: kSize });
        const told = await page.waitForFunction(() => window.drawn, undefined, { timeout: 60_000 }).catch((error) => {
            throw new Error([error.message, ...browser.faults].join('\n'));
        });
        await page.screenshot({ path: join(options.artifacts, `viewers-${picture}.png`) });
        const pixels = await browser.pixels(page, { x: 0, y: 0, width: kSize, height: kSize });
        assert.deepEqual(browser.faults, []);
        return { drawn: await told.jsonValue(), pixels };
    } finally {
        await browser.close();
    }
}
