import { askAhead, cancelJob, getBytes, isFinal, kLost, persist, removeCloud, removeJob, startEvaluation, startJob } from './api.js';
import { readAddress, writeAddress } from './address.js';
import { ammonite } from './ammonite.js';
import { Comparison, kAlone } from './comparison.js';
import { preloadDecoder } from './draco_levels.js';
import { byId, element, setHidden } from './element.js';
import * as format from './format.js';
import { Hud } from './hud.js';
import { followJob } from './job_follower.js';
import { JobForm } from './job_form.js';
import { inputOf, keptOf, Library, nameOf, summaryOf, titleOf } from './library.js';
import { listenToKeys } from './keys.js';
import { kMostWhole } from './level_loader.js';
import { LookCard } from './look_card.js';
import { closeNewest, forgetProblems, offer, showProblem } from './notices.js';
import { Report } from './report.js';
import { ResultSession } from './result_session.js';
import { ShareCard } from './share_card.js';
import { isPhone, Sheet } from './sheet.js';
import { canDrawOn, Stage } from './stage.js';
import { preloadSurface } from './surface.js';
import { acceptDrops, uploadCloud } from './upload.js';
import { UploadQueue } from './upload_queue.js';

const [kUploadHint, kInvitation] = matchMedia('(pointer: coarse)').matches
    ? ['Choose a .ply or .drc file', 'Choose a point cloud'] : ['Drop a .ply or .drc anywhere, or choose a file', 'Drop a point cloud here'];
const kInvitationNote = 'PLY or Draco. It becomes a pyramid of levels that streams in, coarse to fine.';

const linked = readAddress();
if (linked) {
    askAhead(linked);
}
preloadDecoder();
preloadSurface();
if (!canDrawOn(byId.stage)) {
    byId.unable.hidden = false;
    await new Promise(() => {});  // the rest of the page is about what is drawn
}

const kSoonMs = 100;
const kAsNew = { chosen: null, bound: null, view: null, color: null, splatSize: null, shading: null, ...kAlone };
const kNotStarted = 'The job could not be started';
const kLegendGap = 10;

/** Bytes of a point in a small file of each kind: a pyramid with large levels needs tiles, which take the server longer to make. */
const kFewestBytes = { ply: 12, drc: 1.5, stpc: 1.5 };

const stage = new Stage(byId.stage, { onPicture: (level) => session?.pictured(level), onMoved: remember, onPoint: showPoint });
const library = new Library({
    onResult: (job) => {
        forgetProblems();
        open(job);
    },
    onCloud: (cloud) => {
        forgetProblems();
        openCloud(cloud);
    },
    onParameters: (cloud) => form.open({ cloud: cloud.id, name: nameOf(cloud), attributes: attributesOf(cloud), others: othersThan(cloud) }),
});
const hud = new Hud({
    onLevel: choose,
    onError: (bound) => {
        session?.chooseByError(bound);
        remember();
    },
    onCancel: () => cancelJob(session.id).catch(showProblem),
    onDownload: (file) => download(file).catch(showProblem),
    onMap: mapErrors,
    onFigures: () => {
        look.setOpen(false);
        if (report.isOpen) {
            report.hide();
        } else {
            showReport();
        }
    },
    onRemove: () => removeResult().catch(showProblem),
    onAgain: () => startAgain().catch((error) => showProblem(error, kNotStarted)),
    onRemoveAll: () => removeWithCloud().catch(showProblem),
});
const look = new LookCard({
    onColor: () => {
        if (session?.shown) {
            session.redress();  // what is on the right follows
        }
        remember();
    },
    onLook: (settings) => {
        stage.setLook(settings);
        remember();
    },
    onOpen: () => share.close(),
});
const share = new ShareCard({
    linkOf: linkToResult,
    onPicture: () => savePicture().catch((error) => showProblem(error, 'The picture could not be saved')),
    onOpen: () => look.setOpen(false),
});
const report = new Report({
    onDownload: (file) => download(file).catch(showProblem),
    onSimplify: (points) => start('simplify', inputOf(session.job), { ...ofMethod(session.job.request), points, format: 'drc' }).catch((error) => showProblem(error, kNotStarted)),
    onPyramid: () => startPyramid(library.cloudOf(session.job)).catch((error) => showProblem(error, kNotStarted)),
});
const form = new JobForm({
    onStart: ({ cloud, type, fields }) => start(type, cloud, fields),
    onRemove: (cloud) => removeCloud(cloud).then(() => library.refresh()).catch(showProblem),
});
const sheet = new Sheet();
const uploads = new UploadQueue({
    onStart: () => {
        forgetProblems();
        beforeUpload = session;
    },
    onEnd: (all) => endUpload(all).catch(showProblem),
    onProgress: tellWelcome,
});
const comparison = new Comparison(stage, library, look, { onChange: remember });
let session = null;
let beforeUpload = null;  // what was shown when files set out
const pending = new Map();  // what was asked of the server, by its key, and is not there yet
let remembering = null;

