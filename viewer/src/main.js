import { askAhead, cancelJob, getJob, isFinal, kLost, persist, removeCloud, removeJob } from './api/api.js';
import { download, savePicture } from './api/download.js';
import { Comparison } from './cards/comparison.js';
import { Hud } from './cards/hud.js';
import { LookCard } from './cards/look_card.js';
import { PointLabel } from './cards/point_label.js';
import { Report } from './cards/report.js';
import { ResultView } from './cards/result_view.js';
import { ShareCard } from './cards/share_card.js';
import { Intake } from './clouds/intake.js';
import { JobForm } from './clouds/job_form.js';
import { JobStarter } from './clouds/job_starter.js';
import { subjectOf } from './clouds/job_subject.js';
import { inputOf, Library } from './clouds/library.js';
import { preloadDecoder } from './decoding/draco_levels.js';
import { canDrawOn, Stage } from './drawing/stage.js';
import { ResultSession } from './loading/result_session.js';
import { preloadSurface } from './loading/surface.js';
import { addressOf, kAsNew, readAddress } from './page/address.js';
import { Bookmark } from './page/bookmark.js';
import { roomBesideCards, watchCards } from './page/card_room.js';
import { byId } from './page/element.js';
import { listenToKeys } from './page/keys.js';
import { closeNewest, forgetProblems, showMissing, showProblem } from './page/notices.js';
import { isPhone, Sheet } from './page/sheet.js';
import { followTheme } from './page/theme.js';
import { Toolbar } from './page/toolbar.js';

const kNotFound = 404;

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

const stage = new Stage(byId.stage, {
    onPicture: (level) => session?.pictured(level),
    onMoved: () => bookmark.writeSoon(),
    onPoint: (point) => pointLabel.show(point, stage.home.radius, () => look.valueAt(point)),
});
const library = new Library({
    onResult: (job) => open(job),
    onCloud: openCloud,
    onParameters: async (cloud) => form.open(await subjectOf(cloud, library, session)),
    onChange: () => {
        comparison.show();
        leaveIfGone().catch(() => {});  // that it cannot be asked for is told elsewhere
    },
});
const hud = new Hud({
    onLevel: choose,
    onError: (bound) => {
        session?.chooseByError(bound);
        bookmark.writeSoon();
    },
    onCancel: () => cancelJob(session.id).catch(showProblem),
    onDownload: (file) => download(file, session).catch(showProblem),
    onMap: () => starter.startMap(session),
    onFigures: () => {
        look.close();
        sheet.close();  // on a phone it would lie on the figures
        view.toggleReport(session);
    },
    onRemove: () => removeResult(session).catch(showProblem),
    onAgain: () => starter.startAgain(session.job),
    onRemoveAll: () => removeWithCloud().catch(showProblem),
});
const look = new LookCard({
    onColor: () => {
        if (session?.shown) {
            session.redress();  // what is on the right follows
        }
        bookmark.writeSoon();
    },
    onLook: (settings) => {
        stage.setLook(settings);
        bookmark.writeSoon();
    },
    onOpen: () => share.close(),
});
const share = new ShareCard({
    linkOf: () => bookmark.link(),
    onPicture: () => savePicture(stage, session).catch((error) => showProblem(error, 'The picture could not be saved')),
    onOpen: () => look.close(),
});
const report = new Report({
    onDownload: (file) => download(file, session).catch(showProblem),
    onSimplify: (points) => starter.startAsCurve(session.job, points),
    onPyramid: () => starter.startPyramid(library.cloudOf(session.job) ?? { id: inputOf(session.job), name: session.job.input_name }),
    onPlace: (candidate, place) => {
        byId.stage.focus();
        report.hide();
        choose(candidate);
        if (stage.home) {
            stage.lookAt(place);
            pointLabel.show({ place }, stage.home.radius, () => null);
        }
    },
});
const starter = new JobStarter({
    onJob: (job) => {
        library.add(job);
        openNew(job);
    },
    onMap: (map) => {
        const { view: seenFrom } = stage;
        if (!isPhone()) {
            look.open();  // its legend says what the colours are
        }
        library.add(map);
        openNew(map, { how: { ...kAsNew, view: seenFrom } });  // what was looked at is what is asked about
    },
    onCloudsChanged: () => library.refresh(),
    mapOf: (reference, candidate) => library.mapOf(reference, candidate),
});
const form = new JobForm({
    onStart: ({ cloud, type, fields }) => starter.start(type, cloud, fields),
    onRemove: (cloud) => unlessGone(removeCloud(cloud)).then(() => library.refresh()).catch(showProblem),
});
const toolbar = new Toolbar({
    onFit: () => {
        pointLabel.hide();
        stage.fit();
    },
    onRotate: (isOn) => stage.setAutoRotate(isOn),
});
const view = new ResultView({ library, hud, report, share, toolbar });
const pointLabel = new PointLabel();
const sheet = new Sheet();
const intake = new Intake({
    shown: () => session,
    listed: (id) => library.clouds.find((cloud) => cloud.id === id),
    onSent: (cloud) => openCloud(cloud, openNew),
    onChosen: openCloud,
    onAdded: () => library.refresh(),
});
const comparison = new Comparison(stage, library, look, { onStart: () => sheet.makeRoom(), onChange: () => bookmark.writeSoon() });
const bookmark = new Bookmark(() => session && {
    id: session.id, type: session.type, chosen: session.chosen, bound: session.bound, view: stage.view, ...look.chosen, ...comparison.how,
});
let session = null;

