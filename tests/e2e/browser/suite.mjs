// A real server with its page in headless Chromium, for tests that meet the viewer as a person does. Exits 77 (skipped) where a
// browser is missing. One page stays open from test to test: a page of its own for each would have its shaders compiled anew.
import assert from 'node:assert/strict';
import { existsSync, mkdirSync, readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { basename, join, resolve } from 'node:path';
import { parseArgs } from 'node:util';

import { Browser, findChromium } from './browser.mjs';
import { coloredTorus, sphere } from './clouds.mjs';
import { startServer } from './server.mjs';

const kSkipped = 77;

// --scale: pixels of the screen to a pixel of the page; few, since a processor draws them. 1 for pictures to look at.
export const { values: options } = parseArgs({
    options: {
        bin: { type: 'string' }, modules: { type: 'string' }, artifacts: { type: 'string' },
        scan: { type: 'string' }, scale: { type: 'string', default: '0.5' },
    },
});

const chromium = findChromium();
if (!chromium) {
    console.log('SKIPPED: no Chromium was found. Install it (apt-get install chromium) or name it in CHROMIUM.');
    process.exit(kSkipped);
}
const playwright = createRequire(join(resolve(options.modules), 'package.json'))('playwright-core');
mkdirSync(options.artifacts, { recursive: true });

export const kTorusPoints = 30_000;
export const torus = { name: 'torus.ply', buffer: coloredTorus(kTorusPoints) };
export const scan = options.scan && existsSync(options.scan)
    ? { name: basename(options.scan), buffer: readFileSync(options.scan) }
    : { name: 'sphere.ply', buffer: sphere(150_000) };
export const scale = Number(options.scale);
export const server = await startServer(options.bin);
export const browser = await Browser.launch(playwright, chromium, server.url);

/** Runs tests by name, one after the other, then ends the process: 0 where all passed. */
export async function run(tests) {
    let failed = 0;
    const all = Object.entries({ ...tests, [kNoFaults]: hasNoFaults });
    for (const [name, test] of all) {
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
    console.log(`${all.length - failed} passed, ${failed} failed`);
    process.exit(failed > 0 ? 1 : 0);
}

const kNoFaults = 'No error, no breach of the content policy, no request to anywhere else';

async function hasNoFaults() {
    assert.deepEqual(browser.faults, []);
    const policy = (await fetch(`${server.url}/`)).headers.get('content-security-policy');
    assert.match(policy ?? 'no policy at all', /default-src 'none'/);
}

/** Gives the page a file as its button does. */
export const choose = (page, { name, buffer }) =>
    page.locator('#file').setInputFiles({ name, buffer, mimeType: 'application/octet-stream' });

/** Another result on the same page, as when one goes back to it. */
export async function visit(page, path) {
    await page.evaluate((to) => {
        history.pushState(null, '', to);
        dispatchEvent(new PopStateEvent('popstate'));
    }, path);
    await settledPyramid(page);
}

/** Waits until all levels are on the screen; the pyramid's id. `other` names one that it must not be. */
export async function settledPyramid(page, other = null) {
    await page.waitForFunction((id) => document.documentElement.dataset.state === 'settled' &&
        document.querySelector('[aria-current=true]') && document.querySelector('[aria-current=true]').dataset.result !== id, other);
    return page.locator('[aria-current=true]').getAttribute('data-result');
}

/** The second click on a button that asks first; both, where the question was taken back meanwhile: a busy machine is slower than its patience. */
export const clickOnceMore = (button) => button.evaluate((it) => {
    if (!it.classList.contains('alarm')) {
        it.click();
    }
    it.click();
});

export const shows = (page, points) => page.waitForFunction(
    (text) => document.getElementById('points').textContent === text, points.toLocaleString('en'));

/** The number that a card tells, also of a bound or an estimate. */
export const figure = async (page, id) => parseFloat((await page.locator(`#${id}`).innerText()).replace(/[\u2264\u2248]/, ''));

/** Until the picture at rest is drawn. */
export const rest = (page) => page.waitForFunction(() => document.documentElement.dataset.picture === 'rest');

/** The same of what has just been asked for: a moment passes before the picture is no longer at rest. */
export async function settle(page) {
    await page.waitForTimeout(100);
    await rest(page);
}

export const save = (page, name) => page.screenshot({ path: join(options.artifacts, `viewer-${name}.png`) });

/** The id of a job that has ended. */
export async function startJob(job) {
    const headers = { 'Content-Type': 'application/json' };
    const { id } = await (await fetch(`${server.url}/v1/jobs`, { method: 'POST', headers, body: JSON.stringify(job) })).json();
    const { status } = await (await fetch(`${server.url}/v1/jobs/${id}?wait=60`)).json();
    assert.equal(status, 'successful');
    return id;
}

export const cloudOf = async (id) => (await (await fetch(`${server.url}/v1/jobs/${id}`)).json()).request.input;

export const manifestOf = async (id) => (await fetch(`${server.url}/v1/jobs/${id}/results`)).json();

/** The stage once nothing moves any more. */
export async function restingPicture(page) {
    await settle(page);
    return browser.pixels(page, stageOf(page));
}

/** The share of the pixels that differ. */
export function differenceOf(a, b) {
    return shareOf(a, (red, green, blue, at) =>
        Math.abs(red - b.data[at]) + Math.abs(green - b.data[at + 1]) + Math.abs(blue - b.data[at + 2]) > 24);
}

/** The canvas without the cards and the legend on it. */
export const stageOf = (page) =>
    ({ x: 320, y: 70, width: page.viewportSize().width - 330, height: page.viewportSize().height - 250 });

/** The share of pixels that the cloud changes. */
export async function litShare(page, clip = stageOf(page)) {
    await settle(page);
    const shown = await browser.pixels(page, clip);
    const visibility = (value) => page.locator('#stage').evaluate((stage, to) => { stage.style.visibility = to; }, value);
    await visibility('hidden');
    const empty = await browser.pixels(page, clip);
    await visibility('visible');
    return shareOf(shown, (r, g, b, at) =>
        Math.abs(r - empty.data[at]) + Math.abs(g - empty.data[at + 1]) + Math.abs(b - empty.data[at + 2]) > 12);
}

/** The share of the pixels of a picture for which `test(red, green, blue, place)` holds. */
export function shareOf({ data, channels, count }, test) {
    let hits = 0;
    for (let at = 0; at < data.length; at += channels) {
        hits += test(data[at], data[at + 1], data[at + 2], at) ? 1 : 0;
    }
    return hits / count;
}
