import { authorization } from '../api/api_key.js';
import { byId, element, setOpen, whileSaying } from '../page/element.js';
import { showProblem } from '../page/notices.js';
import { kPrograms, linesOf } from './program_lines.js';

const kToldMs = 2_000;

/** The card that takes what is shown elsewhere: as a link, a picture, or a few lines for another program. */
export class ShareCard {
    /** @param linkOf  the address of what is shown, as it is looked at; @param onPicture  asked to save one; @param onOpen  told that it covers something */
    constructor({ linkOf, onPicture, onOpen }) {
        this.onOpen = onOpen;
        byId.share.onclick = () => this.toggle();
        byId['share-link'].onclick = () => copy(linkOf(), byId['share-link']);
        byId['share-picture'].onclick = whileSaying('Saving', onPicture);
        byId['share-for'].onchange = () => this.showLines();
        byId['share-copy'].onclick = () => copy(byId['share-lines'].textContent, byId['share-copy']);
    }

    get isOpen() {
        return !byId['share-card'].hidden;
    }

    toggle(how) {
        setOpen(byId['share-card'], !this.isOpen, byId.share, how);
        if (this.isOpen) {
            this.onOpen();
        }
    }

    close() {
        if (this.isOpen) {
            this.toggle();
        }
    }

    /** @param id  of the result; @param type  of its job; @param level  that was chosen, or null; @param formats  of its files; @param isPlaced  on the globe */
    show({ id, type, level, formats, isPlaced }) {
        const shownAs = JSON.stringify([id, type, level, formats, isPlaced]);
        if (shownAs === this.shownAs) {
            return;
        }
        this.shownAs = shownAs;
        this.result = {
            server: new URL('.', document.baseURI).href.replace(/\/$/, ''), id, level, isPlaced,
            collection: type === 'pyramid' ? 'pyramids' : 'jobs', manifest: type === 'pyramid' ? 'manifest.json' : 'results',
            hasKey: Object.keys(authorization()).length > 0,
        };
        const chosen = byId['share-for'].value;
        const fitting = kPrograms.filter(({ needs }) => !needs || formats.includes(needs));
        byId['share-for'].replaceChildren(...fitting.map(({ name }) => element('option', { value: name, textContent: name })));
        byId['share-for'].value = fitting.some(({ name }) => name === chosen) ? chosen : fitting[0].name;
        byId['share-tiles'].hidden = formats.includes('glb');
        this.showLines();
    }

    showLines() {
        byId['share-lines'].textContent = linesOf(kPrograms.find(({ name }) => name === byId['share-for'].value), this.result);
        byId['share-lines'].scrollTo(0, 0);
    }
}

/** Also where the page did not come by HTTPS, and the browser keeps its clipboard from it. */
async function copy(text, button) {
    try {
        await (navigator.clipboard?.writeText(text) ?? copyBySelection(text, button));
        tell(button);
    } catch {
        showProblem(new Error(text), 'The browser does not let this page copy');
    }
}

function copyBySelection(text, button) {
    const field = element('textarea', { value: text, className: 'unseen' });
    document.body.append(field);
    field.select();
    const isCopied = document.execCommand('copy');
    field.remove();
    button.focus();
    if (!isCopied) {
        throw new Error('not copied');
    }
}

function tell(button) {
    button.dataset.text ??= button.textContent;
    button.textContent = 'Copied';
    setTimeout(() => { button.textContent = button.dataset.text; }, kToldMs);
}
