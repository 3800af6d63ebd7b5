// What the viewer of a real server does when something goes wrong or comes at the wrong moment: outages, a lost graphics card, second clicks.
//
//     node trouble_test.mjs --bin build/dev/bin --modules FOLDER --artifacts FOLDER [--scale 1]
import assert from 'node:assert/strict';
import { mkdirSync, mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

import { broken, line, ply } from './clouds.mjs';
import {
    browser, choose, cloudOf, kTorusPoints, litShare, rest, run, save, scale, server, settledPyramid, shows, startJob, torus, visit,
} from './suite.mjs';

const page = await browser.open('/', { scale });
const lost = page.getByText('Connection lost; trying again');
let cloud = null;

await run({
    async 'A list that does not come is asked for again, and its notice goes'() {
        browser.refusalsExpected = true;
        let refuses = true;
        await page.route('**/v1/clouds?*', (route) => (refuses ? route.fulfill({ status: 503, body: '' }) : route.continue()));
        const told = lost.waitFor();
        await page.reload();
        await told;
        refuses = false;  // not before: on a busy machine the notice would be gone unseen
        await page.getByText('Drop a point cloud here').waitFor();
        await lost.waitFor({ state: 'detached' });
        await page.unrouteAll({ behavior: 'wait' });
        browser.refusalsExpected = false;
    },

    async 'On an empty page there is a cloud to try'() {
        await page.locator('#try').click();
        const pyramid = await settledPyramid(page);
        await shows(page, 160_000);
        assert.ok(await litShare(page) > 0.1);
        await save(page, 'ammonite');
        assert.equal(await page.locator('#title').innerText(), 'ammonite.ply');
        await fetch(`${server.url}/v1/clouds/${await cloudOf(pyramid)}`, { method: 'DELETE' });
        await fetch(`${server.url}/v1/jobs/${pyramid}`, { method: 'DELETE' });
        await page.goto(browser.url);
    },

    async 'A failed job keeps its reason, and the page invites to add another cloud'() {
        await choose(page, { name: 'broken.ply', buffer: broken() });
        await page.locator('#reason').getByText("'two': expected a number").waitFor();
        assert.equal(await page.locator('.notice').count(), 0);
        await save(page, 'failed');
        await page.goto(browser.url);
        await page.getByText('Drop a point cloud here').waitFor();
        assert.equal(await page.locator('#hud').isVisible(), false);
    },

    async 'Where no result is there yet, the newest one on its way is opened'() {
        await choose(page, torus);
        const pyramid = await settledPyramid(page);
        cloud = await cloudOf(pyramid);
        await page.route(`**/v1/jobs?*`, async (route) => {
            const response = await route.fetch();
            const json = await response.json();
            await route.fulfill({ response, json: { ...json, items: json.items.map((job) => (job.id === pyramid ? { ...job, status: 'running' } : job)) } });
        });
        await page.goto(browser.url);
        assert.equal(await settledPyramid(page), pyramid);
        await page.unrouteAll({ behavior: 'wait' });
    },

    async 'A decoder that does not come is asked for again, and the levels are shown'() {
        browser.refusalsExpected = true;
        let asked = 0;
        await page.route('**/assets/draco_decoder*', (route) => (asked++ < 2 ? route.abort('connectionreset') : route.continue()));
        const told = Promise.all([lost.waitFor(), page.locator('#activity').getByText('Waiting for the server').waitFor()]);
        await page.reload();
        await told;
        await shows(page, kTorusPoints);
        await lost.waitFor({ state: 'detached' });
        assert.equal(asked, 3);
        await page.unrouteAll();
        browser.refusalsExpected = false;
    },

    async 'Without WebGL 2 the page says so'() {
        const bare = await browser.open('/docs', { scale });
        await bare.addInitScript(() => { HTMLCanvasElement.prototype.getContext = () => null; });
        await bare.goto(browser.url);
        await bare.getByText('This browser does not support WebGL 2').waitFor();
        await save(bare, 'no-webgl');
        assert.equal(await bare.locator('#dock').isVisible(), false);
        await bare.close();
    },

    async 'A graphics card that was lost and comes back shows the picture again'() {
        const other = await browser.open('/', { scale });
        await settledPyramid(other);
        await rest(other);
        const lit = await litShare(other);
        browser.faultLevels = ['error'];  // what the lost card has left is given back to the new one
        await other.evaluate(() => {
            window.card = document.getElementById('stage').getContext('webgl2').getExtension('WEBGL_lose_context');
            window.card.loseContext();
        });
        const notice = other.getByText('The graphics context was lost');
        await notice.waitFor();
        await other.evaluate(() => window.card.restoreContext());
        await notice.waitFor({ state: 'detached' });
        await other.waitForTimeout(100);
        await rest(other);
        assert.ok(Math.abs(await litShare(other) - lit) < 0.01);
        await other.close();
        browser.faultLevels = ['error', 'warning'];
    },

    async 'A second click starts nothing twice'() {
        const { id } = await (await fetch(`${server.url}/v1/clouds?name=line.ply`, { method: 'POST', body: line(500) })).json();
        await page.reload();
        const before = await settledPyramid(page);
        await page.route('**/v1/jobs', async (route) => {
            await new Promise((resolve) => { setTimeout(resolve, 500); });
            await route.continue();
        });
        await page.locator('#clouds').getByText('line.ply').dblclick();
        await settledPyramid(page, before);
        await page.keyboard.press('1');
        await visit(page, `/?pyramid=${before}`);
        await page.keyboard.press('1');
        await page.locator('#files').getByText('Error map').dblclick();
        await settledPyramid(page, before);
        await page.unrouteAll();
        const { items } = await (await fetch(`${server.url}/v1/jobs`)).json();
        assert.equal(items.filter(({ request }) => request.input === id).length, 1);
        assert.equal(items.filter(({ type }) => type === 'evaluate').length, 1);
        await page.keyboard.press('l');
    },

    async 'A cloud that was sent while another result was opened is offered, not shown'() {
        const job = await startJob({ type: 'simplify', input: cloud, points: 700, format: 'drc' });
        await page.getByRole('button', { name: 'Process' }).first().click();
        await page.route('**/v1/clouds?name=*', async (route) => {
            await visit(page, `/?job=${job}`);
            await route.continue();
        });
        await choose(page, { name: 'late.ply', buffer: line(600) });
        const notice = page.locator('.notice');
        await notice.getByText('late.ply was added').waitFor();
        assert.equal(await page.locator('#job-dialog').isVisible(), false);  // what is added would be behind it
        assert.equal(await settledPyramid(page), job);
        await save(page, 'offer');
        await notice.getByRole('button', { name: 'Open it' }).click();
        await settledPyramid(page, job);
        await shows(page, 600);
        assert.equal(await notice.count(), 0);
        await page.unrouteAll();
    },

    async 'Several files are counted, and one that was there under another name is told'() {
        const before = await settledPyramid(page);
        await page.locator('#file').setInputFiles([610, 620].map((points) => ({ name: `${points}.ply`, buffer: line(points), mimeType: 'application/octet-stream' })));
        await page.getByText('2 clouds were added').waitFor();
        const last = await settledPyramid(page, before);
        await shows(page, 620);
        await page.locator('#clouds').getByText('610.ply').waitFor();
        await choose(page, { name: 'another.ply', buffer: line(610) });
        await page.getByText('another.ply is the same cloud as 610.ply').waitFor();
        await settledPyramid(page, last);
        await shows(page, 610);
    },

    async 'Files wait for each other, are called off, and are sent again after an outage'() {
        browser.refusalsExpected = true;
        const before = await settledPyramid(page);
        const asked = [];
        let isOnline = false;
        await page.route('**/v1/clouds?name=*', async (route) => {
            const name = new URL(route.request().url()).searchParams.get('name');
            asked.push(name);
            if (name === 'long.ply') {
                return;  // it is under way for as long as the test wants
            }
            await (isOnline ? route.continue() : route.abort('connectionreset'));
        });
        await choose(page, { name: 'long.ply', buffer: line(500) });
        await page.getByLabel('Upload of long.ply').waitFor();
        for (const name of ['unwanted.ply', 'again.ply']) {
            await choose(page, { name, buffer: line(550) });
            await page.locator('#uploads').getByText(name).waitFor();
        }
        await save(page, 'uploads');
        for (const name of ['unwanted.ply', 'long.ply']) {
            await page.getByLabel(`Cancel ${name}`).click();
        }
        await page.getByText('again.ply was not sent').waitFor();
        assert.deepEqual(asked, ['long.ply', 'again.ply']);
        assert.equal(await page.locator('#uploads > li').count(), 0);
        isOnline = true;
        await page.getByRole('button', { name: 'Try again' }).click();
        await settledPyramid(page, before);
        await shows(page, 550);
        assert.equal(await page.locator('.notice').count(), 0);
        await page.unrouteAll();
        browser.refusalsExpected = false;
    },

    async 'Notices go by Escape, the newest first, and when another result is opened'() {
        const notices = async () => (await page.locator('.notice strong').allInnerTexts()).join();
        const chooseEmpty = async () => {
            for (const name of ['one.ply', 'two.ply']) {
                await choose(page, { name, buffer: Buffer.alloc(0) });
                await page.getByText(`${name} was not accepted`).waitFor();
            }
        };
        await chooseEmpty();
        assert.equal(await notices(), 'two.ply was not accepted');  // that of the upload before is gone
        await page.getByText('The file is empty').waitFor();
        await page.locator('#stage').press('Escape');
        assert.equal(await notices(), '');
        const several = ['a.las', 'b.las', 'c.txt', 'd.txt', 'e.txt'];
        await page.locator('#file').setInputFiles(several.map((name) => ({ name, buffer: Buffer.alloc(0), mimeType: 'application/octet-stream' })));
        await page.getByText('5 files were not accepted').waitFor();
        assert.deepEqual((await page.locator('.notice p').innerText()).split('\n').map((line) => line.split(':')[0]), several);
        await chooseEmpty();
        await page.locator('#results .row').first().click();
        assert.equal(await notices(), '');
    },

    async 'Beside a result that is gone there is the finest level of what is left'() {
        browser.refusalsExpected = true;
        const id = await settledPyramid(page);
        await visit(page, `/?pyramid=${id}&with=${'0'.repeat(32)}`);
        await page.getByText('It may have been removed').waitFor();
        await page.locator('#right-label').getByText('points').waitFor();
        assert.match(await page.locator('#compare-with').inputValue(), /^level:/);
        await page.keyboard.press('c');
        await rest(page);  // what the browser says of a refusal may come late
        browser.refusalsExpected = false;
    },

    async 'What was cleaned away is told'() {
        const before = await settledPyramid(page);
        await choose(page, { name: 'twice.ply', buffer: ply(Array.from({ length: 600 }, (_, i) => [Math.floor(i / 2) / 300, 0, 0]), false) });
        await settledPyramid(page, before);
        await shows(page, 300);
        await page.locator('#activity').getByText('300 duplicates left out').waitFor();
        await page.locator('#clouds').getByText('300 of 600 points').waitFor();
    },

    async 'A dropped folder is called one'() {
        const parent = mkdtempSync(join(tmpdir(), 'stipple-folder-'));
        const folder = join(parent, 'scans.ply');
        mkdirSync(folder);
        const devtools = await page.context().newCDPSession(page);
        for (const type of ['dragEnter', 'dragOver', 'drop']) {
            await devtools.send('Input.dispatchDragEvent', { type, x: 700, y: 300, data: { items: [], files: [folder], dragOperationsMask: 1 } });
        }
        await page.getByText('scans.ply is a folder').waitFor();
        await page.locator('.notice button').focus();
        await page.keyboard.press('Enter');
        assert.equal(await page.evaluate(() => document.activeElement.id), 'stage');
        rmSync(parent, { recursive: true });
    },

    async 'On a slow line the bytes are told as they come'() {
        const before = await settledPyramid(page);
        const { id } = await (await fetch(`${server.url}/v1/clouds?name=slow.ply`, { method: 'POST', body: torus.buffer })).json();
        const slow = await startJob({ type: 'pyramid', input: id, formats: ['drc'], method: 'random' });
        await page.evaluate(() => dispatchEvent(new Event('focus')));  // the lists are asked for anew
        await page.locator(`#result-${slow}`).waitFor();
        const devtools = await page.context().newCDPSession(page);
        await devtools.send('Network.enable');
        const limit = (downloadThroughput) => devtools.send('Network.emulateNetworkConditions', { offline: false, latency: 0, downloadThroughput, uploadThroughput: -1 });
        await limit(50_000);
        await page.locator(`#result-${slow}`).click();
        await page.locator('#activity-share').getByText(/^, [1-9]\d? %$/).waitFor();
        await page.waitForFunction(() => [...document.querySelectorAll('#segments li.loading')].some(({ style }) => Number(style.getPropertyValue('--arrived')) > 0));
        await limit(-1);
        await settledPyramid(page, before);
        await devtools.detach();
    },

    async 'Clouds of other places, or in other units, are compared with a word about that'() {
        const near = await settledPyramid(page);
        for (const [name, place, word] of [['far.ply', (i) => [50 + i / 500, 0, 0], 'lies elsewhere'], ['large.ply', (i) => [2 * i, 0, 0], 'in different units?']]) {
            const body = ply(Array.from({ length: 500 }, (_, i) => place(i)), false);
            const { id } = await (await fetch(`${server.url}/v1/clouds?name=${name}`, { method: 'POST', body })).json();
            const other = await startJob({ type: 'pyramid', input: id, formats: ['drc'] });
            await visit(page, `/?pyramid=${near}&with=${other}`);
            await page.locator('#right-label').getByText(word).waitFor();
            await page.locator('#right-label').getByText('hierarchical').waitFor();  // by which method it was made
        }
    },

    async 'Older results are listed when they are asked for'() {
        const { items: all } = await (await fetch(`${server.url}/v1/jobs`)).json();
        await page.route('**/v1/jobs?*', async (route) => {
            const isLater = new URL(route.request().url()).searchParams.get('cursor') === 'later';
            const newest = Array.from({ length: 100 }, (_, i) => ({ ...all[0], id: `newer-${i}` }));
            await route.fulfill({ json: isLater ? { items: all } : { items: newest, next: 'later' } });
        });
        await page.reload();
        const rows = (count) => page.waitForFunction((wanted) => document.querySelectorAll('#results .row').length === wanted, count);
        await rows(100);
        await save(page, 'older');
        await page.locator('#older-results').press('Enter');
        await rows(100 + all.length);
        assert.equal(await page.locator('#older-results').isVisible(), false);
        assert.equal(await page.evaluate(() => document.activeElement.className), 'row');
        await page.unrouteAll();
    },
});
