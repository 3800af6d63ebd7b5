import { byId, setHidden } from './element.js';

const kSwipe = 16;
const kStates = ['folded', 'half', 'open'];  // from low to high: the title alone, what is shown, and the lists below it

export const isPhone = () => matchMedia('(max-width: 840px), (max-height: 480px)').matches;

/** On a phone: the card and the lists, which are pulled up from below by a grip that is tapped or swiped. */
export class Sheet {
    constructor() {
        let start = 0;
        let swiped = 0;
        byId.grip.onpointerdown = ({ clientY, pointerId }) => {
            start = clientY;
            byId.grip.setPointerCapture(pointerId);
        };
        byId.grip.onpointerup = ({ clientY }) => {
            swiped = start - clientY;
            if (Math.abs(swiped) > kSwipe) {
                this.move(Math.sign(swiped));
            }
        };
        byId.grip.onclick = () => {
            if (Math.abs(swiped) <= kSwipe) {
                this.move(this.isOpen ? -1 : 1);
            }
            swiped = 0;
        };
        byId.fold.onclick = () => this.show('folded');
        byId.stage.addEventListener('pointerdown', () => this.close());
        this.show('half');
    }

    get isOpen() {
        return this.state === 'open';
    }

    /** @param step  1: higher, -1: lower, as far as it goes; without a result there is nothing to fold */
    move(step) {
        const at = Math.max(byId.hud.hidden ? 1 : 0, kStates.indexOf(this.state) + step);
        this.show(kStates[Math.min(at, kStates.length - 1)]);
    }

    /** The focus of what is hidden goes to the grip, which says what it shows next. */
    show(state) {
        this.state = state;
        const isFolded = state === 'folded';
        byId.dock.classList.toggle('open', this.isOpen);
        byId.dock.classList.toggle('folded', isFolded);
        setHidden(byId.fold, state !== 'half', byId.grip);
        byId.grip.ariaExpanded = String(this.isOpen);
        byId.grip.setAttribute('aria-controls', isFolded ? 'hud' : 'library');
        byId.grip.ariaLabel = isFolded ? 'Show level and figures' : `${this.isOpen ? 'Hide' : 'Show'} clouds and results`;
    }

    /** Where the window is so low, as at a zoom of 400 %, that the card leaves hardly any for two clouds. */
    makeRoom() {
        if (this.state === 'half' && matchMedia('(max-height: 300px)').matches) {
            this.show('folded');
        }
    }

    /** Where there is no card any more. */
    unfold() {
        if (this.state === 'folded') {
            this.show('half');
        }
    }

    /** The focus goes to the grip. */
    close() {
        if (this.isOpen) {
            if (byId.library.contains(document.activeElement)) {
                byId.grip.focus();
            }
            this.show('half');
        }
    }
}
