import { getManifest, isFinal } from './api.js';
import { followJob } from './job_follower.js';
import { LevelLoader } from './level_loader.js';

/**
 * One pyramid from its first level to its last: follows the job while it runs, loads what is ready, and shows the finest level
 * there is, or the one that was chosen.
 */
export class PyramidSession {
    constructor(id, stage, { onJob, onLevels, onFirstPicture, onError }) {
        this.id = id;
        this.stage = stage;
        this.onLevels = onLevels;
        this.onFirstPicture = onFirstPicture;
        this.job = null;
        this.chosen = null;       // a level, or null for the finest
        this.isComplete = false;
        this.started = performance.now();
        this.hasPicture = false;
        this.abort = new AbortController();
        this.loader = new LevelLoader({
            signal: this.abort.signal,
            onReady: () => this.showBest(),
            onChange: () => this.tell(),
            onError: (level, error) => {
                this.tell();
                onError(error, `Level ${level.level + 1} could not be shown`);
            },
        });
        const onChange = async (job) => {
            this.job = job;
            onJob(job);
            await this.readManifest(job);
        };
        followJob(id, onChange, onError, this.abort.signal);
    }

    close() {
        this.abort.abort();
        this.stage.clear();
        this.loader.dispose();
    }

    async readManifest(job) {
        if (job.levels_ready > this.loader.levels.length || (isFinal(job) && job.status === 'successful')) {
            const manifest = await getManifest(this.id, this.abort.signal);
            this.isComplete = manifest.complete;
            this.loader.update(manifest);
            this.tell();
        }
    }

    /** Stays at a level; the last one listed means the finest, whatever still comes. */
    choose(index) {
        const level = this.loader.levels[index];
        if (level) {
            this.chosen = index === this.loader.levels.length - 1 ? null : index;
            if (level.state === 'large' || level.state === 'failed') {
                this.loader.load(level);
            }
            this.showBest();
        }
    }

    showBest() {
        const ready = this.loader.levels.filter((level) => level.state === 'ready');
        const best = ready.findLast((level) => this.chosen === null || level.level <= this.chosen) ?? ready[0];
        if (best && best !== this.shown) {
            this.shown = best;
            this.stage.show(best);
        }
        this.tell();
    }

    /** The stage has drawn a level. */
    pictured(level) {
        if (!this.hasPicture) {
            this.hasPicture = true;
            this.onFirstPicture(performance.now() - this.started);
        }
        const mark = `stipple.level.${level.level}`;
        if (performance.getEntriesByName(mark).length === 0) {
            performance.mark(mark, { detail: { pyramid: this.id, points: level.points } });
        }
    }

    /** Whether everything that is listed and not too large is on the screen or was given up. */
    get isSettled() {
        return this.isComplete && this.loader.levels.every(({ state }) => state !== 'loading');
    }

    tell() {
        if (!this.abort.signal.aborted) {
            this.onLevels(this);
        }
    }
}
