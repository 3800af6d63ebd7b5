// The viewer of a real server, as a person meets it. Exits 0, 1, or 77 (skipped) where a browser is missing.
//
//     node browser_test.mjs --bin build/dev/bin --viewer viewer --modules FOLDER --artifacts FOLDER [--scan igea.ply] [--only 'A stream']
import assert from 'node:assert/strict';
import { existsSync, mkdirSync, readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { basename, join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';
import { parseArgs } from 'node:util';

import { Browser, findChromium } from './browser.mjs';
import { coloredTorus, line, onePoint, sphere, spherePoints, truncated } from './clouds.mjs';
import { startServer } from './server.mjs';

const kSkipped = 77;
const { values: options } = parseArgs({
    options: {
        bin: { type: 'string' }, viewer: { type: 'string' }, modules: { type: 'string' }, artifacts: { type: 'string' },
        scan: { type: 'string' }, only: { type: 'string', default: '' },
    },
});

const chromium = findChromium();
if (!chromium) {
    console.log('SKIPPED: no Chromium was found. Install it (apt-get install chromium) or name it in CHROMIUM.');
    process.exit(kSkipped);
}
const playwright = createRequire(join(resolve(options.modules), 'package.json'))('playwright-core');
mkdirSync(options.artifacts, { recursive: true });

const server = await startServer(options.bin);
const browser = await Browser.launch(playwright, chromium, server.url);
const torus = { name: 'torus.ply', buffer: coloredTorus(60_000) };
const scan = options.scan && existsSync(options.scan)
    ? { name: basename(options.scan), buffer: readFileSync(options.scan) }
    : { name: 'sphere.ply', buffer: sphere(150_000) };
let torusPyramid = null;

const tests = {
    async 'Estimated normals of a sphere point along its radius'() {
        const { estimateSurface } = await import(pathToFileURL(resolve(options.viewer, 'src/surface_estimate.js')));
        const points = spherePoints(3000);
        const surface = estimateSurface(Float32Array.from(points.flat()), null, 0.06);
        points.forEach((point, i) => {
            const along = point.reduce((sum, x, k) => sum + x * surface[4 * i + k], 0) / 32767;
            assert.ok(Math.abs(along) > Math.cos(2 * Math.PI / 180), `point ${i}: cosine ${along}`);
        });
    },

    async 'Of a tree of tiles those are drawn that are fine enough, and coarser ones until all of these are there'() {
        const { select, treeOf } = await import(pathToFileURL(resolve(options.viewer, 'src/tile_tree.js')));
        const json = (error, children = []) => ({
            boundingVolume: { box: [children.length, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1] }, geometricError: 100,
            content: { uri: `${error}.glb` }, extras: { error: { p99: error }, spacing: 1 }, children,
        });
        const root = treeOf(json(8, [json(4), json(3, [json(1), json(1)])]));
        const [left, right] = root.children;
        const view = { sees: () => true, errorOf: (tile) => tile.error, pixels: 2, finestLevel: 9, now: 1 };
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
        assert.deepEqual(chosen({ sees: (tile) => tile !== left }).drawn, right.children);
    },

    async 'Of tiles that add to each other a tile is drawn with those above it, in splats as small as theirs'() {
        const { select, treeOf } = await import(pathToFileURL(resolve(options.viewer, 'src/tile_tree.js')));
        const json = (error, children = []) => ({
            boundingVolume: { box: [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1] }, geometricError: 100, refine: 'ADD',
            content: { uri: `${error}.glb` }, extras: { error: { p99: error }, spacing: error / 10 }, children,
        });
        const root = treeOf(json(8, [json(4), json(3, [json(1)])]));
        const [left, right] = root.children, [finest] = right.children;
        const view = { sees: () => true, errorOf: (tile) => tile.error, pixels: 2, finestLevel: 9, now: 1 };
        const load = (...tiles) => tiles.forEach((tile) => Object.assign(tile, { state: 'ready', cloud: {} }));

        assert.deepEqual(select(root, view), { drawn: [], wanted: [root] });
        load(root);
        assert.deepEqual(select(root, view), { drawn: [root], wanted: [left, right] });
        assert.equal(root.shownSpacing, 0.8);
        load(left, right, finest);
        assert.deepEqual(select(root, view), { drawn: [root, left, right, finest], wanted: [] });
        assert.deepEqual([root, left, right, finest].map((tile) => tile.shownSpacing), [0.4, 0.4, 0.1, 0.1]);
        assert.deepEqual(select(root, { ...view, finestLevel: 1 }).drawn, [root, left, right]);
        assert.deepEqual(select(root, { ...view, pixels: 9 }).drawn, [root]);
    },

    async 'An empty server invites to add a cloud'() {
        const page = await browser.open();
        await page.getByText('Drop a point cloud here').waitFor();
        assert.equal(await page.locator('#hud').isVisible(), false);
        await page.context().close();
    },

    async 'A chosen file becomes a pyramid that is shown coarse to fine'() {
        const page = await browser.open();
        await page.locator('#file').setInputFiles({ ...torus, mimeType: 'application/octet-stream' });
        torusPyramid = await settledPyramid(page);
        const manifest = await manifestOf(torusPyramid);
        const finest = manifest.levels.at(-1);
        assert.ok(manifest.levels.length >= 2, `${manifest.levels.length} levels`);
        assert.equal(finest.points, 60_000);
        const marks = await page.evaluate(() => performance.getEntriesByType('mark').map(({ name, detail }) => [name, detail.points]));
        assert.deepEqual(marks[0], ['stipple.level.0', manifest.levels[0].points]);
        assert.deepEqual(marks.at(-1), [`stipple.level.${finest.level}`, finest.points]);
        await page.context().close();
    },

    async 'The figures are those of the manifest'() {
        const page = await browser.open(`/?pyramid=${torusPyramid}`);
        await settledPyramid(page);
        const { levels } = await manifestOf(torusPyramid);
        const figure = (id) => page.locator(`#${id}`).innerText();
        assert.equal(await figure('points'), levels.at(-1).points.toLocaleString('en'));
        assert.equal(await figure('level-name'), `${levels.length} of ${levels.length}`);
        assert.match(await figure('first-picture'), /^[\d.]+ m?s$/);
        const bytes = levels.flatMap(({ files }) => files).filter(({ format }) => format === 'drc')
            .reduce((sum, file) => sum + file.bytes, 0);
        assert.ok(Math.abs(parseFloat(await figure('bytes')) * 1000 - bytes) <= 0.006 * bytes + 500, await figure('bytes'));
        await page.context().close();
    },

    async 'The coarsest level needs no request of its own'() {
        const page = await browser.open(`/?pyramid=${torusPyramid}`);
        const asked = [];
        page.on('request', (request) => asked.push(new URL(request.url()).pathname));
        await page.reload();
        await settledPyramid(page);
        const { levels } = await manifestOf(torusPyramid);
        const isAsked = levels.map(({ files }) => asked.includes(files.find(({ format }) => format === 'drc').href));
        assert.deepEqual(isAsked, levels.map(({ level }) => level > 0));
        await page.context().close();
    },

    async 'A stream is shown while its bytes come, and the slider chooses how many of its points'() {
        const id = await startJob({ type: 'pyramid', input: await cloudOf(torusPyramid), formats: ['stpc'] });
        const page = await browser.open(`/?pyramid=${id}`);
        await settledPyramid(page);
        await shows(page, 60_000);
        const shown = await page.evaluate(() => performance.getEntriesByType('mark').map(({ detail }) => detail.points));
        assert.ok(shown.length >= 2 && shown[0] < 4_000, `shown were ${shown}`);
        assert.equal(shown.at(-1), 60_000);
        await rest(page);
        await page.screenshot({ path: join(options.artifacts, 'viewer-stream.png') });
        const whole = await litShare(page);
        await page.locator('#level').fill('2');
        await shows(page, 3_750);
        await rest(page);
        assert.ok(await litShare(page) > 0.9 * whole);
        await colorsStandForHeight(page);
        await page.context().close();
    },

    async 'A coloured cloud shows its colours'() {
        const page = await browser.open(`/?pyramid=${torusPyramid}`);
        await settledPyramid(page);
        await rest(page);
        await page.screenshot({ path: join(options.artifacts, 'viewer-colour.png') });
        const picture = await browser.pixels(page, stageOf(page));
        const shares = {
            red: shareOf(picture, (r, g, b) => r > 1.8 * g && r > 1.8 * b && r > 90),
            green: shareOf(picture, (r, g, b) => g > 1.5 * r && g > 1.5 * b && g > 90),
            blue: shareOf(picture, (r, g, b) => b > 1.5 * r && b > 1.5 * g && b > 90),
        };
        for (const [name, value] of Object.entries(shares)) {
            assert.ok(value > 0.03, `${name}: ${(100 * value).toFixed(1)} % of the pixels`);
        }
        await page.context().close();
    },

    async 'A key and the slider choose the level'() {
        const page = await browser.open(`/?pyramid=${torusPyramid}`);
        await settledPyramid(page);
        const { levels } = await manifestOf(torusPyramid);
        await page.keyboard.press('1');
        await shows(page, levels[0].points);
        await page.locator('#level').fill(String(levels.length));
        await shows(page, levels.at(-1).points);
        await page.context().close();
    },

    async 'A dropped scan fills the picture, in the dark and in the light'() {
        const page = await browser.open();
        await drop(page, scan);
        const pyramid = await settledPyramid(page, torusPyramid);
        await rest(page);
        await page.screenshot({ path: join(options.artifacts, 'viewer-dark.png') });
        const { levels } = await manifestOf(pyramid);
        await shows(page, levels.at(-1).points);
        const lit = await litShare(page);
        assert.ok(lit > 0.15 && lit < 0.85, `${(100 * lit).toFixed(1)} % of the pixels`);
        await page.emulateMedia({ colorScheme: 'light' });
        await rest(page);
        await page.screenshot({ path: join(options.artifacts, 'viewer-light.png') });
        const litInLight = await litShare(page);
        assert.ok(Math.abs(litInLight - lit) < 0.05, `${(100 * litInLight).toFixed(1)} % of the pixels`);
        await page.context().close();
    },

    async 'Colours can stand for normals or for a coordinate, with a legend'() {
        const page = await browser.open(`/?pyramid=${torusPyramid}`);
        await settledPyramid(page);
        const own = await restingPicture(page);
        await page.keyboard.press('l');
        await page.locator('#color').selectOption('x');
        assert.match(await page.locator('#legend-high').innerText(), /^[\d.]+$/);
        await page.screenshot({ path: join(options.artifacts, 'viewer-look.png') });
        await page.keyboard.press('l');
        assert.ok(differenceOf(own, await restingPicture(page)) > 0.1);
        await page.context().close();
    },

    async 'A key shows the keys'() {
        const page = await browser.open(`/?pyramid=${torusPyramid}`);
        await settledPyramid(page);
        await page.keyboard.press('?');
        await page.getByText('Come closer').waitFor();
        await page.screenshot({ path: join(options.artifacts, 'viewer-help.png') });
        await page.getByRole('button', { name: 'Close' }).click();
        assert.equal(await page.locator('#help-dialog').isVisible(), false);
        await page.context().close();
    },

    async 'Two levels are compared by a line that is moved, and side by side'() {
        const page = await browser.open();
        await settledPyramid(page);
        await page.keyboard.press('c');
        await page.locator('#right-label').getByText('B').waitFor();
        await page.locator('#compare-with').selectOption('level:0');
        await rest(page);
        await page.screenshot({ path: join(options.artifacts, 'viewer-compare.png') });
        const half = await restingPicture(page);
        await page.locator('#divider').press('ArrowLeft');
        assert.ok(differenceOf(half, await restingPicture(page)) > 1e-4);
        await page.getByRole('button', { name: 'Side by side' }).click();
        assert.ok(differenceOf(half, await restingPicture(page)) > 0.05);
        await page.keyboard.press('c');
        assert.equal(await page.locator('#divider').isVisible(), false);
        await page.context().close();
    },

    async 'Large levels come tile by tile, as far as the view asks for them'() {
        const id = await startJob({
            type: 'pyramid', input: await cloudOf(torusPyramid), base_points: 3000, formats: ['drc', 'glb'],
            tiles: { max_points: 4000, attributes: true },
        });
        const page = await browser.open(`/?pyramid=${id}&whole=10000`);
        await settledPyramid(page);
        await page.locator('#activity').getByText('by view').waitFor();
        await rest(page);
        const lit = await litShare(page);
        await page.screenshot({ path: join(options.artifacts, 'viewer-tiles.png') });
        const whole = await browser.open(`/?pyramid=${id}`);
        await settledPyramid(whole);
        await rest(whole);
        const litByWhole = await litShare(whole);
        assert.ok(Math.abs(lit - litByWhole) < 0.01, `${(100 * lit).toFixed(1)} % of the pixels, not ${(100 * litByWhole).toFixed(1)} %`);
        await whole.context().close();
        await colorsStandForHeight(page);

        await page.locator('#stage').dblclick({ position: { x: 640, y: 560 } });
        const drawn = () => page.locator('#points').innerText().then((text) => Number(text.replaceAll(',', '')));
        await page.waitForTimeout(1500);
        await settledPyramid(page);
        await rest(page);
        assert.ok(await drawn() < 60_000, `${await drawn()} points where only a part is seen`);
        await page.context().close();
    },

    async 'Splats that were measured as ellipses cover what round ones do'() {
        const simplified = { type: 'simplify', input: await cloudOf(torusPyramid), points: 3000, format: 'drc' };
        const lit = [];
        for (const splats of ['none', 'ellipse']) {
            const page = await browser.open(`/?job=${await startJob({ ...simplified, splats })}`);
            await settledPyramid(page);
            await rest(page);
            await page.screenshot({ path: join(options.artifacts, `viewer-splats-${splats}.png`) });
            lit.push(await litShare(page));
            await page.context().close();
        }
        assert.ok(lit[0] > 0.1 && Math.abs(lit[1] - lit[0]) < 0.03, `${lit} of the pixels`);
    },

    async 'A form made from the contract starts a job, whose result is shown, saved and measured'() {
        const page = await browser.open(`/?pyramid=${torusPyramid}`);
        await settledPyramid(page);
        await page.getByRole('button', { name: 'Process' }).last().click();
        await page.locator('#job-types').getByText('Simplify').click();
        await page.locator('[name=method]').selectOption('voxel');
        assert.equal(await page.locator('[name=oversampling]').isVisible(), false);
        await page.locator('[name=points]').fill('1234');
        await page.screenshot({ path: join(options.artifacts, 'viewer-form.png') });
        await page.locator('#job-start').click();
        await shows(page, 1234);
        const [download] = await Promise.all([page.waitForEvent('download'), page.locator('#files').getByText('Draco').click()]);
        assert.match(download.suggestedFilename(), /-1234\.drc$/);
        await page.locator('#files').getByText('Error map').click();
        await page.waitForFunction(() => document.getElementById('color').value === 'distance');
        await rest(page);
        await page.screenshot({ path: join(options.artifacts, 'viewer-error-map.png') });
        await page.context().close();
    },

    async 'A phone shows the cloud above the sheet'() {
        const page = await browser.open('/', { width: 390, height: 844, scale: 2 });
        await settledPyramid(page);
        await rest(page);
        await page.screenshot({ path: join(options.artifacts, 'viewer-phone.png') });
        const dock = await page.locator('#dock').boundingBox();
        const lit = await litShare(page, { x: 0, y: 60, width: 390, height: dock.y - 60 });
        assert.ok(lit > 0.1, `${(100 * lit).toFixed(1)} % of the pixels`);
        assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 390);
        await page.locator('#grip').click();
        await page.getByText('Add a point cloud').waitFor();
        await page.context().close();
    },

    async 'One point and a line are shown'() {
        for (const [name, buffer, points] of [['point.ply', onePoint(), 1], ['line.ply', line(500), 500]]) {
            const page = await browser.open();
            const before = await settledPyramid(page);
            await page.locator('#file').setInputFiles({ name, buffer, mimeType: 'application/octet-stream' });
            await settledPyramid(page, before);
            await shows(page, points);
            await rest(page);
            assert.ok(await litShare(page) > 0, name);
            await page.context().close();
        }
    },

    async 'A refused file and a broken one are explained in the words of the server'() {
        const page = await browser.open();
        await settledPyramid(page);
        browser.refusalsExpected = true;
        await page.locator('#file').setInputFiles({ name: 'notes.txt', buffer: Buffer.from('hello'), mimeType: 'text/plain' });
        await page.getByText('notes.txt was not accepted').waitFor();
        await page.locator('#file').setInputFiles({ name: 'cut.ply', buffer: truncated(), mimeType: 'application/octet-stream' });
        const notice = page.locator('.notice').last();
        await notice.getByText(/malformed|vertex|bytes|points/i).first().waitFor();
        browser.refusalsExpected = false;
        await page.context().close();
    },

    async 'A server with keys asks for one, again after a wrong one, and then shows all'() {
        const key = 'correct horse battery staple';
        const keyed = await startServer(options.bin, { key });
        const visitor = new Browser(browser.chromium, keyed.url);
        visitor.refusalsExpected = true;
        try {
            const page = await visitor.open();
            for (const [entry, reason] of [['wrong', 'an API key is needed'], [key, 'this API key is not known']]) {
                await page.getByText(reason).waitFor();
                await page.screenshot({ path: join(options.artifacts, 'viewer-key.png') });
                await page.locator('#key').fill(entry);
                await page.getByRole('button', { name: 'Continue' }).click();
            }
            await page.getByText('Drop a point cloud here').waitFor();
            await page.locator('#file').setInputFiles({ ...torus, mimeType: 'application/octet-stream' });
            await settledPyramid(page);
            await page.reload();
            await settledPyramid(page);
            await page.context().close();
            assert.deepEqual(visitor.faults, []);
        } finally {
            await keyed.stop();
        }
    },

    async 'No error, no breach of the content policy, no request to anywhere else'() {
        assert.deepEqual(browser.faults, []);
        const policy = (await fetch(`${server.url}/`)).headers.get('content-security-policy');
        assert.match(policy ?? 'no policy at all', /default-src 'none'/);
    },
};

/** Waits until all levels are on the screen; the pyramid's id. `other` names one that it must not be. */
async function settledPyramid(page, other = null) {
    await page.waitForFunction((id) => document.documentElement.dataset.state === 'settled' &&
        document.querySelector('[aria-current=true]') && document.querySelector('[aria-current=true]').dataset.result !== id, other);
    return page.locator('[aria-current=true]').getAttribute('data-result');
}

const shows = (page, points) => page.waitForFunction(
    (text) => document.getElementById('points').textContent === text, points.toLocaleString('en'));

/** Until the picture at rest is drawn. */
const rest = (page) => page.waitForFunction(() => document.documentElement.dataset.picture === 'rest');

/** The id of a job that has ended. */
async function startJob(job) {
    const headers = { 'Content-Type': 'application/json' };
    const { id } = await (await fetch(`${server.url}/v1/jobs`, { method: 'POST', headers, body: JSON.stringify(job) })).json();
    const { status } = await (await fetch(`${server.url}/v1/jobs/${id}?wait=60`)).json();
    assert.equal(status, 'successful');
    return id;
}

/** The torus looks the same by its attribute `height` and by z, which that is, and otherwise than by its own colours. */
async function colorsStandForHeight(page) {
    await page.keyboard.press('l');
    const pictureBy = async (by) => {
        await page.locator('#color').selectOption(by);
        return restingPicture(page);
    };
    const own = await pictureBy('own');
    const height = await pictureBy('height');
    const z = await pictureBy('z');
    assert.ok(differenceOf(height, z) < 0.005, `${differenceOf(height, z)} of the pixels differ`);
    assert.ok(differenceOf(own, z) > 0.1);
    await page.locator('#color').selectOption('own');
    await page.keyboard.press('l');
}

const cloudOf = async (id) => (await (await fetch(`${server.url}/v1/jobs/${id}`)).json()).request.input;

const manifestOf = async (id) => (await fetch(`${server.url}/v1/jobs/${id}/results`)).json();

/** The stage once nothing moves any more. */
async function restingPicture(page) {
    await page.waitForTimeout(100);
    await rest(page);
    return browser.pixels(page, stageOf(page));
}

/** The share of the pixels that differ. */
function differenceOf(a, b) {
    return shareOf(a, (red, green, blue, at) =>
        Math.abs(red - b.data[at]) + Math.abs(green - b.data[at + 1]) + Math.abs(blue - b.data[at + 2]) > 24);
}

/** The canvas without the cards on it. */
const stageOf = (page) => ({ x: 320, y: 70, width: page.viewportSize().width - 330, height: page.viewportSize().height - 170 });

/** The share of pixels that the cloud changes. */
async function litShare(page, clip = stageOf(page)) {
    const shown = await browser.pixels(page, clip);
    const visibility = (value) => page.locator('#stage').evaluate((stage, to) => { stage.style.visibility = to; }, value);
    await visibility('hidden');
    const empty = await browser.pixels(page, clip);
    await visibility('visible');
    return shareOf(shown, (r, g, b, at) =>
        Math.abs(r - empty.data[at]) + Math.abs(g - empty.data[at + 1]) + Math.abs(b - empty.data[at + 2]) > 12);
}

/** The share of the pixels of a picture for which `test(red, green, blue, place)` holds. */
function shareOf({ data, channels, count }, test) {
    let hits = 0;
    for (let at = 0; at < data.length; at += channels) {
        hits += test(data[at], data[at + 1], data[at + 2], at) ? 1 : 0;
    }
    return hits / count;
}

/** A file dragged in from outside, as the browser would report it. */
async function drop(page, { name, buffer }) {
    const transfer = await page.evaluateHandle(([fileName, encoded]) => {
        const bytes = Uint8Array.from(atob(encoded), (character) => character.charCodeAt(0));
        const data = new DataTransfer();
        data.items.add(new File([bytes], fileName));
        return data;
    }, [name, buffer.toString('base64')]);
    for (const type of ['dragenter', 'dragover', 'drop']) {
        await page.dispatchEvent('body', type, { dataTransfer: transfer });
    }
}

let failed = 0;
const kMakesTorus = 'A chosen file';
const chosen = Object.entries(tests).filter(([name]) => name.startsWith(options.only) || name.startsWith(kMakesTorus));
for (const [name, test] of chosen) {
    const started = performance.now();
    try {
        await test();
        console.log(`ok      ${name} (${((performance.now() - started) / 1000).toFixed(1)} s)`);
    } catch (error) {
        failed += 1;
        console.log(`FAILED  ${name}\n${error.stack}`);
    }
}
await browser.close();
await server.stop();
if (failed > 0) {
    console.log(`The server's log:\n${server.log.slice(-8000)}`);
}
console.log(`${chosen.length - failed} passed, ${failed} failed`);
process.exit(failed > 0 ? 1 : 0);
