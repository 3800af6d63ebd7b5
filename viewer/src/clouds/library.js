import { listClouds, listJobs, pause } from '../api/api.js';
import { fadeWhereCut } from '../page/cut_edges.js';
import { byId, element, exchange, setHidden } from '../page/element.js';
import * as format from '../page/format.js';
import { forgetProblems, showProblem } from '../page/notices.js';

const kPauseMs = 10_000;
const kMore = 100;

/** The lists of clouds and of what was made of them. */
export class Library {
    /** @param onChange  told that the lists are others; beside it what is told what was chosen */
    constructor({ onResult, onCloud, onParameters, onChange }) {
        Object.assign(this, { onResult, onCloud, onParameters, onChange });
        this.clouds = [];
        this.jobs = [];
        this.wanted = { clouds: kMore, results: kMore };  // how many, newest first
        this.current = null;
        this.lastLook = null;
        this.shownAs = null;  // the lists as they are on the page
        for (const list of ['clouds', 'results']) {
            fadeWhereCut(byId[list]);
            byId[`older-${list}`].onclick = () => {
                this.wanted[list] += kMore;
                this.refresh().catch(showProblem);
            };
        }
    }

    /** Of several looks at a time the last one counts: those before may still have what was removed since, or not yet what was added. */
    refresh() {
        const look = Promise.all([listClouds(this.wanted.clouds), listJobs(this.wanted.results)]).then(([clouds, jobs]) => {
            if (look !== this.lastLook) {
                return this.lastLook ?? this.refresh();
            }
            this.clouds = clouds.items;
            this.jobs = jobs.items;
            showOlder('clouds', clouds.areMore);
            showOlder('results', jobs.areMore);
            this.show();
            return undefined;
        });
        this.lastLook = look;
        return look;
    }

    /** One that was just started is there without being asked for. */
    add(job) {
        if (!this.jobs.some(({ id }) => id === job.id)) {
            this.jobs = [job, ...this.jobs];
        }
        this.lastLook = null;  // it may have begun before the job was there
        this.show();
    }

    /** What others add appears too. */
    async watch() {
        const look = () => this.refresh().catch(() => {});  // the next time, then
        addEventListener('focus', look);
        for (;;) {
            await pause(kPauseMs);
            if (document.visibilityState === 'visible') {
                await look();
            }
        }
    }

    /** A job that is followed, as it is now. */
    update(job) {
        const at = this.jobs.findIndex(({ id }) => id === job.id);
        if (at >= 0) {
            this.jobs[at] = job;
            const note = byId.results.querySelector(`[data-result="${job.id}"] .row-note`);
            note.textContent = note.title = resultNote(job, this.cloudOf(job));
        }
    }

    cloudOf(job) {
        return this.clouds.find(({ id }) => id === inputOf(job));
    }

    setCurrent(jobId) {
        this.current = jobId;
        this.isFound = false;
        for (const row of byId.results.querySelectorAll('[data-result]')) {
            row.ariaCurrent = String(row.dataset.result === jobId);
        }
        this.findCurrent();
    }

    /** The newest pyramid of a cloud that is there or on its way, to look at. */
    pyramidOf(cloudId) {
        return this.jobs.find((job) => job.type === 'pyramid' && hasPicture(job) && inputOf(job) === cloudId &&
            !['failed', 'dismissed'].includes(job.status));
    }

    /** A map of how far one candidate is from a reference, or of one that is being made. */
    mapOf(reference, candidate) {
        return this.jobs.find((job) => job.type === 'evaluate' && hasPicture(job) && !['failed', 'dismissed'].includes(job.status) &&
            inputOf(job) === reference && job.request.candidates.length === 1 && job.request.candidates[0] === candidate);
    }

    /** What a result can be compared with by eye. */
    othersWithPicture(jobId) {
        return this.jobs.filter((job) => job.status === 'successful' && hasPicture(job) && job.id !== jobId);
    }

    /** Made anew only where something is different: a row that is replaced loses its click, but not the focus. */
    show() {
        const shownAs = JSON.stringify([this.clouds, this.jobs]);
        if (shownAs === this.shownAs) {
            this.jobs.forEach((job) => this.update(job));  // time goes on
            return;
        }
        this.shownAs = shownAs;
        exchange(byId.results, ...this.jobs.map((job) => this.resultRow(job)));
        byId['results-section'].hidden = this.jobs.length === 0;
        exchange(byId.clouds, ...this.clouds.map((cloud) => this.cloudRow(cloud)));
        byId['clouds-section'].hidden = this.clouds.length === 0;
        this.findCurrent();
        this.onChange();
    }

    /** Scrolls to the current row, once: afterwards the person may look elsewhere. */
    findCurrent() {
        const row = byId.results.querySelector('[aria-current=true]');
        if (row && !this.isFound) {
            this.isFound = true;
            row.scrollIntoView({ block: 'nearest' });
        }
    }

    resultRow(job) {
        const row = this.row(`result-${job.id}`, titleOf(job), resultNote(job, this.cloudOf(job)), job.status === 'failed');
        row.ariaCurrent = String(job.id === this.current);
        row.dataset.result = job.id;
        row.onclick = () => {
            forgetProblems();
            this.onResult(job);
        };
        return element('li', {}, row);
    }

