import { inputOf, summaryOf, titleOf } from '../clouds/library.js';
import { colorize } from '../drawing/coloring.js';
import { ResultSession } from '../loading/result_session.js';
import * as format from '../page/format.js';
import { showMissing, showProblem } from '../page/notices.js';
import { SplitView } from './split_view.js';

/** Nothing beside what is shown. */
const kAlone = { right: null, layout: null, at: null };

/** The result on the stage and, where two are compared, a level of it or another result on its right: with one camera, in the same colours. */
export class Comparison {
    /** @param onStart  told that two are compared; @param onChange  told that other things are compared, or that they lie otherwise */
    constructor(stage, library, look, { onStart, onChange }) {
        Object.assign(this, { stage, library, look, onChange });
        this.view = new SplitView(stage, {
            onStart: () => {
                this.begin();
                onStart();
            },
            onEnd: () => this.leave(),
            onChoice: (choice) => this.choose(choice),
            onLayout: onChange,
        });
        this.left = null;      // the session of the result, or null
        this.other = null;     // that of another result beside it, or null
        this.beside = null;    // the index of a level of the same result beside it, or null: the finest
        this.wanted = null;    // how two are to be compared once there is something to see, or null
        this.stayedAt = null;  // the level or the bound on the left before two were compared
        this.painted = [];     // the level on the right and what its colours were last asked to be
        this.ranges = new Map();  // of the values of candidates of one evaluation, from that which was shown first
    }

    get isOn() {
        return this.view.isOn;
    }

    /** What is compared and how, as the address has it. */
    get how() {
        if (!this.isOn) {
            return this.wanted ?? kAlone;
        }
        const right = this.other ? `result:${this.other.id}` : `level:${this.beside ?? this.left.loader.levels.length - 1}`;
        return { right, ...this.view.layout };
    }

    /** @param session  of the result that is on the stage from now on, or null; @param how  it is to be compared, as the address has it */
    setLeft(session, { right, layout, at } = kAlone) {
        this.left = session;
        this.ranges.clear();
        this.wanted = right === null ? null : { right, layout, at };
    }

    /** The left side has come further. */
    update() {
        if (this.left.shown?.coloring && this.wanted) {
            this.view.start(this.wanted);
        }
        this.show();
    }

    end() {
        this.view.end();
    }

    place() {
        this.view.place();
    }

    /** On the right the finest level, on the left one that is coarser: what does it lose? Of a single level: another result of its cloud. */
    begin() {
        const { left } = this;
        const right = this.wanted?.right;
        this.wanted = null;
        this.beside = null;
        this.stayedAt = { chosen: left.chosen, bound: left.bound };
        if (right) {
            this.choose(right);
            return;
        }
        const { levels } = left.loader;
        const sibling = levels.length === 1 && this.library.othersWithPicture(left.id).find((job) => left.job && inputOf(job) === inputOf(left.job));
        if (sibling) {
            this.choose(`result:${sibling.id}`);
            return;
        }
        if (left.wanted === levels.at(-1) && levels.length > 1) {
            left.choose(levels.length - 2);
        }
        this.show();
    }

    leave() {
        this.closeOther();
        this.stage.panes[1].clear();
        this.left.stayAt(this.stayedAt);
        if (this.left.shown?.coloring) {
            this.look.show([this.left.shown]);
        }
    }

    /** @param choice  for the right: `level:N`, from 0, or `result:ID` */
    choose(choice) {
        const [kind, value] = choice.split(':');
        this.closeOther();
        this.beside = kind === 'level' ? Number(value) : null;
        if (kind === 'result') {
            this.other = new ResultSession(this.library.jobs.find(({ id }) => id === value) ?? { id: value, type: 'job' }, this.stage.panes[1], {
                dress: (level, signal) => this.dress(level, signal),
                onJob: () => {},
                onLevels: () => this.show(),
                onFirstPicture: () => {},
                onMissing: (error) => {
                    showMissing(error);
                    this.choose(`level:${this.left.loader.levels.length - 1}`);
                },
                onError: showProblem,
            });
        }
        this.show();
        this.onChange();
    }