/** @param remembered  whether the address names it already; @param how  it is looked at, as the address has it */
function open({ id, type }, { remembered = false, how = kAsNew } = {}) {
    const { chosen, bound, view, color, splatSize, shading } = how;
    askAhead({ id, type });
    if (!remembered) {
        rememberNow();  // what is left, for who comes back
    }
    comparison.end();
    report.hide();
    session?.close();
    if (!remembered) {
        history.pushState(null, '', `/?${type === 'pyramid' ? 'pyramid' : 'job'}=${id}`);
    }
    setTools(false);
    byId.point.hidden = true;
    byId.welcome.hidden = true;
    sheet.close();
    document.title = 'stipple';
    document.documentElement.dataset.state = 'loading';
    performance.clearMarks();
    let wasFinal = null;
    hud.open('Opening');
    stage.startView = view;
    if (remembered) {
        look.restore({ color, splatSize, shading });
    }
    session = new ResultSession({ id, type, chosen, bound }, stage.panes[0], {
        dress: (level, signal) => comparison.dress(level, signal),
        onJob: (job) => {
            byId.title.textContent = titleOf(job);
            document.title = `${titleOf(job)} – stipple`;
            hud.showJob(job);
            library.update(job);
            if (wasFinal !== isFinal(job)) {
                wasFinal = isFinal(job);
                library.refresh().then(() => session?.tell(), showProblem);  // what was found out about the cloud
            }
        },
        onLevels: showLevels,
        onFirstPicture: (ms) => hud.showFirstPicture(ms),
        onMissing: leave,
        onError: showProblem,
    });
    comparison.setLeft(session, how);
    library.setCurrent(id);
    placeCloud();
}

function closeResult() {
    comparison.end();
    report.hide();
    session.close();
    session = null;
    comparison.setLeft(null);
    byId.point.hidden = true;
    setTools(false);
    hud.close();
    document.title = 'stipple';
    document.documentElement.dataset.state = 'settled';
    library.setCurrent(null);
}

/** Takes what is shown from the server, and shows the newest that is left, unless another was opened meanwhile. */
async function removeResult() {
    const removed = session;
    await removeJob(removed.id);
    if (session !== removed) {
        await library.refresh();
        return;
    }
    closeResult();
    history.replaceState(null, '', '/');
    await openLinked();
}

/** The same job once more, as it was asked for. */
function startAgain() {
    const { type, input, reference, candidate, ...fields } = session.job.request;
    return start(session.job.type, inputOf(session.job), fields);
}

/** Of a cloud that cannot be read there is nothing to keep. */
async function removeWithCloud() {
    await removeCloud(inputOf(session.job));
    await removeResult();
}

/** What the address names cannot be shown: there is the rest of the library. */
function leave(error) {
    closeResult();
    if (error.status === 404) {
        showProblem(new Error('It may have been removed, or its address is incomplete.'), 'This result does not exist');
    } else {
        showProblem(error, 'The result could not be opened');
    }
    library.refresh().then(invite).catch(showProblem);
}

/** Asks for a cloud where nothing is shown. */
function invite() {
    byId.welcome.hidden = session !== null;
    placeCloud();
}

/** Stays at a level, also when the page is loaded anew. */
function choose(index) {
    session?.choose(index);
    remember();
}

/** Soon, and once for what comes together: browsers count. */
function remember() {
    remembering ??= setTimeout(rememberNow, kSoonMs);
}

