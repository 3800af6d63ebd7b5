import { mayPass } from '../api/api.js';
import { uploadCloud } from '../api/upload.js';
import { fadeWhereCut } from '../page/cut_edges.js';
import { byId, element } from '../page/element.js';
import * as format from '../page/format.js';
import { showProblem } from '../page/notices.js';

const kToldPercent = 25;
const kRateMs = 4_000;     // the speed is that of the last seconds, ...
const kFirstRateMs = 700;  // ... once there is one to speak of

/** Files on their way to the server, one after the other. Each is a row below the button that adds them, and can be called off there. */
export class UploadQueue {
    /**
     * @param onStart  told when the first of several files sets out; @param onEnd  when none is left: the clouds
     * @param onProgress  told the `name` and a `note` of what is being sent
     */
    constructor({ onStart, onEnd, onProgress }) {
        Object.assign(this, { onStart, onEnd, onProgress });
        this.waiting = [];
        this.isBusy = false;
        fadeWhereCut(byId.uploads);
        addEventListener('beforeunload', (event) => this.isBusy && event.preventDefault());  // what is sent would be lost
    }

    add(files) {
        this.waiting.push(...files.map((file) => this.upload(file)));
        if (!this.isBusy) {
            this.sendAll();
        }
    }

    /** One file, with its row. */
    upload(file) {
        const upload = { file, abort: new AbortController() };
        const cancel = element('button', { className: 'close', textContent: '×', title: 'Cancel', ariaLabel: `Cancel ${file.name}` });
        cancel.onclick = () => {
            upload.abort.abort();
            this.waiting = this.waiting.filter((other) => other !== upload);
            removeRow(upload);
        };
        upload.note = element('span', { className: 'row-note', textContent: `Waiting, ${format.bytes(file.size)}` });
        upload.bar = element('progress', { max: 1, value: 0, ariaLabel: `Upload of ${file.name}`, hidden: true });
        upload.row = element('li', {}, element('span', { className: 'row-text' },
            element('span', { className: 'row-name', dir: 'auto', textContent: file.name, title: file.name }), upload.note, upload.bar), cancel);
        byId.uploads.append(upload.row);
        return upload;
    }

    async sendAll() {
        this.isBusy = true;
        this.onStart();
        const clouds = [];
        const refused = [];
        let forget = () => {};
        while (this.waiting.length > 0) {
            const upload = this.waiting.shift();
            try {
                clouds.push(await this.send(upload));
            } catch (error) {
                if (!upload.abort.signal.aborted) {
                    refused.push({ file: upload.file, error });
                    forget();
                    forget = this.tell(refused);
                }
            }
            removeRow(upload);
        }
        this.isBusy = false;
        byId['upload-told'].textContent = '';
        this.onEnd(clouds);
    }

    /** What became of files that are not there, in one notice. */
    tell(refused) {
        const lost = refused.filter(({ error }) => mayPass(error)).map(({ file }) => file);
        const action = lost.length > 0 ? { action: { name: 'Try again', act: () => this.add(lost) } } : {};
        const what = lost.length === refused.length ? 'sent' : 'accepted';
        if (refused.length === 1) {
            return showProblem({ message: reasonOf(refused[0]) }, `${refused[0].file.name} was not ${what}`, action);
        }
        const message = refused.map((one) => `${one.file.name}: ${reasonOf(one)}`).join('\n');
        return showProblem({ message }, `${refused.length} files were not ${what}`, action);
    }

    /** The document of the cloud. */
    async send({ file, abort: { signal }, note, bar }) {
        const rate = new Rate();
        const tell = (text, told = text) => {
            note.textContent = text;
            this.onProgress({ name: file.name, note: text });
            say(`${file.name}: ${told}`);
        };
        bar.hidden = false;
        tell('Sending');
        return uploadCloud(file, {
            signal,
            onProgress: (sent, all) => {
                bar.value = all > 0 ? sent / all : 1;
                if (sent < all) {
                    tell([format.bytesOf(sent, all), rate.left(sent, all)].filter(Boolean).join(', '),
                        `${kToldPercent * Math.floor(100 * sent / all / kToldPercent)} % sent`);
                } else {
                    tell('Storing');
                }
            },
        });
    }
}

/** Of a file that is in no format that the server knows its first bytes tell a person nothing. */
const reasonOf = ({ error }) => error.message.replace(/^(neither [^:]*): the file starts with .*/s, 'The file is $1.');

/** How long the rest of a file will take, by how fast the last of it went. */
class Rate {
    constructor() {
        this.samples = [];
    }

    left(sent, all) {
        const now = performance.now();
        this.samples.push({ now, sent });
        while (now - this.samples[0].now > kRateMs) {
            this.samples.shift();
        }
        const [first] = this.samples;
        return now - first.now > kFirstRateMs && sent > first.sent
            ? `${format.duration((all - sent) * (now - first.now) / 1000 / (sent - first.sent))} left` : null;
    }
}

/** The focus goes to the button that adds files. */
function removeRow({ row }) {
    const hadFocus = row.contains(document.activeElement);
    row.remove();
    if (hadFocus) {
        byId.choose.focus();
    }
}

/** Aloud: only what is new. */
function say(text) {
    if (byId['upload-told'].textContent !== text) {
        byId['upload-told'].textContent = text;
    }
}