    closeOther() {
        this.other?.close();
        this.other = null;
        this.painted = [];
    }

    /** The level on the right, once it is there. */
    get right() {
        if (!this.isOn || this.other) {
            return this.other?.shown;
        }
        const { levels } = this.left.loader;
        return levels[this.beside]?.state === 'ready' ? levels[this.beside] : levels.findLast(({ state }) => state === 'ready');
    }

    show() {
        if (!this.isOn) {
            return;
        }
        const { left, other, right } = this;
        if (right) {
            this.paint(right);
        }
        this.view.label(this.sideOf(left, left.shown), this.sideOf(other ?? left, right));
        const labels = left.job?.request.labels ?? [];
        const others = this.library.othersWithPicture(left.id);
        this.view.showChoices([
            { label: 'The same result', choices: left.loader.levels.map(({ level, points }) => ({ value: `level:${level}`, text: labels[level] ?? `Level ${level + 1}, ${format.compactCount(points)}` })) },
            { label: 'Another result', choices: others.map((job) => ({ value: `result:${job.id}`, text: `${titleOf(job)}: ${summaryOf(job, this.library.cloudOf(job))}` })) },
        ], other ? `result:${other.id}` : `level:${right?.level}`);
    }

    /** What stands above a level: what tells it from the other side, beside its figures. A map's are not those of what it is about. */
    sideOf({ job }, level) {
        const { left, other } = this;
        const ofTwoClouds = other?.job && left.job && inputOf(other.job) !== inputOf(left.job);
        const label = job?.request.labels?.[level?.level];  // of an evaluation, in which each level is another candidate's map
        const isMap = job?.type === 'evaluate';
        const kind = isMap ? ['Error map', label].filter(Boolean).join(' of ') : other && job?.request.method;
        return { level, isMap, names: [ofTwoClouds && titleOf(job), kind] };
    }

    /** The level on the right, once for each choice of colours and range. */
    paint(level) {
        const wanted = [level, this.look.colorOf(level), this.rangeBeside(level)];
        if (wanted.every((part, i) => part === this.painted[i])) {
            return;
        }
        this.painted = wanted;
        if (this.other) {
            this.other.redress();
        } else {
            this.showRight(level);
        }
    }

    /** In the colours of now, or where they cannot be had, of before; unless another is wanted by then. */
    async showRight(level) {
        const { signal } = this.left.abort;
        await this.dress(level, signal).catch((error) => signal.aborted || showProblem(error, 'The colours could not be shown'));
        if (!signal.aborted && !this.other && level === this.right) {
            this.stage.panes[1].show(level);
        }
    }

    /** Gives a level that is about to be shown the colours that are wanted now. Where both sides have the same values, one legend is true of both. */
    async dress(level, signal) {
        const { stage, look } = this;
        const by = look.colorOf(level);
        level.coloring ??= { by: 'own', range: null };  // as long as others are not there
        const range = await colorize(level.whole ?? level, by, { way: stage.wayTo(level), range: this.rangeBeside(level), signal });
        if (by !== look.colorOf(level)) {
            await this.dress(level, signal);  // chosen meanwhile
            return;
        }
        level.coloring = { by, range };
        if (this.isCandidate(level) && !this.ranges.has(by)) {
            this.ranges.set(by, range);
        }
        const shown = [this.left?.shown, this.right].filter((side) => side?.coloring);
        if (shown.includes(level)) {
            look.show(shown);
        }
    }

    /** For a level on the right: the range of the same values on the left. For a candidate: that of the others, so that their colours tell which is better. */
    rangeBeside(level) {
        const left = this.left?.shown;
        const by = this.look.colorOf(level);
        if (this.isCandidate(level) && this.ranges.has(by)) {
            return this.ranges.get(by);
        }
        return left && left !== level && left.coloring?.by === by ? left.coloring.range : null;
    }

    isCandidate(level) {
        return this.left?.type === 'evaluate' && this.left.loader.levels.includes(level);
    }
}
