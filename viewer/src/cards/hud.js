import { drawnErrorOf, errorText, intervalText, meanErrorOf } from '../loading/level_error.js';
import { fadeWhereCut } from '../page/cut_edges.js';
import { actOnSecondClick, byId, element, exchange, setHidden, whileSaying } from '../page/element.js';
import * as format from '../page/format.js';

/** Of a bound, so that the slider's end at the coarsest level stands for its own error. */
const kSlack = 1 + 1e-9;
const kNoError = 1e-12;  // for a logarithm

const kStages = { queued: 'Waiting', decode: 'Reading', clean: 'Cleaning', simplify: 'Simplifying', upsample: 'Adding points', analyze: 'Analysing', evaluate: 'Measuring', encode: 'Encoding' };

/** The card with the level slider and the figures. */
export class Hud {
    constructor({ onLevel, onError, onCancel, onDownload, onMap, onFigures, onRemove, onAgain, onRemoveAll }) {
        Object.assign(this, { onDownload, onMap, onFigures, onRemove, onAgain, onRemoveAll });
        byId.dismiss.onclick = onCancel;
        byId.level.oninput = () => onLevel(Number(byId.level.value) - 1);
        fadeWhereCut(byId.files);
        byId['error-bound'].oninput = () => {
            onError(kSlack * 2 ** -Number(byId['error-bound'].value));  // finer to the right, as levels are
        };
    }

    open(title) {
        byId.hud.hidden = false;
        byId.title.textContent = title;
        byId.title.title = '';
        byId.segments.replaceChildren();
        byId.level.disabled = true;
        setHidden(byId.dismiss, true);
        byId.reason.hidden = true;
        byId.hud.classList.remove('busy', 'plain');
        exchange(byId.files);
        byId.files.hidden = false;  // its room is kept until it is known to be empty
        this.actionsOf = null;
        this.isOver = this.isGivenUp = this.isVain = false;
        byId.legend.hidden = true;
        byId['error-slider'].hidden = true;
        for (const id of ['points', 'level-name', 'bytes', 'error', 'first-picture']) {
            byId[id].textContent = '–';
        }
        this.isWaiting = false;
        this.showActivity('Opening');
    }

    close() {
        setHidden(byId.hud, true);
    }

    showJob(job) {
        byId.title.title = byId.title.textContent;
        if (this.type !== job.type) {
            this.type = job.type;
            this.actionsOf = null;
            const isOfCandidates = job.type === 'evaluate';
            byId['level-title'].textContent = isOfCandidates ? 'Candidate' : 'Level';
            byId.level.ariaLabel = isOfCandidates ? 'Candidate' : 'Level of detail';
        }
        const isBusy = job.status === 'accepted' || job.status === 'running';
        byId.hud.classList.toggle('busy', isBusy);
        byId.progress.value = job.progress;
        const isGivenUp = job.status === 'failed' || job.status === 'dismissed';
        this.isGivenUp = isGivenUp;
        this.isVain = job.status === 'failed' && job.levels_ready === 0;
        setHidden(byId.dismiss, !isBusy);
        this.isOver = !isBusy;
        if (isGivenUp && !this.actionsOf) {
            this.showActions();  // also without a level it can be removed
        }
        if (isBusy) {
            const stage = job.status === 'accepted' ? 'Waiting' : kStages[job.stage] ?? 'Working';
            this.showActivity(stage, `, ${Math.round(job.progress)} %`);
        } else {
            this.showEnd(job);
        }
        if (job.status === 'failed') {
            this.showReason(job);
        }
    }

    /** How a job ended that did not succeed. */
    showEnd(job) {
        this.showActivity({ failed: 'Failed', dismissed: 'Cancelled' }[job.status] ?? '');
    }

    /** Why there is no result, or not all of it. */
    showReason({ problem, levels_ready: levels }) {
        const { title = 'Failed', detail = 'The server gave no reason.', candidate } = problem ?? {};
        const parts = [title, candidate && `candidate ${candidate}`, detail !== title && detail];
        byId.reason.textContent = parts.filter(Boolean).join(': ');
        byId.reason.hidden = false;
        if (levels === 0) {
            byId.hud.classList.add('plain');
        }
    }

