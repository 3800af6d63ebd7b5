// How long a person waits for the first picture of a cloud, on a line of 10 Mbit/s with 40 ms to and fro (Chromium's throttling, by
// request), in apps that are loaded already, with nothing of the cloud at hand:
//
//     node bench/first_picture.mjs --bin build/release/bin --modules build/dev/tests/e2e/viewers/node_modules CLOUD.ply...
//
// Prints the median of `--runs` for our viewer (a click on the result), 3d-tiles-renderer (the tileset) and three's DRACOLoader (all
// points in one file). The whole page too: our viewer by its address, with the page in the browser's cache.
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { basename, dirname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { parseArgs } from 'node:util';
import { gunzipSync } from 'node:zlib';

import { Browser, findChromium } from '../tests/e2e/browser/browser.mjs';
import { sphere } from '../tests/e2e/browser/clouds.mjs';
import { startServer } from '../tests/e2e/browser/server.mjs';
import { bundled, servePages } from '../tests/e2e/viewers/pages.mjs';
import { pyramidOf } from './server_pyramid.mjs';

const here = dirname(fileURLToPath(import.meta.url));
const { values: options, positionals: clouds } = parseArgs({
    options: {
        bin: { type: 'string' }, modules: { type: 'string' }, runs: { type: 'string', default: '7' },
        mbits: { type: 'string', default: '10' }, latency: { type: 'string', default: '40' },
    },
    allowPositionals: true,
});
const modules = resolve(options.modules);
const playwright = createRequire(join(modules, 'package.json'))('playwright-core');
const server = await startServer(options.bin);
const pages = await servePages({ app: await bundled(join(here, 'first_picture_page'), { modules }) }, modules);
const browser = await Browser.launch(playwright, findChromium(), server.url, pages.url);

const small = await pyramidOf(server.url, sphere(100));
for (const path of clouds) {
    const bytes = readFileSync(path);
    const cloud = await pyramidOf(server.url, path.endsWith('.gz') ? gunzipSync(bytes) : bytes);
    console.log(`${basename(path)}: ${cloud.manifest.levels.map(({ points }) => points).join(', ')} points`);
    const timed = {
        'our viewer': () => inOurViewer(cloud),
        'our viewer, the whole page': () => byAddress(cloud),
        '3d-tiles-renderer': () => inApp('showTiles', `/v1/pyramids/${cloud.id}/tileset.json`),
        '3d-tiles-renderer, inline': () => inApp('showTiles', `/v1/pyramids/${cloud.id}/tileset.json?inline=glb`),
        'one Draco file': () => inApp('showDraco', cloud.manifest.levels.at(-1).files.find(({ format }) => format === 'drc').href),
    };
    const times = Object.fromEntries(Object.keys(timed).map((name) => [name, []]));
    for (let run = 0; run < Number(options.runs); run += 1) {
        for (const [name, measure] of Object.entries(timed)) {
            times[name].push(await measure());
        }
    }
    for (const [name, all] of Object.entries(times)) {
        const sorted = all.sort((a, b) => a - b).map(Math.round);
        console.log(`  ${name.padEnd(28)} ${String(sorted[sorted.length >> 1]).padStart(6)} ms   (${sorted[0]} to ${sorted.at(-1)})`);
    }
}
await browser.close();
await server.stop();
pages.close();

/** From now on the page has a slow line. */
async function throttle(page) {
    const devtools = await page.context().newCDPSession(page);
    const throughput = Number(options.mbits) * 1e6 / 8;
    await devtools.send('Network.enable');
    await devtools.send('Network.emulateNetworkConditions', {
        offline: false, latency: Number(options.latency), downloadThroughput: throughput, uploadThroughput: throughput,
    });
}

function settled(page) {
    return page.waitForFunction(() => {
        const { state, picture } = document.documentElement.dataset;
        return state === 'settled' && picture === 'rest';
    });
}

/** The milliseconds from `started` to the coarsest level's picture. */
function firstPicture(page, started) {
    return page.evaluate(async (from) => {
        const name = 'stipple.level.0';
        while (performance.getEntriesByName(name).length === 0) {
            await new Promise((resolve) => { setTimeout(resolve, 5); });
        }
        return performance.getEntriesByName(name)[0].startTime - from;
    }, started);
}

/** From the click on a result; another one is shown before. */
async function inOurViewer({ id }) {
    const page = await browser.open(`/?pyramid=${small.id}`);
    await settled(page);
    await throttle(page);
    const started = await page.evaluate((result) => {
        const now = performance.now();
        document.querySelector(`[data-result="${result}"]`).click();
        return now;
    }, id);
    const time = await firstPicture(page, started);
    await page.context().close();
    return time;
}

/** From the navigation, when the page itself was seen before. */
async function byAddress({ id }) {
    const page = await browser.open(`/?pyramid=${small.id}`);
    await settled(page);
    await throttle(page);
    await page.goto(`${server.url}/?pyramid=${id}`);
    const time = await firstPicture(page, 0);
    await page.context().close();
    return time;
}

async function inApp(show, path) {
    const context = await browser.chromium.newContext({ viewport: { width: 1280, height: 800 } });
    const page = await context.newPage();
    await page.goto(`${pages.url}/pages/app/`);
    await page.waitForFunction(() => window.drawn);
    await throttle(page);
    const time = await page.evaluate(([name, url]) => window[name](url), [show, server.url + path]);
    await context.close();
    return time;
}
