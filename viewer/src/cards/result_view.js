import { isFinal } from '../api/api.js';
import { keptOf, summaryOf, titleOf } from '../clouds/library.js';
import { drawnErrorOf } from '../loading/level_error.js';
import { byId } from '../page/element.js';
import * as format from '../page/format.js';

/** What the page tells of the result on its stage: its title, the card with its figures, its report, and what can be done with its picture. */
export class ResultView {
    constructor({ library, hud, report, share, toolbar }) {
        Object.assign(this, { library, hud, report, share, toolbar });
    }

    /** Of another one, of which nothing is known yet but its name, where it is listed. */
    open(id) {
        const listed = this.library.jobs.find((job) => job.id === id);
        this.report.hide();
        this.setHasPicture(false);
        document.title = listed ? pageTitleOf(listed) : 'stipple';
        document.documentElement.dataset.state = 'loading';
        this.hud.open(listed ? titleOf(listed) : 'Opening');
    }

    close() {
        this.report.hide();
        this.setHasPicture(false);
        this.hud.close();
        document.title = 'stipple';
        document.documentElement.dataset.state = 'settled';
    }

    showJob(job) {
        byId.title.textContent = titleOf(job);
        document.title = pageTitleOf(job);
        this.hud.showJob(job);
    }

    /** As far as it has come. */
    show(session) {
        const { hud } = this;
        const { id, type, loader, shown, bound, hasAll, isSettled, job, manifest, waits } = session;
        hud.showLevels(loader.levels, shown, loader.loadedBytes, hasAll, bound);
        if (job && manifest?.levels.length > 0 && loader.levels.length === 0 && !manifest.request.formats?.includes('stpc')) {
            this.showReport(session);
            hud.showPlain({ id, levels: manifest.levels });
        }
        this.setHasPicture(Boolean(shown));
        if (shown) {
            // That of a stream is a batch, which no manifest knows.
            const level = shown.decoder || (session.chosen === null && bound === null) ? null : shown.level;
            const formats = [...new Set(manifest.levels.flatMap(({ files }) => files.map((file) => file.format)))];
            this.share.show({ id, type, level, formats, isPlaced: kPlaces.some((place) => place in (manifest.request.tiles ?? {})) });
        }
        if (job && isFinal(job)) {
            const large = loader.levels.find(({ state }) => state === 'large');
            if (loader.levels.some(({ state }) => state === 'loading')) {
                this.showArrival(session);
            } else if (job.status === 'successful') {
                hud.showActivity(isTooCoarse(session) ? 'Loading finer points' : large ? `${format.compactCount(large.points)} more on request` : this.about(session));
            } else {
                hud.showEnd(job);
            }
        }
        hud.setWaiting(waits > 0);
        document.documentElement.dataset.state = isSettled ? 'settled' : 'loading';
    }

    /** How much of it has come. */
    showArrival({ loader, job }) {
        this.hud.showArrival(loader.levels, loader.loadedBytes);
        const next = loader.levels.find(({ state }) => state === 'loading');
        if (next && job && isFinal(job)) {
            const percent = Math.floor(100 * next.arrived / next.bytes);
            this.hud.showActivity(`Loading ${format.compactCount(next.points)} points`, percent > 0 && percent < 100 ? `, ${percent} %` : '');
        }
    }

    /** What kind of result it is, and whether all of its cloud is in it. */
    about({ job, manifest, shown }) {
        const cloud = this.library.cloudOf(job);
        const source = manifest?.source ?? cloud;
        const without = source?.points === undefined ? '' : keptOf(source).without;
        const candidate = job.request.candidates?.length > 1 && job.request.labels[shown?.level];
        return [summaryOf(job, cloud), candidate, shown?.tiles && 'by view', without].filter(Boolean).join(', ');
    }

    toggleReport(session) {
        if (this.report.isOpen) {
            this.report.hide();
        } else {
            this.showReport(session, { takesFocus: true });
        }
    }

    /** What is told beside the picture, or without one. */
    showReport({ job, manifest, loader }, how) {
        this.report.show({
            job, manifest, name: titleOf(job), canClose: loader.levels.length > 0, ...how,
            nameOf: (id) => this.library.clouds.find((cloud) => cloud.id === id)?.name,
        });
    }

    /** What can be done to a picture, where there is one. */
    setHasPicture(hasPicture) {
        this.toolbar.setHasPicture(hasPicture);
        if (!hasPicture) {
            this.share.close();
        }
    }
}

/** How a pyramid was told where on the globe it is. */
const kPlaces = ['epsg', 'transform'];

const pageTitleOf = (job) => `${titleOf(job)} – stipple`;

/** Whether the tiles that are drawn do not keep to the bound that was asked for yet. */
const isTooCoarse = ({ shown, bound }) =>
    bound !== null && shown?.tiles?.isComplete === false && drawnErrorOf(shown)?.mean > bound;
