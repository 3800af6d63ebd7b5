import { isFinal, listClouds, listPyramids } from './api.js';
import { nameOf } from './cloud_names.js';
import { byId, element } from './element.js';
import * as format from './format.js';

/** The lists of clouds and pyramids. */
export class Library {
    constructor({ onPyramid, onCloud }) {
        this.onPyramid = onPyramid;
        this.onCloud = onCloud;
        this.clouds = [];
        this.pyramids = [];
        this.current = null;
    }

    async refresh() {
        [this.clouds, this.pyramids] = await Promise.all([listClouds(), listPyramids()]);
        this.show();
    }

    setCurrent(pyramidId) {
        this.current = pyramidId;
        this.show();
    }

    show() {
        byId.pyramids.replaceChildren(...this.pyramids.map((job) => this.pyramidRow(job)));
        byId['pyramids-section'].hidden = this.pyramids.length === 0;
        const built = new Set(this.pyramids.filter((job) => !isFinal(job) || job.status === 'successful')
            .map((job) => job.request.input));
        byId.clouds.replaceChildren(...this.clouds.map((cloud) => this.cloudRow(cloud, built.has(cloud.id))));
        byId['clouds-section'].hidden = this.clouds.length === 0;
    }

    pyramidRow(job) {
        const cloud = this.clouds.find(({ id }) => id === job.request.input);
        const row = this.row(nameOf(job.request.input), pyramidNote(job, cloud), job.status === 'failed');
        row.ariaCurrent = String(job.id === this.current);
        row.dataset.pyramid = job.id;
        row.onclick = () => this.onPyramid(job.id);
        return element('li', {}, row);
    }

    cloudRow(cloud, isBuilt) {
        const row = this.row(nameOf(cloud.id), cloudNote(cloud), false);
        row.append(element('span', { className: 'row-action', textContent: isBuilt ? '' : 'Build' }));
        row.title = isBuilt ? 'Show its pyramid' : 'Build its pyramid';
        row.onclick = () => this.onCloud(cloud.id);
        return element('li', {}, row);
    }

    row(name, note, isAlarm) {
        return element('button', { className: 'row' }, element('span', { className: 'row-text' },
            element('span', { className: 'row-name', textContent: name }),
            element('span', { className: isAlarm ? 'row-note alarm' : 'row-note', textContent: note })));
    }
}

function pyramidNote(job, cloud) {
    switch (job.status) {
        case 'accepted': return 'Waiting';
        case 'running': return `${Math.round(job.progress)} % · ${job.levels_ready} ready`;
        case 'failed': return job.problem?.title ?? 'Failed';
        case 'dismissed': return 'Cancelled';
        default: {
            const levels = `${job.levels_ready} ${job.levels_ready === 1 ? 'level' : 'levels'}`;
            const size = cloud?.points === undefined ? levels : `${format.compactPoints(cloud.points)}, ${levels}`;
            return `${size} · ${format.ago(job.finished)}`;
        }
    }
}

function cloudNote(cloud) {
    const kind = `${cloud.format === 'drc' ? 'Draco' : 'PLY'}, ${format.bytes(cloud.bytes)}`;
    return cloud.points === undefined ? kind : `${format.points(cloud.points)} · ${kind}`;
}
