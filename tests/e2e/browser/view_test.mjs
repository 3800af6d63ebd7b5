// A cloud in the viewer of a real server: how it comes, what is seen of it, what a person can do to the picture, and
// who is let in.
//
//     node view_test.mjs --bin build/dev/bin --modules FOLDER --artifacts FOLDER [--scan igea.ply] [--scale 1]
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';

import { Browser } from './browser.mjs';
import { line, ply, waves } from './clouds.mjs';
import { decodePng } from './png.mjs';
import { startServer } from './server.mjs';
import {
    browser, choose, differenceOf, kTorusPoints, litShare, manifestOf, options, rest, restingPicture, run, save, scale, scan,
    settledPyramid, shareOf, shows, stageOf, torus,
} from './suite.mjs';

const page = await browser.open('/', { scale });
let torusPyramid = null;

await run({
    async 'An empty server invites to add a cloud'() {
        await page.getByText('Drop a point cloud here').waitFor();
        assert.equal(await page.locator('#hud').isVisible(), false);
    },

    async 'A chosen file becomes a pyramid that is shown coarse to fine'() {
        await choose(page, torus);
        torusPyramid = await settledPyramid(page);
        assert.equal(await page.locator('#title').innerText(), torus.name);
        const { levels } = await manifestOf(torusPyramid);
        const finest = levels.at(-1);
        assert.ok(levels.length >= 2, `${levels.length} levels`);
        assert.equal(finest.points, kTorusPoints);
        const marks = await page.evaluate(() => performance.getEntriesByType('mark').map(({ name, detail }) => [name, detail.points]));
        assert.deepEqual(marks[0], ['stipple.level.0', levels[0].points]);
        assert.deepEqual(marks.at(-1), [`stipple.level.${finest.level}`, finest.points]);
    },

    async 'The coarsest level needs no request of its own'() {
        const asked = [];
        page.on('request', (request) => asked.push(new URL(request.url()).pathname));
        await page.goto(`${browser.url}/?pyramid=${torusPyramid}`);
        await settledPyramid(page);
        const { levels } = await manifestOf(torusPyramid);
        const isAsked = levels.map(({ files }) => asked.includes(files.find(({ format }) => format === 'drc').href));
        assert.deepEqual(isAsked, levels.map(({ level }) => level > 0));
    },

    async 'The figures are those of the manifest'() {
        const { levels } = await manifestOf(torusPyramid);
        const figure = (id) => page.locator(`#${id}`).innerText();
        assert.equal(await figure('points'), levels.at(-1).points.toLocaleString('en'));
        assert.equal(await figure('level-name'), `${levels.length} of ${levels.length}`);
        assert.match(await figure('first-picture'), /^[\d.]+ m?s$/);
        const bytes = levels.flatMap(({ files }) => files).filter(({ format }) => format === 'drc')
            .reduce((sum, file) => sum + file.bytes, 0);
        assert.ok(Math.abs(parseFloat(await figure('bytes')) * 1000 - bytes) <= 0.006 * bytes + 500, await figure('bytes'));
    },

    async 'A coloured cloud shows its colours'() {
        await rest(page);
        await save(page, 'colour');
        const picture = await browser.pixels(page, stageOf(page));
        const shares = {
            red: shareOf(picture, (r, g, b) => r > 1.8 * g && r > 1.8 * b && r > 90),
            green: shareOf(picture, (r, g, b) => g > 1.5 * r && g > 1.5 * b && g > 90),
            blue: shareOf(picture, (r, g, b) => b > 1.5 * r && b > 1.5 * g && b > 90),
        };
        for (const [name, value] of Object.entries(shares)) {
            assert.ok(value > 0.03, `${name}: ${(100 * value).toFixed(1)} % of the pixels`);
        }
    },

    async 'A key and the slider choose the level'() {
        const { levels } = await manifestOf(torusPyramid);
        await page.keyboard.press('1');
        await shows(page, levels[0].points);
        await page.locator('#level').fill(String(levels.length));
        await shows(page, levels.at(-1).points);
    },

    async 'Colours can stand for normals or for a coordinate, with a legend'() {
        const own = await restingPicture(page);
        await page.keyboard.press('l');
        await page.locator('#color').selectOption('x');
        assert.match(await page.locator('#legend-high').innerText(), /^[\d.]+$/);
        await save(page, 'look');
        await page.keyboard.press('l');
        assert.ok(differenceOf(own, await restingPicture(page)) > 0.1);
    },

    async 'A key shows the keys'() {
        await page.keyboard.press('?');
        await page.getByText('Focus on a point').waitFor();
        await save(page, 'help');
        await page.getByRole('button', { name: 'Close' }).click();
        assert.equal(await page.locator('#help-dialog').isVisible(), false);
    },

    async 'Keys that act anywhere can be switched off, and stay so'() {
        const press = async (expected) => {
            await page.keyboard.press('l');
            assert.equal(await page.locator('#look-card').isVisible(), expected);
        };
        for (const isOn of [false, true]) {
            await page.locator('#help').click();
            await page.locator('#shortcuts').setChecked(isOn);
            await page.keyboard.press('Escape');
            await press(isOn);
            await page.reload();
            await settledPyramid(page);
            await press(isOn);
        }
        await press(false);
    },

    async 'The focus stays where it was, or goes on to what is next'() {
        const focused = () => page.evaluate(() => document.activeElement.id);
        await page.locator(`#result-${torusPyramid}`).press('Enter');
        await settledPyramid(page);
        assert.equal(await focused(), `result-${torusPyramid}`);
        const { id } = await (await fetch(`${browser.url}/v1/clouds?name=line.ply`, { method: 'POST', body: line(300) })).json();
        await page.evaluate(() => dispatchEvent(new Event('focus')));  // the lists are asked for anew
        await page.locator(`#cloud-${id}`).waitFor();
        assert.equal(await focused(), `result-${torusPyramid}`);
        await page.locator('#action-drc').focus();
        await page.keyboard.press('1');
        await page.locator('#action-map').waitFor();
        assert.equal(await focused(), 'action-drc');
        await page.keyboard.press('c');
        await page.locator('#divider').press('Escape');
        assert.equal(await focused(), 'compare');
        await fetch(`${browser.url}/v1/clouds/${id}`, { method: 'DELETE' });
    },

    async 'A card that a key opens has the focus, and gives it back'() {
        const focused = () => page.evaluate(() => document.activeElement.id);
        for (const [key, card, first] of [['l', 'look-card', 'color'], ['s', 'share-card', 'share-link']]) {
            for (const end of ['Escape', key]) {
                await page.locator('#level').press(key);
                assert.equal(await focused(), first);
                assert.equal(await page.locator(`[aria-controls=${card}]`).getAttribute('aria-expanded'), 'true');
                await page.keyboard.press(end);
                assert.equal(await focused(), 'level');
                assert.equal(await page.locator(`#${card}`).isVisible(), false);
            }
        }
        await page.getByRole('application', { name: 'The point cloud' }).waitFor();
    },

    async 'By keys the cloud is moved, and a point is looked at'() {
        const view = () => page.evaluate(() => new URL(location.href).searchParams.get('view')?.split(',').map(Number) ?? null);
        const atRest = async (value) => {
            for (let before = await value(); ; ) {
                await page.waitForTimeout(500);
                const now = await value();
                if (`${now}` === `${before}`) return now;
                before = now;
            }
        };
        await page.locator('#fit').click();
        await page.waitForFunction(() => !new URL(location.href).searchParams.has('view'));
        for (let press = 0; press < 8; press += 1) {
            await page.locator('#stage').press('Shift+ArrowRight');  // from the hole of the torus to its ring
        }
        // The address follows while the cloud still moves.
        await page.waitForFunction(() => Math.hypot(...(new URL(location.href).searchParams.get('view') ?? '').split(',').slice(3).map(Number)) > 0.1);
        const panned = await atRest(view);
        await page.locator('#stage').press('Enter');
        await page.waitForFunction((old) => new URL(location.href).searchParams.get('view') !== old, panned.join());
        const near = await atRest(view);
        const distance = ([px, py, pz, tx, ty, tz]) => Math.hypot(px - tx, py - ty, pz - tz);
        assert.ok(distance(near) < 0.6 * distance(panned), `${distance(near)} of ${distance(panned)}`);
        await page.locator('#fit').click();
        await page.waitForFunction(() => !new URL(location.href).searchParams.has('view'));
    },

    async 'It rotates as fast where frames are slow'() {
        const frame = 0.15;  // s, of a clock that does not go on while the machine has other things to do
        await page.evaluate((ms) => {
            const { requestAnimationFrame: ask } = window;
            let now = performance.now();
            window.turned = 0;  // frames
            window.requestAnimationFrame = (draw) => ask(() => setTimeout(() => ask(() => {
                now += ms;
                window.turned += document.getElementById('rotate').ariaPressed === 'true' ? 1 : 0;
                draw(now);
            }), ms));
            window.speedUp = () => { window.requestAnimationFrame = ask; };
        }, 1000 * frame);
        await page.locator('#stage').focus();
        await page.keyboard.press(' ');
        await page.waitForFunction(() => window.turned >= 12);
        await page.keyboard.press(' ');
        const seconds = frame * await page.evaluate(() => window.turned);
        await page.evaluate(() => window.speedUp());
        await page.waitForFunction(() => new URL(location.href).searchParams.has('view'));
        const [x, y] = new URL(page.url()).searchParams.get('view').split(',').map(Number);
        const turns = Math.abs(Math.atan2(y, x) - Math.atan2(-1, -0.45)) / (2 * Math.PI);  // from where a cloud that lies along z is looked at
        assert.ok(Math.abs(40 * turns - seconds) < 2 * frame, `${360 * turns} degrees in ${seconds} s`);
        await page.locator('#fit').click();
    },

    async 'A dropped scan fills the picture, in the dark and in the light'() {
        await drop(page, scan);
        const pyramid = await settledPyramid(page, torusPyramid);
        await rest(page);
        await save(page, 'dark');
        assert.equal(await page.locator('#color').inputValue(), 'clay');  // not what was chosen for the cloud before
        const { levels } = await manifestOf(pyramid);
        await shows(page, levels.at(-1).points);
        const lit = await litShare(page);
        assert.ok(lit > 0.15 && lit < 0.85, `${(100 * lit).toFixed(1)} % of the pixels`);
        await page.emulateMedia({ colorScheme: 'light' });
        await rest(page);
        await save(page, 'light');
        const litInLight = await litShare(page);
        assert.ok(Math.abs(litInLight - lit) < 0.05, `${(100 * litInLight).toFixed(1)} % of the pixels`);
    },

    async 'The cloud before has the colours that were chosen for it when one goes back'() {
        await page.goBack();
        await settledPyramid(page);
        assert.equal(await page.locator('#color').inputValue(), 'x');
        await page.goForward();
        await settledPyramid(page, torusPyramid);
        assert.equal(await page.locator('#color').inputValue(), 'clay');
    },

    async 'Two levels are compared by a line that is moved, and side by side'() {
        await countTextures(page);
        await page.keyboard.press('c');
        await page.locator('#right-label').getByText('B').waitFor();
        await page.locator('#compare-with').selectOption('level:0');
        await rest(page);
        await save(page, 'compare');
        const half = await restingPicture(page);
        await page.locator('#divider').press('ArrowLeft');
        assert.ok(differenceOf(half, await restingPicture(page)) > 1e-4);
        await page.getByRole('button', { name: 'Side by side' }).click();
        assert.ok(differenceOf(half, await restingPicture(page)) > 0.05);
        await page.keyboard.press('c');
        assert.equal(await page.locator('#divider').isVisible(), false);
        await restingPicture(page);
        assert.equal(await page.evaluate(() => window.textures), 0);  // those of the right are gone
    },

    async 'Both sides of a comparison have the colours that are chosen, and one legend'() {
        const rightOf = async () => (await restingPicture(page), browser.pixels(page, { ...stageOf(page), x: 820, width: 120 }));
        await page.keyboard.press('c');
        await page.locator('#right-label').getByText('B').waitFor();
        const own = await rightOf();
        await page.locator('#compare-with').evaluate((select, to) => {
            for (const value of [to, select.value]) {  // there and back, before the other result is there
                select.value = value;
                select.dispatchEvent(new Event('change'));
            }
        }, `result:${torusPyramid}`);
        assert.equal(differenceOf(own, await rightOf()), 0);
        await page.keyboard.press('l');
        await page.locator('#color').selectOption('y');
        await page.locator('#legend-name').getByText('Position, y').waitFor();
        await page.keyboard.press('l');
        assert.ok(differenceOf(own, await rightOf()) > 0.1);
        await page.keyboard.press('c');
        await page.locator('#color').evaluate((select) => { select.value = 'clay'; select.dispatchEvent(new Event('change')); });
    },

    async 'The address has how it is looked at, so that a reload shows the same'() {
        const stays = async (...names) => {
            const told = () => Object.fromEntries(names.map((name) => [name, new URL(page.url()).searchParams.get(name)]));
            await page.waitForFunction((wanted) => wanted.every((name) => new URL(location.href).searchParams.has(name)), names);
            const picture = await restingPicture(page);
            const before = told();
            await page.reload();
            await settledPyramid(page);
            await rest(page);
            assert.ok(differenceOf(picture, await restingPicture(page)) < 0.01, names.join());
            assert.deepEqual(told(), before);
        };
        await page.goto(`${browser.url}/?pyramid=${torusPyramid}`);
        await settledPyramid(page);
        const { levels } = await manifestOf(torusPyramid);
        const setInput = (id, value) => page.locator(id).evaluate((input, to) => {
            input.value = input[to] || to;
            input.dispatchEvent(new Event('input'));
        }, value);
        await setInput('#error-bound', 'min');
        await shows(page, levels[0].points);
        await setInput('#splat-size', '-0.5');
        await setInput('#shading', '2');
        await page.locator('#color').evaluate((select) => { select.value = 'y'; select.dispatchEvent(new Event('change')); });
        await page.locator('#stage').press('ArrowLeft');
        await page.locator('#stage').press('+');
        await stays('error', 'splat', 'shading', 'color', 'view');
        assert.equal(await page.locator('#points').innerText(), levels[0].points.toLocaleString('en'));
        await page.keyboard.press('c');
        await page.locator('#divider').press('ArrowRight');
        await stays('beside', 'at', 'view');
        const scanned = await page.locator('#compare-with option').evaluateAll((options) => options.find(({ value }) => value.startsWith('result:')).value);
        await page.locator('#compare-with').selectOption(scanned);
        await page.getByRole('button', { name: 'Side by side' }).click();
        await page.locator('#right-label').getByText('points').waitFor();
        await page.waitForFunction((value) => location.search.includes(`with=${value}`) && location.search.includes('layout=beside'), scanned.split(':')[1]);
        await page.reload();
        await settledPyramid(page);
        await page.waitForFunction((value) => document.getElementById('compare-with').value === value, scanned);
        await page.getByRole('button', { name: 'Swipe' }).waitFor();
        await page.keyboard.press('c');
        await page.waitForFunction(() => !new URL(location.href).searchParams.has('with'));
        await page.locator('#level').fill(String(levels.length));
        await page.locator('#results').getByText(scan.name).first().click();
        await settledPyramid(page, torusPyramid);
    },

    async 'The view is kept though the page is loaded anew before the cloud has come to rest'() {
        const { x, y, width, height } = stageOf(page);
        await page.mouse.move(x + width / 2, y + height / 2);
        await page.mouse.down();
        await page.mouse.move(x + width / 2 + 90, y + height / 2, { steps: 3 });
        await page.mouse.up();
        await page.evaluate(() => { window.requestAnimationFrame = () => 0; });  // no picture more
        await page.waitForFunction(() => new URL(location.href).searchParams.has('view'));
        await page.reload();
        await settledPyramid(page);
        await page.locator('#fit').click();
        await page.waitForFunction(() => !new URL(location.href).searchParams.has('view'));
    },

    async 'What is shown is taken elsewhere: as a link, as a picture, in lines for another program'() {
        const shown = await settledPyramid(page);
        await page.context().grantPermissions(['clipboard-read', 'clipboard-write']);
        const copied = () => page.evaluate(() => navigator.clipboard.readText());
        await page.locator('#stage').press('s');
        await page.locator('#share-link').click();
        await page.locator('#share-link').getByText('Copied').waitFor();
        assert.equal(new URL(await copied()).searchParams.get('pyramid'), shown);
        const [download] = await Promise.all([page.waitForEvent('download'), page.locator('#share-picture').click()]);
        const { data, channels } = decodePng(readFileSync(await download.path()));
        assert.equal(channels, 4);
        const opacities = data.filter((_, at) => at % 4 === 3);
        assert.ok(opacities.some((alpha) => alpha === 0) && opacities.some((alpha) => alpha === 255));
        assert.deepEqual(await page.locator('#share-for option').allInnerTexts(), ['three.js, one level', 'loaders.gl, one level', 'curl']);
        await page.locator('#share-for').selectOption('curl');
        await page.locator('#share-copy').click();
        await page.locator('#share-copy').getByText('Copied').waitFor();
        const [manifest] = /http\S+manifest\.json/.exec(await copied());
        assert.equal((await (await fetch(manifest)).json()).complete, true);
        await page.locator('#share-card').press('Escape');
        assert.equal(await page.locator('#share-card').isVisible(), false);
    },

    async 'Going back shows the result before'() {
        await page.goBack();
        assert.equal(await settledPyramid(page), torusPyramid);
        await shows(page, kTorusPoints);
    },

    async 'A phone shows the cloud above the sheet'() {
        const phone = await browser.open('/', { width: 390, height: 844, scale: 2 * scale });
        await settledPyramid(phone);
        await rest(phone);
        await save(phone, 'phone');
        const dock = await phone.locator('#dock').boundingBox();
        const lit = await litShare(phone, { x: 0, y: 60, width: 390, height: dock.y - 60 });
        assert.ok(lit > 0.1, `${(100 * lit).toFixed(1)} % of the pixels`);
        assert.equal(await phone.evaluate(() => document.documentElement.scrollWidth), 390);
        await phone.locator('#grip').click();
        await phone.getByText('Add a point cloud').waitFor();
        await phone.context().close();
    },

    async 'On a phone the card is folded to its title by a button or a swipe, and unfolded by the grip'() {
        const phone = await browser.open('/', { width: 320, height: 568, scale });
        await settledPyramid(phone);
        const [grip, figures] = [phone.locator('#grip'), phone.locator('.figures')];
        const top = async () => (await phone.locator('#dock').boundingBox()).y;
        const swipe = async (distance) => {
            const { x, y, width, height } = await grip.boundingBox();
            await phone.mouse.move(x + width / 2, y + height / 2);
            await phone.mouse.down();
            await phone.mouse.move(x + width / 2, y + height / 2 + distance);
            await phone.mouse.up();
        };
        const before = await top();
        await phone.getByRole('button', { name: 'Hide level and figures' }).press('Enter');
        assert.ok(await top() > before + 150, `${before} to ${await top()}`);
        assert.equal(await figures.isVisible(), false);
        assert.equal(await phone.locator('#title').isVisible(), true);
        assert.equal(await phone.evaluate(() => document.activeElement.ariaLabel), 'Show level and figures');
        await phone.keyboard.press('Enter');
        assert.equal(await top(), before);
        await swipe(60);
        assert.equal(await figures.isVisible(), false);
        await swipe(-60);
        assert.equal(await figures.isVisible(), true);
        assert.equal(await phone.locator('#library').isVisible(), false);
        await swipe(-60);
        assert.equal(await grip.getAttribute('aria-expanded'), 'true');
        await phone.context().close();
    },

    async 'In a window as low as one at 400 % zoom two are compared without what lies on them'() {
        const low = await browser.open(`/?pyramid=${torusPyramid}&color=x&beside=1`, { width: 360, height: 225, scale });
        await low.locator('#compare-with').waitFor();
        await settledPyramid(low);
        const isOnTop = (id) => low.locator(`#${id}`).evaluate((it) => {
            const { x, y, width, height } = it.getBoundingClientRect();
            return it.contains(document.elementFromPoint(x + width / 2, y + height / 2));
        });
        assert.deepEqual(await Promise.all(['compare-with', 'compare-mode', 'divider'].map(isOnTop)), [true, true, true]);
        assert.equal(await low.locator('#legend').isVisible(), false);
        assert.ok((await low.locator('#dock').boundingBox()).y > 150);
        await low.keyboard.press('c');
        assert.equal(await low.locator('#legend').isVisible(), true);
        await low.context().close();
    },

    async 'Splats of slopes that are seen from the side lie on them, as smaller ones do'() {
        const side = 200;
        await page.locator('#look').click();
        await page.locator('#look-reset').click();  // of the link before: smaller ones than meet
        await page.locator('#look').click();
        await choose(page, { name: 'waves.ply', buffer: waves(side) });
        await shows(page, side * side);
        const { x, y, width, height } = stageOf(page);
        await page.mouse.move(x + width / 2, y + height / 2);
        await page.mouse.down();
        await page.mouse.move(x + width / 2, y + height / 2 - 60);
        await page.mouse.up();
        const many = await restingPicture(page);
        await page.keyboard.press('1');
        await shows(page, side * side / 4);
        const share = differenceOf(many, await restingPicture(page));
        await save(page, 'waves');
        assert.ok(share < 0.04, `${(100 * share).toFixed(1)} % of the pixels`);
    },

    async 'A legend tells coordinates as they are in the file, and classes by their names'() {
        const points = Array.from({ length: 3000 }, (_, i) => [465_000 + i % 60, 5_247_000 + Math.floor(i / 60), 400 + (i % 7) / 10]);
        const buffer = ply(points, false, { type: 'double', scalars: { classification: ([x]) => (x % 2 === 0 ? 2 : 6), gps_time: ([x]) => 1.3e9 + x - 465_000, stamp: ([x]) => 1.7e12 + 10 * x, pulse: ([x]) => 3.2e8 + 32 * (x % 7) } });
        const before = await settledPyramid(page);
        await choose(page, { name: 'terrain.ply', buffer });
        await settledPyramid(page, before);
        const colorBy = (by) => page.locator('#color').evaluate((select, value) => {
            select.value = value;
            select.dispatchEvent(new Event('change'));
        }, by);
        await colorBy('x');
        await page.getByRole('region', { name: 'What is shown' }).getByRole('group', { name: 'Legend' }).getByText('Position, x').waitFor();
        assert.deepEqual(await page.locator('#legend-scale').innerText(), '465,000\n465,059');
        await colorBy('gps_time');
        await page.locator('#legend-name').getByText('Gps time').waitFor();
        assert.deepEqual(await page.locator('#legend-scale').innerText(), '1,300,000,000\n1,300,000,059');
        await colorBy('pulse');
        await page.locator('#legend-name').getByText('Pulse').waitFor();
        assert.equal(await page.locator('#legend-scale').isVisible(), true);  // no categories, though there are few whole numbers
        const mark = (end) => page.locator(`#legend-${end}`).evaluate((it) => getComputedStyle(it, '::before').content);
        assert.equal(await mark('high'), '"\u2248 "');  // what was after the point is lost
        await colorBy('stamp');
        await page.locator('#legend-categories').getByText('\u2248\u00a01,700,005,000,000').waitFor();  // closer than single precision tells apart
        await colorBy('classification');
        await page.locator('#legend-categories').getByText('Building').waitFor();
        assert.equal(await page.locator('#legend-categories').innerText(), 'Ground\nBuilding');
        await rest(page);
        const { x, y, width, height } = stageOf(page);
        await page.locator('#stage').dblclick({ position: { x: x + width / 2, y: y + height / 2 } });
        await page.locator('#point').getByText('Classification').waitFor();
        await save(page, 'classes');
        const [place, kind] = (await page.locator('#point').innerText()).split('\n');
        const [east, north] = place.replaceAll(',', '').split(/\s+/).map(Number);
        assert.ok(Math.abs(east - 465_030) < 31 && Math.abs(north - 5_247_025) < 26, place);
        assert.equal(kind, `Classification: ${Math.round(east) % 2 === 0 ? 'Ground' : 'Building'}`);
        await page.locator('#fit').click();
        assert.equal(await page.locator('#point').isVisible(), false);
    },

    async 'A server with keys asks for one, again after a wrong one, and then shows all'() {
        const key = 'correct horse battery staple';
        const keyed = await startServer(options.bin, { key });
        const visitor = new Browser(browser.chromium, keyed.url);
        visitor.refusalsExpected = true;
        try {
            const stranger = await visitor.open('/', { scale });
            for (const [entry, reason] of [['wrong', 'This server asks for an API key'], [key, 'this API key is unknown']]) {
                await stranger.getByText(reason).waitFor();
                await save(stranger, 'key');
                await stranger.locator('#key').fill('ключ');  // no header can carry it
                await stranger.getByRole('button', { name: 'Continue' }).click();
                assert.equal(await stranger.locator('#key').evaluate((input) => input.validity.patternMismatch), true);
                for (let press = 0; press < 3; press += 1) {
                    await stranger.keyboard.press('Escape');  // there is no way around it
                }
                await stranger.locator('#key').fill(entry);
                await stranger.getByRole('button', { name: 'Continue' }).click();
            }
            await stranger.getByText('Drop a point cloud here').waitFor();
            await choose(stranger, { name: 'line.ply', buffer: line(500) });
            await settledPyramid(stranger);
            await stranger.evaluate(() => localStorage.setItem('stipple.api-key', 'ключ'));  // kept by an older page
            await stranger.reload();
            await settledPyramid(stranger);
            assert.deepEqual(visitor.faults, []);
        } finally {
            await keyed.stop();
        }
    },

    async 'Under a path of a proxy the page is all there'() {
        const proxied = await startServer(options.bin, { flags: ['--path-prefix', '/scans/lab'] });
        const visitor = new Browser(browser.chromium, proxied.url);
        try {
            const guest = await visitor.open('/scans/lab', { scale });  // it leads to the same with a slash
            await choose(guest, { name: 'line.ply', buffer: line(500) });
            await settledPyramid(guest);
            await guest.reload();
            await settledPyramid(guest);
            assert.match(guest.url(), /\/scans\/lab\/\?/);
            assert.deepEqual(visitor.faults, []);
        } finally {
            await proxied.stop();
        }
    },
});

/** Counts in `window.textures` how many there are more than now. */
function countTextures(target) {
    return target.evaluate(() => {
        window.textures = 0;
        for (const [name, more] of [['createTexture', 1], ['deleteTexture', -1]]) {
            const call = WebGL2RenderingContext.prototype[name];
            WebGL2RenderingContext.prototype[name] = function counting(...parameters) {
                window.textures += more;
                return call.apply(this, parameters);
            };
        }
    });
}

/** A file dragged in from outside, as the browser would report it. */
async function drop(target, { name, buffer }) {
    const transfer = await target.evaluateHandle(([fileName, encoded]) => {
        const bytes = Uint8Array.from(atob(encoded), (character) => character.charCodeAt(0));
        const data = new DataTransfer();
        data.items.add(new File([bytes], fileName));
        return data;
    }, [name, buffer.toString('base64')]);
    for (const type of ['dragenter', 'dragover', 'drop']) {
        await target.dispatchEvent('body', type, { dataTransfer: transfer });
    }
}
