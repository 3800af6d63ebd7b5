import { byId } from '../page/element.js';
import { FilePicker } from '../page/file_picker.js';
import { forgetProblems, offer, showProblem } from '../page/notices.js';
import { nameOf } from './library.js';
import { UploadQueue } from './upload_queue.js';
import { Welcome } from './welcome.js';

/** How clouds come in: chosen or dropped on the page, sent one after the other, and then opened, unless something else was opened meanwhile. */
export class Intake {
    /**
     * @param shown  what is on the stage; @param onSent  told the last cloud of those that were sent, where that is still the same
     * @param onChosen  told one that was sent earlier and is to be opened now; @param onAdded  told that there are more clouds
     */
    constructor({ shown, onSent, onChosen, onAdded }) {
        Object.assign(this, { shown, onSent, onChosen, onAdded });
        const onFiles = (files) => this.add(files);
        this.picker = new FilePicker({ onFiles });
        this.welcome = new Welcome({ onFiles });
        this.before = null;  // what was shown when files set out
        this.queue = new UploadQueue({
            onStart: () => {
                forgetProblems();
                this.before = shown();
            },
            onEnd: (all) => this.end(all).catch(showProblem),
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

    async end({ cloud, count }) {
        this.welcome.invite();
        if (cloud && this.shown() === this.before) {
            this.onAdded().catch(() => {});  // also where no job can be started; the list looks again by itself
            await this.onSent(cloud);
        } else if (cloud) {
            offer(count > 1 ? `${count} clouds were added` : `${nameOf(cloud)} was added`, 'Open it', () => this.onChosen(cloud));
            await this.onAdded();
        }
    }
}