    /**
     * @param levels  of the LevelLoader; @param shown  the one on the stage, or null
     * @param hasAll  whether no more will come; @param bound  of the error, where that was asked for, or null
     */
    showLevels(levels, shown, loadedBytes, hasAll, bound) {
        byId.level.max = Math.max(1, levels.length);
        byId.level.disabled = levels.length < 2;
        byId.segments.replaceChildren(...levels.map((level) => element('li', {
            className: shown && level.level <= shown.level ? 'shown' : level.state,
        })));
        this.showArrival(levels, loadedBytes);
        this.showErrors(levels, shown, bound);
        if (shown) {
            this.showFiles(shown);
            byId.level.value = shown.level + 1;
            byId.level.ariaValueText = `${byId['level-title'].textContent} ${shown.level + 1}, ${format.points(shown.points)}`;
            byId.points.textContent = format.share(shown.drawn?.points ?? shown.points, shown.points);
            byId['level-name'].textContent = `${shown.level + 1} of ${levels.length}${hasAll ? '' : '+'}`;
        }
    }

    /** Of what is on its way, how much is there. */
    showArrival(levels, loadedBytes) {
        byId.bytes.textContent = format.bytes(loadedBytes);
        levels.forEach(({ arrived, bytes }, i) => {
            byId.segments.children[i]?.style.setProperty('--arrived', arrived ? arrived / bytes : 0);
        });
    }

    /** The measured error of what is shown, and the bounds to choose from. */
    showErrors(levels, shown, bound) {
        const errors = levels.map(meanErrorOf).filter((error) => error >= 0);
        const [least, most] = [Math.min(...errors.filter((error) => error > 0)), Math.max(...errors)];
        const error = shown && drawnErrorOf(shown);
        byId.error.textContent = error ? errorText(error, { isShort: true }) : '–';
        byId['error-name'].textContent = shown?.tiles ? 'Error in view' : 'Error';
        byId['error-figure'].title = error ? this.errorTitle(shown, error) : '';
        const hasBounds = least < most && this.type !== 'evaluate';  // of candidates none is a finer one
        byId['error-slider'].hidden = !hasBounds;
        if (hasBounds) {
            byId['error-bound'].min = -Math.log2(most);
            byId['error-bound'].max = -Math.log2(least) + (errors.includes(0) ? 1 : 0);  // one octave for none at all
            this.showBound(shown, bound);
        }
    }

    /** The largest is that of all points of an evaluation alone: else it is that of the samples that were measured. */
    errorTitle(shown, { mean, max, confidence, rounding = 0 }) {
        const measured = rounding > 0 && !shown.tiles ? shown.error.relative : { mean: mean - rounding, max };
        const ofMean = `Mean distance to the surface of the input ${format.percent(measured.mean)}${intervalText({ ...measured, confidence })} of its diagonal`;
        const ofLargest = max >= 0 ? `, largest ${this.type === 'evaluate' ? '' : 'at least '}${format.percent(measured.max)}` : '';
        const ofRounding = rounding > 0 ? `; the file rounds places by up to ${format.percent(rounding)} on average` : '';
        return `${ofMean}${ofLargest}${ofRounding}${shown.tiles ? '. For what is drawn: finer closer to the camera' : ''}`;
    }

    /** Without a bound, of a level its own error. Of tiles there is none then: how fine they are is up to the view. */
    showBound(shown, bound) {
        if (!shown && bound === null) {
            return;
        }
        const error = bound ?? meanErrorOf(shown);
        byId['error-bound'].value = -Math.log2(Math.max(bound === null ? error : error / kSlack, kNoError));
        byId['error-bound-value'].textContent = bound === null && shown.tiles ? 'by view' : error >= 0 ? format.percent(error) : '–';
        byId['error-bound'].ariaValueText = byId['error-bound-value'].textContent;
    }