function rememberNow() {
    clearTimeout(remembering);
    remembering = null;
    if (session && session.id === (readAddress()?.id ?? session.id)) {
        const { id, type, chosen, bound } = session;
        writeAddress({ id, type, chosen, bound, view: stage.view, ...look.chosen, ...comparison.how });
    }
}

function showLevels({ id, loader, shown, bound, isComplete, isSettled, job, manifest, waits }) {
    hud.showLevels(loader.levels, shown, loader.loadedBytes, isComplete, bound);
    if (job && manifest?.levels.length > 0 && loader.levels.length === 0 && !manifest.request.formats?.includes('stpc')) {
        showReport();
        hud.showPlain({ id, levels: manifest.levels });
    }
    setTools(Boolean(shown));
    if (shown) {
        share.show({ id, type: session.type, formats: [...new Set(manifest.levels.flatMap(({ files }) => files.map((file) => file.format)))] });
    }
    comparison.update();
    const next = loader.levels.find(({ state }) => state === 'loading');
    if (job && isFinal(job)) {
        const large = loader.levels.find(({ state }) => state === 'large');
        if (next) {
            hud.showActivity(`Loading ${format.compactCount(next.points)} points`);
        } else if (job.status === 'successful') {
            hud.showActivity(large ? `${format.compactCount(large.points)} more on request` : aboutOf(job, manifest, shown));
        }
    }
    hud.setWaiting(waits > 0);
    document.documentElement.dataset.state = isSettled ? 'settled' : 'loading';
}

/** What kind of result it is, and whether all of its cloud is in it. */
function aboutOf(job, manifest, shown) {
    const cloud = library.cloudOf(job);
    const source = manifest?.source ?? cloud;
    const without = source?.points === undefined ? '' : keptOf(source).without;
    return [summaryOf(job, cloud), shown?.tiles && 'by view', without].filter(Boolean).join(', ');
}

/** The point that is looked at closely, until the cloud is moved by hand. */
function showPoint({ place, level, geometry, index }) {
    const value = geometry === level.geometry && !level.tiles ? look.valueAt(level, index) : null;
    byId.point.replaceChildren(element('span', { className: 'place', textContent: format.place(place, stage.home.radius) }), ...(value ? [value] : []));
    byId.point.hidden = false;
}

/** What can be done to a picture, where there is one. */
function setTools(hasPicture) {
    for (const id of ['compare', 'fit', 'rotate', 'share']) {
        byId[id].disabled = !hasPicture;
    }
    if (!hasPicture) {
        share.close();
    }
}

/** What is told beside the picture, or without one. */
function showReport() {
    const { job, manifest, loader } = session;
    report.show({
        job, manifest, name: titleOf(job), canClose: loader.levels.length > 0,
        nameOf: (id) => library.clouds.find((cloud) => cloud.id === id)?.name,
    });
}

// ---- Jobs and files

/** Does once what is asked for again before it is done, as by a double click. */
function once(key, act) {
    if (!pending.has(key)) {
        pending.set(key, act().finally(() => pending.delete(key)));
    }
    return pending.get(key);
}

/** The newest pyramid of a cloud, or a new one. */
async function openCloud(cloud) {
    const known = library.pyramidOf(cloud.id);
    if (known) {
        open(known);
    } else {
        await startPyramid(cloud).catch((error) => showProblem(error, kNotStarted));
    }
}

/** One to look at. */
async function startPyramid({ id, format: kind, bytes }) {
    const isLarge = bytes > kMostWhole * kFewestBytes[kind];
    // What is small is there within a second by the method of less error, too.
    await start('pyramid', id, isLarge ? { formats: ['drc', 'glb'], tiles: { attributes: true } } : { formats: ['drc'], method: 'multiphase' });
}

/** What a curve was asked for and a simplification can be. */
function ofMethod({ type, input, count, points, ...fields }) {
    return fields;
}

function start(type, cloudId, fields) {
    return once(JSON.stringify([type, cloudId, fields]), async () => {
        const job = await startJob(type, cloudId, type === 'evaluate' ? { map: ['drc'], ...fields } : fields);
        library.add(job);
        open(job);
        look.forgetColor();
    });
}

/** Those beside the colours and normals, where they are known. */
const attributesOf = ({ attributes = [] }) => attributes.map(({ name }) => name).filter((name) => name !== 'normal' && name !== 'color');