    cloudRow(cloud) {
        const isBuilt = this.pyramidOf(cloud.id) !== undefined;
        const row = this.row(`cloud-${cloud.id}`, nameOf(cloud), cloudNote(cloud), false);
        row.title = [isBuilt ? 'Show its pyramid' : 'Build its pyramid', cloud.points === undefined ? '' : keptOf(cloud).without].filter(Boolean).join('. ');
        row.onclick = () => {
            forgetProblems();
            this.onCloud(cloud);
        };
        const more = element('button', { id: `process-${cloud.id}`, className: 'more', textContent: 'Process', title: 'Simplify, add points, analyse, or build another pyramid', ariaLabel: `Process ${nameOf(cloud)}` });
        more.onclick = () => this.onParameters(cloud);
        return element('li', { className: 'with-more' }, row, more);
    }

    row(id, name, note, isAlarm) {
        return element('button', { id, className: 'row' }, element('span', { className: 'row-text' },
            element('span', { className: 'row-name', dir: 'auto', textContent: name, title: name }),
            element('span', { className: isAlarm ? 'row-note alarm' : 'row-note', textContent: note, title: note })));
    }
}

/** The button below a list: where it goes, the focus is on the last row. */
function showOlder(list, areMore) {
    setHidden(byId[`older-${list}`], !areMore, byId[list].querySelector('li:last-child > .row') ?? byId.stage);
}

function resultNote(job, cloud) {
    switch (job.status) {
        case 'accepted': return 'Waiting';
        case 'running': return `${Math.round(job.progress)} % · ${job.levels_ready} ready`;
        case 'failed': return job.problem?.title ?? 'Failed';
        case 'dismissed': return 'Cancelled';
        default: return `${summaryOf(job, cloud)} · ${format.ago(job.finished)}`;
    }
}

/** The cloud that a job is about. */
export const inputOf = ({ request }) => request.input ?? request.reference;

/** A cloud's id is the hash of its bytes: all that there is to call it by, where it was given no name. */
export const nameOf = ({ id, name }) => name ?? `Cloud ${id.slice(0, 7)}`;

/** How many of a cloud's points are worked with, and why not all. */
export function keptOf({ points, removed: { non_finite: unplaced = 0, duplicates = 0, outliers = 0 } = {} }) {
    const reasons = [[duplicates, duplicates === 1 ? 'duplicate' : 'duplicates'], [unplaced, unplaced === 1 ? 'point without a place' : 'points without a place'],
        [outliers, outliers === 1 ? 'outlier' : 'outliers']]
        .filter(([count]) => count > 0).map(([count, what]) => `${format.count(count)} ${what}`);
    return { points: points - unplaced - duplicates - outliers, without: reasons.length > 0 ? `${reasons.join(' and ')} left out` : '' };
}

/** What a result is called: as the cloud that it was made from. */
export const titleOf = (job) => nameOf({ id: inputOf(job), name: job.input_name });

/** Figures alone have none, nor can COPC be drawn here. */
function hasPicture({ type, request }) {
    switch (type) {
        case 'curve': return false;
        case 'evaluate': return request.map.length > 0;
        case 'pyramid': return request.formats.some((format) => format !== 'copc.laz');
        default: return true;
    }
}

/** What kind of result it is, in a few words. */
export function summaryOf({ type, request, levels_ready: levels }, cloud) {
    switch (type) {
        case 'simplify': return `${targetOf(request, cloud)}, ${request.method}`;
        case 'upsample': return request.points ? format.compactPoints(request.points) : `${format.quantity(request.ratio)} × the points`;
        case 'analyze': return 'Analysis';
        case 'evaluate': return evaluationOf(request);
        case 'curve': return `Error by points, ${request.method}`;
        case 'pyramid':
            return levelsOf(request, `${levels} ${levels === 1 ? 'level' : 'levels'}`);
    }
}

/** A stream goes on from levels, where there are any. */
function levelsOf({ formats, method }, levels) {
    const others = formats.filter((kind) => kind !== 'copc.laz');
    return others.length === 0 ? 'COPC' : others.join() === 'stpc' ? 'Stream' : `${levels}, ${others.includes('stpc') ? 'stream' : method}`;
}

function evaluationOf({ map, candidates, labels }) {
    const what = candidates.length === 1 ? labels[0] : `${candidates.length} clouds`;
    return map.length > 0 ? ['Error map', what].filter(Boolean).join(' of ') : ['Distances', what].filter(Boolean).join(' to ');
}

/** What was asked of a simplification, which tells it from others of its cloud: one of these. */
function targetOf(request, cloud) {
    const { points, ratio, max_error: error, max_cluster_size: size, max_variation: variation, voxel_size: side } = request;
    return points ? pointsOf(request, cloud) : ratio ? `${format.percent(ratio)} of the points` : error ? `Within ${error}`
        : size ? `Clusters of ${format.compactPoints(size)}` : side ? `Voxels of ${side}` : variation ? `Variation up to ${variation}` : 'Simplified';
}

/** As many as were asked for, or all there are. */
const pointsOf = ({ points }, cloud) => format.compactPoints(Math.min(points, cloud?.points ?? points));

function cloudNote(cloud) {
    const kind = `${format.kKinds[cloud.format]}, ${format.bytes(cloud.bytes)}`;
    if (cloud.points === undefined) {
        return kind;
    }
    return `${format.compactShare(keptOf(cloud).points, cloud.points)} ${cloud.points === 1 ? 'point' : 'points'} · ${kind}`;
}