/** @param remembered  whether the address names it already; @param how  it is looked at, as the address has it */
function open({ id, type }, { remembered = false, how = kAsNew } = {}) {
    askAhead({ id, type });
    if (!remembered && session) {
        history.replaceState(null, '', bookmark.link());  // what is left, for who comes back
    }
    comparison.end();
    const isAnother = session?.id !== id;
    session?.close();
    if (!remembered && isAnother) {
        history.pushState(null, '', addressOf({ id, type }));
    }
    view.open(id);
    pointLabel.hide();
    intake.setInviting(false);
    sheet.close();
    performance.clearMarks();
    let wasFinal = null;
    stage.startView = how.view;
    if (remembered) {
        look.restore(how);
    }
    session = new ResultSession({ id, type, chosen: how.chosen, bound: how.bound }, stage.panes[0], {
        dress: async (level, signal) => {
            await comparison.dress(level, signal);
            pointLabel.renew();
        },
        onJob: (job) => {
            view.showJob(job);
            library.update(job);
            if (wasFinal !== isFinal(job)) {
                wasFinal = isFinal(job);
                library.refresh().then(() => session?.tell(), showProblem);  // what was found out about the cloud
            }
        },
        onBytes: (loading) => view.showArrival(loading),
        onLevels: (shown) => {
            view.show(shown);
            comparison.update();
        },
        onFirstPicture: (ms) => hud.showFirstPicture(ms),
        onMissing: leave,
        onError: showProblem,
    });
    comparison.setLeft(session, how);
    library.setCurrent(id);
    placeCloud();
}

/** In its own colours. A choice is forgotten only once it is in the address of what is left. */
function openNew(result, options) {
    open(result, options);
    look.forgetColor();
}

function closeResult() {
    comparison.end();
    view.close();
    sheet.unfold();
    session.close();
    session = null;
    comparison.setLeft(null);
    pointLabel.hide();
    library.setCurrent(null);
}

/** What somebody else took away is gone as well. */
const unlessGone = (removal) => removal.catch((error) => {
    if (error.status !== kNotFound) {
        throw error;
    }
});

/** Takes a result that was shown from the server, and shows the newest that is left, unless another was opened meanwhile. */
async function removeResult(removed) {
    await unlessGone(removeJob(removed.id));
    if (session !== removed) {
        await library.refresh();
        return;
    }
    closeResult();
    history.replaceState(null, '', addressOf(null));
    await openLinked();
}

/** Of a cloud that cannot be read there is nothing to keep. */
async function removeWithCloud() {
    const removed = session;
    await unlessGone(removeCloud(inputOf(removed.job)));
    await removeResult(removed);
}

/** What the address names cannot be shown: there is the rest of the library. */
function leave(error) {
    closeResult();
    showMissing(error);
    library.refresh().then(invite).catch(showProblem);
}

/** What is shown may have been taken away elsewhere, or be older than those that are listed. */
async function leaveIfGone() {
    const shown = session;
    if (!shown?.job || library.jobs.some(({ id }) => id === shown.id)) {
        return;
    }
    try {
        await getJob(shown.id);
    } catch (error) {
        if (error.status !== kNotFound) {
            throw error;
        }
        if (session === shown) {
            leave(error);
        }
    }
}

/** Asks for a cloud where nothing is shown. */
function invite() {
    intake.setInviting(session === null);
    if (session === null) {
        look.close();  // on a phone it would lie on the invitation
    }
    placeCloud();
}

/** Stays at a level, also when the page is loaded anew. */
function choose(index) {
    session?.choose(index);
    bookmark.writeSoon();
}

/** The newest pyramid of a cloud, or a new one. */
async function openCloud(cloud, show = open) {
    const known = library.pyramidOf(cloud.id);
    if (known) {
        show(known);
    } else {
        await starter.startPyramid(cloud);
    }
}

function closeTopmost() {
    if (closeNewest()) {
        return;
    }
    const card = [sheet, look, share].find(({ isOpen }) => isOpen);
    if (card) {
        card.close();
    } else if (report.isOpen && session?.shown) {
        report.hide();
    } else {
        comparison.end();
    }
}

/** Keeps the cloud in the middle of what the cards leave free. */
function placeCloud() {
    stage.setInsets(roomBesideCards());
    comparison.place();
    document.documentElement.style.setProperty('--covered', `${stage.insets.bottom}px`);
}

function listen() {
    byId.stage.addEventListener('webglcontextlost', () => {
        const forget = showProblem(new Error('Drawing resumes when the browser allows it; if not, reload the page.'), 'The graphics context was lost', { lasts: true });
        byId.stage.addEventListener('webglcontextrestored', forget, { once: true });
    });
    listenToKeys(stage, {
        onLevel: choose,
        onKey: {
            escape: closeTopmost,
            '?': () => byId['help-dialog'].showModal(),
            f: () => byId.fit.click(),
            ' ': () => byId.rotate.click(),
            c: () => byId.compare.click(),
            l: () => look.toggle({ takesFocus: true }),
            s: () => byId.share.disabled || share.toggle({ takesFocus: true }),
        },
    });
    watchCards(placeCloud);
    addEventListener('popstate', () => {
        forgetProblems();
        openLinked().catch(showProblem);
    });
    followTheme(stage);
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