/** What a cloud can be compared with: other clouds, and levels of what is shown, if it was made from it. */
function othersThan({ id }) {
    const isOfIt = session?.job && session.job.type !== 'evaluate' && inputOf(session.job) === id;
    const levels = (isOfIt ? session.loader.levels : []).filter(({ file }) => file).map(({ file, points }) =>
        ({ id: file.sha256, name: `${byId.title.textContent}, ${format.compactPoints(points)}` }));
    return [...levels, ...library.clouds.map((cloud) => ({ id: cloud.id, name: nameOf(cloud) }))].filter((other) => other.id !== id);
}

/** Where the surface that is shown is how far from that of the input. */
function mapErrors() {
    const { id, job, shown } = session;
    once(`map ${id} ${shown.level}`, async () => {
        try {
            const map = await startMap(inputOf(job), shown);
            look.forgetColor();
            if (!isPhone()) {
                look.setOpen(true);  // its legend says what the colours are
            }
            library.add(map);
            open(map);
        } catch (error) {
            showProblem(error, 'The error could not be measured');
        }
    });
}

/** A level without a file becomes a cloud of its own, for as long as it is measured. */
async function startMap(reference, { file, ply, points }) {
    if (file) {
        return startEvaluation(reference, file.sha256);
    }
    const { id, isNew } = await uploadCloud(new File([await ply()], fileName({ points }, 'ply')));
    const remove = () => isNew && removeCloud(id).then(() => library.refresh()).catch(showProblem);
    try {
        const map = await startEvaluation(reference, id);
        const removeOnceOver = (job) => isFinal(job) && remove();  // until then it is needed
        followJob(map.id, { onJob: removeOnceOver, onLost: () => {}, onError: remove, signal: new AbortController().signal });
        return map;
    } catch (error) {
        remove();
        throw error;
    }
}

const fileName = (shown, extension) => `${[byId.title.textContent.replace(/\.(ply|drc)$/i, ''), shown?.points].filter(Boolean).join('-')}.${extension}`;

/** The address of what is shown, also where the page shows it only because it is the newest. */
function linkToResult() {
    rememberNow();
    const address = new URL(location.href);
    if (!readAddress()) {
        address.searchParams.set(session.type === 'pyramid' ? 'pyramid' : 'job', session.id);
    }
    return address.href;
}

async function savePicture() {
    save(await stage.picture(), fileName(session.shown, 'png'));
}

/** By the page, since a link shows the server no key. */
async function download({ href, ply, format: extension }) {
    const name = fileName(session.shown, extension);
    save(new Blob([await (ply ? ply() : getBytes(href))]), name);
}

