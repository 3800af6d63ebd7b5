// How far the pictures of coarse levels in the viewer are from that of the finest one, from the same two places:
//
//     node bench/level_pictures.mjs --bin build/release/bin --modules build/dev/tests/e2e/viewers/node_modules CLOUD.ply...
//
// Of the pixels that the finest level covers, in percent: as many that a level covers beside them, and that it leaves open; and the mean
// difference of the channels where either is, of 255.
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { basename, join, resolve } from 'node:path';
import { setTimeout as pause } from 'node:timers/promises';
import { parseArgs } from 'node:util';
import { gunzipSync } from 'node:zlib';

import { Browser, findChromium } from '../tests/e2e/browser/browser.mjs';
import { decodePng } from '../tests/e2e/browser/png.mjs';
import { startServer } from '../tests/e2e/browser/server.mjs';
import { pyramidOf } from './server_pyramid.mjs';

const kViews = ['1,0.6,3,0,0,0', '-1.5,0.6,1.4,0,0,0'];  // positions and targets, in sizes of the cloud
const kVisible = 10;  // difference of a channel from the empty page
const kStillMs = 1500;

const { values: options, positionals: clouds } = parseArgs({
    options: { bin: { type: 'string' }, modules: { type: 'string' } },
    allowPositionals: true,
});
const playwright = createRequire(join(resolve(options.modules), 'package.json'))('playwright-core');
const server = await startServer(options.bin);
const browser = await Browser.launch(playwright, findChromium(), server.url);
const page = await browser.open('/', { width: 1100, height: 800 });

for (const path of clouds) {
    const bytes = readFileSync(path);
    const { id, manifest: { levels } } = await pyramidOf(server.url, path.endsWith('.gz') ? gunzipSync(bytes) : bytes, { method: 'multiphase' });
    console.log(`${basename(path)}: beside the finest level, open in it, difference`);
    const sums = levels.map(() => [0, 0, 0]);
    for (const view of kViews) {
        const finest = await pictureOf(`/?pyramid=${id}&view=${view}`);
        await page.locator('#stage').evaluate((stage) => { stage.style.visibility = 'hidden'; });
        const empty = decodePng(await page.screenshot());
        for (const { level } of levels.slice(0, -1)) {
            const coarse = await pictureOf(`/?pyramid=${id}&view=${view}&level=${level + 1}`);
            compared(coarse, finest, empty).forEach((value, k) => { sums[level][k] += value / kViews.length; });
        }
    }
    for (const { level, points } of levels.slice(0, -1)) {
        const [beside, open, difference] = sums[level];
        console.log(`  ${String(points).padStart(8)} points ${beside.toFixed(2).padStart(6)} % ${open.toFixed(2).padStart(6)} % ${difference.toFixed(1).padStart(6)}`);
    }
}
await browser.close();
await server.stop();

/** The stage alone, once its picture has not changed for a while. */
async function pictureOf(address) {
    await page.goto(server.url + address);
    await page.evaluate(() => {
        document.body.style.visibility = 'hidden';
        document.getElementById('stage').style.visibility = 'visible';
    });
    await page.waitForFunction(() => document.getElementById('points').textContent !== '');
    let [shown, since] = [null, 0];
    for (;;) {
        const now = await page.screenshot();
        if (!shown?.equals(now)) {
            [shown, since] = [now, performance.now()];
        } else if (performance.now() - since > kStillMs) {
            return decodePng(now);
        }
        await pause(200);
    }
}

function compared(coarse, finest, empty) {
    const isSeen = ({ data }, at) => [0, 1, 2].some((k) => Math.abs(data[at + k] - empty.data[at + k]) > kVisible);
    let covered = 0, beside = 0, open = 0, either = 0, differences = 0;
    for (let at = 0; at < finest.data.length; at += finest.channels) {
        const [inFinest, inCoarse] = [isSeen(finest, at), isSeen(coarse, at)];
        covered += inFinest;
        beside += inCoarse && !inFinest;
        open += inFinest && !inCoarse;
        if (inFinest || inCoarse) {
            either += 1;
            differences += [0, 1, 2].reduce((sum, k) => sum + Math.abs(finest.data[at + k] - coarse.data[at + k]) / 3, 0);
        }
    }
    return [100 * beside / covered, 100 * open / covered, differences / either];
}
