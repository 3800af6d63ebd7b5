import { byId } from '../page/element.js';
import { FilePicker } from '../page/file_picker.js';
import { forgetProblems, showProblem, tell } from '../page/notices.js';
import { nameOf } from './library.js';
import { UploadQueue } from './upload_queue.js';
import { Welcome } from './welcome.js';

/** How clouds come in: chosen or dropped on the page, sent one after the other, and then opened, unless something else was opened meanwhile. */
export class Intake {
    /**
     * @param shown  what is on the stage; @param listed  the cloud of an id in the list, if it is there
     * @param onSent  told the last cloud of those that were sent, where that is still the same
     * @param onChosen  told one that was sent earlier and is to be opened now; @param onAdded  told that there are more clouds
     */
    constructor({ shown, listed, onSent, onChosen, onAdded }) {
        Object.assign(this, { shown, listed, onSent, onChosen, onAdded });
        const onFiles = (files) => this.add(files);
        this.picker = new FilePicker({ onFiles });
        this.welcome = new Welcome({ onFiles });
        this.before = null;  // what was shown when files set out
        this.queue = new UploadQueue({
            onStart: () => {
                forgetProblems();
                this.before = shown();
            },
            onEnd: (clouds) => this.end(clouds).catch(showProblem),
            onProgress: (sending) => this.welcome.showProgress(sending),
        });
    }

    /** Asks for a cloud in the middle of the page, or does so no more. */
    setInviting(isInviting) {
        this.welcome.setShown(isInviting);
    }

    add(files) {
        byId['job-dialog'].close();
        byId['help-dialog'].close();
        this.queue.add(files);
    }

    async end(clouds) {
        this.welcome.invite();
        if (clouds.length === 0) {
            return;
        }
        const cloud = clouds.at(-1);
        const count = new Set(clouds.map(({ id }) => id)).size;
        const added = count > 1 ? `${count} clouds were added` : `${nameOf(cloud)} was added`;
        this.tellRenamed(clouds);
        if (this.shown() === this.before) {
            if (count > 1) {
                tell(added);
            }
            this.onAdded().catch(() => {});  // also where no job can be started; the list looks again by itself
            await this.onSent(cloud);
        } else {
            tell(added, { name: 'Open it', act: () => this.onChosen(cloud) });
            await this.onAdded();
        }
    }

    /** The same bytes are one cloud, which is called as it was sent last. */
    tellRenamed(clouds) {
        const renamed = clouds.filter(({ id, name, isNew }) => !isNew && (this.listed(id)?.name ?? name) !== name);
        if (renamed.length === 1) {
            tell(`${renamed[0].name} is the same cloud as ${this.listed(renamed[0].id).name}`);
        } else if (renamed.length > 1) {
            tell(`${renamed.length} clouds were there already under other names`);
        }
    }
}