function save(blob, name) {
    const url = URL.createObjectURL(blob);
    element('a', { href: url, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(url), 60_000);
}

/** What was sent is opened, unless something else was opened meanwhile. */
async function endUpload({ cloud, count }) {
    tellWelcome();
    if (cloud && session === beforeUpload) {
        look.forgetColor();
        await openCloud(cloud);
    } else if (cloud) {
        offer(count > 1 ? `${count} clouds were added` : `${nameOf(cloud)} was added`, 'Open it', () => openCloud(cloud));
        library.refresh().catch(showProblem);
    }
}

function upload(files) {
    byId['job-dialog'].close();
    byId['help-dialog'].close();
    uploads.add(files);
}

/** In the middle of an empty page: what is on its way, or what to do. */
function tellWelcome({ name, note } = {}) {
    byId['welcome-title'].textContent = name ? `Sending ${name}` : kInvitation;
    byId['welcome-note'].textContent = name ? note : kInvitationNote;
    setHidden(byId.try, Boolean(name));
}

function closeTopmost() {
    if (closeNewest()) {
        return;
    }
    if (sheet.isOpen) {
        sheet.close();
    } else if (!byId['look-card'].hidden) {
        look.toggle();
    } else if (share.isOpen) {
        share.close();
    } else if (report.isOpen && session?.shown) {
        report.hide();
    } else {
        comparison.end();
    }
}

/** Keeps the cloud in the middle of what the cards leave free. */
function placeCloud() {
    const library_ = byId.library.getBoundingClientRect();
    const dock = byId.dock.getBoundingClientRect();
    const shown = byId.hud.hidden ? null : byId.hud.getBoundingClientRect();
    const legend = byId.legend.hidden || byId.hud.hidden ? 0 : byId.legend.offsetHeight + kLegendGap;
    const card = [byId['look-card'], byId['share-card']].find(({ hidden }) => !hidden)?.getBoundingClientRect();
    const labels = byId['left-label'].getBoundingClientRect();  // of a comparison
    const isFlat = innerHeight <= 480;  // the tools stand at the right then
    stage.setInsets(isPhone()
        ? { left: 0, right: isFlat ? 56 : 0, top: labels.bottom || (isFlat ? 0 : 56), bottom: innerHeight - (shown ? shown.top - byId.grip.offsetHeight : dock.top) + legend }
        : { left: library_.right, right: card ? innerWidth - card.left : 0, top: labels.bottom, bottom: shown ? innerHeight - shown.top + legend : 0 });
    comparison.place();
    document.documentElement.style.setProperty('--covered', `${stage.insets.bottom}px`);
}

function toggleRotation() {
    const on = byId.rotate.ariaPressed !== 'true';
    byId.rotate.ariaPressed = String(on);
    stage.setAutoRotate(on);
}

function dressForTheme(isLight) {
    stage.setTint(...(isLight ? [0.68, 0.60, 0.52] : [0.78, 0.69, 0.58]));
}

function listen() {
    byId['upload-hint'].textContent = kUploadHint;
    tellWelcome();
    byId.try.onclick = () => upload([new File([ammonite()], 'ammonite.ply')]);
    byId.choose.onclick = () => byId.file.click();
    byId.file.onchange = () => {
        upload([...byId.file.files]);
        byId.file.value = '';
    };
    acceptDrops({
        onFiles: (files) => files.length > 0 && upload(files),
        onFolder: (name) => showProblem(new Error('Drop the files inside it.'), `${name} is a folder`),
        onHover: (isHeld) => { byId.drop.hidden = !isHeld; },
    });
    byId.stage.addEventListener('webglcontextlost', () => {
        const forget = showProblem(new Error('Drawing resumes when the browser allows it; if not, reload the page.'), 'The graphics context was lost', { lasts: true });
        byId.stage.addEventListener('webglcontextrestored', forget, { once: true });
    });
    byId.stage.addEventListener('pointerdown', () => { byId.point.hidden = true; });
    byId.fit.onclick = () => {
        byId.point.hidden = true;
        stage.fit();
    };
    byId.help.onclick = () => byId['help-dialog'].showModal();
    byId.rotate.onclick = toggleRotation;
    listenToKeys({
        onTurn: (...move) => stage.turn(...move),
        onPan: (...way) => stage.pan(...way),
        onFocus: () => stage.focusMiddle(),
        onLevel: choose,
        onKey: {
            escape: closeTopmost,
            '?': () => byId['help-dialog'].showModal(),
            f: () => byId.fit.click(),
            ' ': () => byId.rotate.click(),
            c: () => byId.compare.click(),
            l: () => look.toggle(),
            s: () => byId.share.click(),
        },
    });
    addEventListener('resize', placeCloud);
    const cards = new ResizeObserver(placeCloud);
    [byId.hud, byId.legend, byId['look-card'], byId['share-card'], byId['left-label']].forEach((card) => cards.observe(card));
    addEventListener('popstate', () => {
        forgetProblems();
        openLinked().catch(showProblem);
    });
    addEventListener('pagehide', rememberNow);
    const light = matchMedia('(prefers-color-scheme: light)');
    light.addEventListener('change', () => dressForTheme(light.matches));
    dressForTheme(light.matches);
}

/** The result of the address, else the newest there is or will be, unless another was opened meanwhile, else the invitation to add a cloud. */
async function openLinked() {
    const result = readAddress();
    if (result) {
        open(result, { remembered: true, how: result });
        return;
    }
    const before = session;
    await persist(() => library.refresh(), { onLost: (error) => showProblem(error, kLost, { lasts: true }) });
    if (session !== before) {
        return;
    }
    const newest = library.jobs.find((job) => job.status === 'successful') ?? library.jobs.find((job) => !isFinal(job));
    if (newest) {
        open(newest, { remembered: true });
    } else {
        invite();
    }
}

listen();
openLinked().catch(showProblem);
library.watch();
