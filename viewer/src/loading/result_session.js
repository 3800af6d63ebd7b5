import { getManifest, kLost } from '../api/api.js';
import { followJob } from '../api/job_follower.js';
import { meanErrorOf } from './level_error.js';
import { LevelLoader } from './level_loader.js';

/**
 * The result of one job from its first level to its last: follows the job while it runs, loads what is ready, and shows the
 * finest level there is, or the one that was chosen, on a pane of the stage.
 */
export class ResultSession {
    /**
     * @param chosen  the level to stay at, or null for the finest; @param bound  of the error, which chooses instead, or null
     * @param dress  gives a level its colours before it is shown; @param onMissing  told why there is no such job
     * @param onError  shows what went wrong; what it returns takes that away
     */
    constructor({ id, type, chosen = null, bound = null }, pane, { dress, onJob, onLevels, onBytes = () => {}, onFirstPicture, onMissing, onError }) {
        this.id = id;
        this.type = type;
        this.pane = pane;
        this.dress = dress;
        this.onLevels = onLevels;
        this.onError = onError;
        this.onFirstPicture = onFirstPicture;
        this.job = null;
        this.chosen = chosen;
        this.bound = bound;  // of the error of what is seen, or null: as the level or the view has it
        this.manifest = null;  // as far as it has come
        this.isComplete = false;
        this.waits = 0;  // requests that the server does not answer
        this.started = performance.now();
        this.hasPicture = false;
        this.abort = new AbortController();
        const onLost = (error) => {
            const forget = onError(error, kLost, { lasts: true });
            this.wait(1);
            return () => {
                forget();
                this.wait(-1);
            };
        };
        this.loader = new LevelLoader({
            id,
            signal: this.abort.signal,
            onReady: () => this.showBest(),
            onChange: () => this.tell(),
            onBytes: () => onBytes(this),
            onTiles: ({ isNew }) => {
                if (isNew) {
                    pane.stage.changed();
                }
                this.tell();
            },
            onLost,
            onError: (level, error) => {
                this.tell();
                onError(error, `Level ${level.level + 1} could not be shown`);
            },
        });
        const follower = {
            onJob: (job) => this.take(job, onJob),
            onLost,
            onError: (error) => (this.job ? onError : onMissing)(error),
            signal: this.abort.signal,
        };
        // The manifest first, and alone: it brings the first picture.
        this.readManifest().catch(() => {}).then(() => followJob(id, follower));
    }

    async take(job, onJob) {
        this.job = job;
        this.type = job.type;  // a link may have it wrong
        onJob(job);
        const reading = this.readManifest();
        await (isGivenUp(job) ? reading.catch(() => {}) : reading);  // of that there may be levels, or only the problem
        if (isGivenUp(job) && this.manifest) {
            this.loader.streamTiles(this.manifest);  // of the levels that there are
        }
        this.tell();  // the levels may all have been there before the job was known
    }

    wait(more) {
        this.waits += more;
        this.tell();
    }

    close() {
        this.abort.abort();
        this.pane.clear();
        this.loader.dispose();
    }

    /** One request at a time; what is asked for meanwhile is asked for after it. */
    readManifest() {
        this.reading = (this.reading ?? Promise.resolve()).catch(() => {}).then(() => this.readNews());
        return this.reading;
    }

    async readNews() {
        const isNews = !this.job || this.job.levels_ready > this.loader.known || this.job.status === 'successful';
        if (isNews && !this.isComplete) {
            this.manifest = await getManifest(this, this.abort.signal);
            this.isComplete = this.manifest.complete;
            this.loader.update(this.manifest);
            this.tell();
        }
    }

    /** Stays at a level; the last one listed means the finest, whatever still comes. */
    choose(index) {
        const { levels } = this.loader;
        if (levels[index]) {
            this.loader.ask(levels[index]);
            const isFinest = index === levels.length - 1 && !levels[index].isAnalysis;
            this.stayAt({ chosen: isFinest ? null : index, bound: null });
        }
    }

    /**
     * Shows the coarsest level whose measured mean error is within a bound, and the finest where there is none. Where it comes in
     * tiles, the bound holds for each that is drawn.
     */
    chooseByError(bound) {
        this.stayAt({ chosen: null, bound });
        this.loader.ask(this.wanted);
    }

    stayAt({ chosen, bound }) {
        this.chosen = chosen;
        this.bound = bound;
        this.showBest();
    }

    /** The level that was asked for, of those that are listed so far; of an analysis its points, after which come the lines on them. */
    get wanted() {
        const { levels } = this.loader;
        const chosen = this.chosen ?? (levels[0]?.isAnalysis ? 0 : null);
        const level = this.bound === null ? levels[chosen] : levels.find((other) => meanErrorOf(other) <= this.bound);
        return level ?? levels.at(-1);
    }

    showBest() {
        const ready = this.loader.levels.filter((level) => level.state === 'ready');
        const best = ready.findLast((level) => level.level <= this.wanted.level) ?? ready[0];
        if (best?.tiles && best.bound !== this.bound) {
            best.bound = this.bound;
            this.pane.stage.changed();
        }
        if (best && best !== this.shown) {
            this.shown = best;
            this.redress();
        }
        this.tell();
    }

    /** Shows the level anew, in the colours of now. */
    async redress() {
        const level = this.shown;
        try {
            await this.dress(level, this.abort.signal);
        } catch (error) {
            if (!this.abort.signal.aborted) {
                this.onError(error, 'The colours could not be shown');
            }
        }
        if (level === this.shown && !this.abort.signal.aborted) {
            this.pane.show(level);
            this.tell();
        }
    }

    /** The stage has drawn a level. */
    pictured(level) {
        if (!this.hasPicture) {
            this.hasPicture = true;
            this.onFirstPicture(performance.now() - this.started);
        }
        const mark = `stipple.level.${level.level}`;
        if (performance.getEntriesByName(mark).length === 0) {
            performance.mark(mark, { detail: { result: this.id, points: level.points } });
        }
    }

    /** Whether no more levels will come than those that are there. */
    get hasAll() {
        return this.isComplete || (this.loader.levels.length > 0 && this.job !== null && isGivenUp(this.job));
    }

    /** Whether everything that is listed and not too large is on the screen or was given up. */
    get isSettled() {
        return this.hasAll && this.job !== null && !this.loader.isFollowing && (this.shown?.tiles?.isComplete ?? true) &&
            this.loader.levels.every(({ state }) => state !== 'loading') && this.pane.level === (this.shown ?? null);
    }

    tell() {
        if (!this.abort.signal.aborted) {
            this.onLevels(this);
        }
    }
}

const isGivenUp = ({ status }) => status === 'failed' || status === 'dismissed';