    /** What can be done with what is shown. Made anew for another level alone: a button that is replaced loses its click. */
    showFiles(level) {
        if (level === this.actionsOf && this.isOver === this.actionsOver) {
            return;
        }
        this.actionsOf = level;
        this.actionsOver = this.isOver;
        const { files, error, ply } = level;
        const saved = files.filter(({ format: extension }) => extension in format.kKinds).map((file) => {
            const size = `, ${format.bytes(file.bytes)}`;
            return action(file.format, [`Save ${format.kKinds[file.format]}`, size], `Save what is shown${size}`, () => this.onDownload(file));
        });
        if (ply && !files.some(({ format: extension }) => extension === 'ply')) {
            saved.unshift(action('ply', `Save ${format.kKinds.ply}`, 'Save what is shown', () => this.onDownload({ format: 'ply', ply })));
        }
        // Of a level with a file the figures tell whether it was measured, of one without its mean, which is 0 for the input itself.
        const map = this.type === 'evaluate' ? [opensReport(action('figures', 'Figures', 'Show the measurements', this.onFigures))]
            : (ply ? meanErrorOf(level) > 0 : error?.samples > 0)
                ? [action('map', 'Error map', 'Measure and show its distance from the input everywhere', whileSaying(kStages.evaluate, this.onMap))] : [];
        this.showActions(...saved, ...map);
    }

    /** Of a result without a picture: what is told of it is elsewhere. */
    showPlain({ id, levels }) {
        byId.hud.classList.add('plain');
        if (this.actionsOf === id && this.isOver === this.actionsOver) {
            return;
        }
        this.actionsOf = id;
        this.actionsOver = this.isOver;
        const pictures = levels.flatMap(({ pictures: some = [] }) => some).map((picture) =>
            action(picture.sha256, `Save ${format.kKinds.png}, ${format.bytes(picture.bytes)}`, 'Save the picture', () => this.onDownload({ ...picture, format: 'png' })));
        this.showActions(...pictures, action('figures', 'Save figures', 'Save all measurements as JSON', () => this.onDownload({ href: `v1/jobs/${id}/results`, format: 'json' })));
    }

    showActions(...actions) {
        const again = this.isGivenUp ? [action('again', 'Start again', 'Start the same job once more', this.onAgain)] : [];
        const removeAll = this.isVain ? [action('remove-all', 'Remove with its cloud', 'Remove this result and its cloud from the server')] : [];
        const remove = this.isOver ? [action('remove', 'Remove', 'Remove this result from the server')] : [];
        removeAll.forEach((button) => actOnSecondClick(button, this.onRemoveAll));
        remove.forEach((button) => actOnSecondClick(button, this.onRemove));
        exchange(byId.files, ...actions, ...again, ...removeAll, ...remove);
        byId.files.hidden = byId.files.children.length === 0;
    }

    /** @param share  of it that is done: only for the eye, since the progress bar tells it, too */
    showActivity(text, share = '') {
        this.activity = [text, share];
        this.tellActivity();
    }

    /** While the server cannot be reached. */
    setWaiting(isWaiting) {
        this.isWaiting = isWaiting;
        this.tellActivity();
    }

    tellActivity() {
        const [text, share] = this.isWaiting ? ['Waiting for the server', ''] : this.activity;
        if (byId.activity.textContent !== text) {
            byId.activity.textContent = text;  // said aloud
        }
        byId['activity-share'].textContent = share;
    }

    showFirstPicture(ms) {
        byId['first-picture'].textContent = format.milliseconds(ms);
    }
}

/** A button of what is opened and closed by it. */
function opensReport(button) {
    button.setAttribute('aria-controls', 'report');
    button.ariaExpanded = String(!byId.report.hidden);
    return button;
}

/** @param name  by which the next one of its kind is known; @param text  or a text and what can be left out after it */
const action = (name, text, title, onclick) => {
    const [label, size] = [text].flat();  // where there is little room the first is enough
    return element('button', { id: `action-${name}`, className: 'action', title, onclick }, label,
        ...(size ? [element('span', { className: 'size', textContent: size })] : []));
};
