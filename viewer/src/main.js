import { dismissJob, isFinal, startPyramid } from './api.js';
import { nameOf, remember } from './cloud_names.js';
import { byId } from './element.js';
import * as format from './format.js';
import { Hud } from './hud.js';
import { Library } from './library.js';
import { showProblem } from './notices.js';
import { PyramidSession } from './pyramid_session.js';
import { Stage } from './stage.js';
import { acceptDrops, uploadCloud } from './upload.js';

const kUploadHint = matchMedia('(pointer: coarse)').matches
    ? 'Choose a .ply or .drc file' : 'Drop a .ply or .drc anywhere, or choose a file';

const stage = new Stage(byId.stage, { onPicture: (level) => session?.pictured(level) });
const library = new Library({ onPyramid: open, onCloud: openCloud });
const hud = new Hud({
    onLevel: (index) => session?.choose(index),
    onDismiss: () => dismissJob(session.id).catch(showProblem),
});
let session = null;
let uploading = false;

function open(id, { remembered = false } = {}) {
    session?.close();
    if (!remembered) {
        history.pushState(null, '', `/?pyramid=${id}`);
    }
    byId.welcome.hidden = true;
    byId.dock.classList.remove('open');
    document.documentElement.dataset.state = 'loading';
    performance.clearMarks();
    let wasFinal = null;
    hud.open('Pyramid');
    session = new PyramidSession(id, stage, {
        onJob: (job) => {
            byId.title.textContent = nameOf(job.request.input);
            document.title = `${nameOf(job.request.input)} – stipple`;
            hud.showJob(job);
            if (job.status === 'failed') {
                showProblem(new Error(job.problem?.detail ?? 'the server gave no reason'), job.problem?.title);
            }
            if (wasFinal !== isFinal(job)) {
                wasFinal = isFinal(job);
                library.refresh().catch(showProblem);
            }
        },
        onLevels: showLevels,
        onFirstPicture: (ms) => hud.showFirstPicture(ms),
        onError: showProblem,
    });
    library.setCurrent(id);
    placeCloud();
}

function showLevels({ loader, shown, isComplete, isSettled, job }) {
    hud.showLevels(loader.levels, shown, loader.loadedBytes, isComplete);
    const next = loader.levels.find(({ state }) => state === 'loading');
    if (isFinal(job)) {
        const large = loader.levels.find(({ state }) => state === 'large');
        if (next) {
            hud.showActivity(`Loading ${format.compactCount(next.points)} points`);
        } else if (job.status === 'successful') {
            hud.showActivity(large ? `${format.compactCount(large.points)} more on request` : 'Complete');
        }
    }
    document.documentElement.dataset.state = isSettled ? 'settled' : 'loading';
}

/** The newest pyramid of a cloud, or a new one. */
async function openCloud(cloudId) {
    const known = library.pyramids.find((job) =>
        job.request.input === cloudId && !['failed', 'dismissed'].includes(job.status));
    if (known) {
        open(known.id);
        return;
    }
    try {
        open((await startPyramid(cloudId)).id);
    } catch (error) {
        showProblem(error, 'The pyramid could not be started');
    }
}

async function upload(file) {
    if (uploading) {
        showProblem(new Error('Another file is still on its way; add this one after it.'), 'One at a time');
        return;
    }
    uploading = true;
    byId['upload-progress'].hidden = false;
    try {
        const cloud = await uploadCloud(file, (fraction) => {
            byId['upload-progress'].value = fraction;
            byId['upload-hint'].textContent = fraction < 1 ? `Sending ${file.name}, ${Math.round(100 * fraction)} %` : 'Storing';
        });
        remember(cloud.id, file.name);
        await openCloud(cloud.id);
    } catch (error) {
        showProblem(error, `${file.name} was not accepted`);
    } finally {
        uploading = false;
        byId['upload-progress'].hidden = true;
        byId['upload-hint'].textContent = kUploadHint;
    }
}

/** Keeps the cloud in the middle of what the cards leave free. */
function placeCloud() {
    const isPhone = matchMedia('(max-width: 760px)').matches;
    const library_ = byId.library.getBoundingClientRect();
    const dock = byId.dock.getBoundingClientRect();
    const shown = byId.hud.hidden ? null : byId.hud.getBoundingClientRect();
    stage.setInsets(isPhone
        ? { left: 0, right: 0, top: 48, bottom: innerHeight - (shown?.top ?? dock.top) }
        : { left: library_.right, right: 0, top: 0, bottom: shown ? innerHeight - shown.top : 0 });
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
    byId.choose.onclick = () => byId.file.click();
    byId.file.onchange = () => {
        [...byId.file.files].slice(0, 1).forEach(upload);
        byId.file.value = '';
    };
    acceptDrops(upload, (isHeld) => { byId.drop.hidden = !isHeld; });
    byId.fit.onclick = () => stage.fit();
    byId.rotate.onclick = toggleRotation;
    byId.grip.onclick = () => {
        byId.grip.ariaExpanded = String(byId.dock.classList.toggle('open'));
    };
    addEventListener('keydown', (event) => {
        if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest('button, input') && event.key === ' ') {
            return;
        }
        if (event.key === 'f' || event.key === 'F') {
            stage.fit();
        } else if (event.key === ' ') {
            event.preventDefault();
            toggleRotation();
        } else if (event.key >= '1' && event.key <= '9') {
            session?.choose(Number(event.key) - 1);
        }
    });
    addEventListener('resize', placeCloud);
    addEventListener('popstate', openLinked);
    const light = matchMedia('(prefers-color-scheme: light)');
    light.addEventListener('change', () => dressForTheme(light.matches));
    dressForTheme(light.matches);
}

/** The pyramid of the address, else the newest one, else the invitation to add a cloud. */
async function openLinked() {
    const linked = new URLSearchParams(location.search).get('pyramid');
    if (linked) {
        open(linked, { remembered: true });
        return;
    }
    await library.refresh();
    const newest = library.pyramids.find((job) => job.status === 'successful');
    if (newest) {
        open(newest.id, { remembered: true });
    } else {
        byId.welcome.hidden = false;
        placeCloud();
    }
}

listen();
openLinked().catch(showProblem);
