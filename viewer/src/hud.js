import { byId, element } from './element.js';
import * as format from './format.js';

const kStages = { queued: 'Waiting', decode: 'Reading', clean: 'Cleaning', simplify: 'Simplifying', encode: 'Encoding' };

/** The card with the level slider and the figures. */
export class Hud {
    constructor({ onLevel, onDismiss }) {
        byId.level.oninput = () => onLevel(Number(byId.level.value) - 1);
        byId.dismiss.onclick = onDismiss;
    }

    open(title) {
        byId.hud.hidden = false;
        byId.title.textContent = title;
        byId.segments.replaceChildren();
        byId.dismiss.hidden = true;
        byId.hud.classList.remove('busy');
        for (const id of ['activity', 'points', 'level-name', 'error', 'bytes', 'first-picture']) {
            byId[id].textContent = id === 'activity' ? 'Opening' : '–';
        }
    }

    showJob(job) {
        const isBusy = job.status === 'accepted' || job.status === 'running';
        byId.hud.classList.toggle('busy', isBusy);
        byId.progress.value = job.progress;
        byId.dismiss.hidden = !isBusy;
        if (isBusy) {
            const stage = job.status === 'accepted' ? 'Waiting' : kStages[job.stage] ?? 'Working';
            byId.activity.textContent = `${stage}, ${Math.round(job.progress)} %`;
        } else {
            byId.activity.textContent = { failed: 'Failed', dismissed: 'Cancelled' }[job.status] ?? '';
        }
    }

    /** @param levels  of the LevelLoader; @param shown  the one on the stage, or null */
    showLevels(levels, shown, loadedBytes, isComplete) {
        byId.level.max = Math.max(1, levels.length);
        byId.level.disabled = levels.length < 2;
        byId.segments.replaceChildren(...levels.map((level) => element('li', {
            className: shown && level.level <= shown.level ? 'shown' : level.state,
        })));
        byId.bytes.textContent = format.bytes(loadedBytes);
        if (shown) {
            byId.level.value = shown.level + 1;
            byId.level.ariaValueText = `Level ${shown.level + 1}, ${format.points(shown.points)}`;
            byId.points.textContent = format.count(shown.points);
            byId['level-name'].textContent = `${shown.level + 1} of ${levels.length}${isComplete ? '' : '+'}`;
            byId.error.textContent = shown.error ? format.share(shown.error.relative.mean) : '–';
        }
    }

    showActivity(text) {
        byId.activity.textContent = text;
    }

    showFirstPicture(ms) {
        byId['first-picture'].textContent = format.milliseconds(ms);
    }
}
