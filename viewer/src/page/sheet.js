import { byId } from './element.js';

const kSwipe = 16;

export const isPhone = () => matchMedia('(max-width: 840px), (max-height: 480px)').matches;

/** On a phone: the lists, which are pulled up from below by a grip that is tapped or swiped. */
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
                this.open(swiped > 0);
            }
        };
        byId.grip.onclick = () => {
            if (Math.abs(swiped) <= kSwipe) {
                this.open(!this.isOpen);
            }
            swiped = 0;
        };
        byId.stage.addEventListener('pointerdown', () => this.close());
    }

    get isOpen() {
        return byId.dock.classList.contains('open');
    }

    open(isOpen = true) {
        byId.dock.classList.toggle('open', isOpen);
        byId.grip.ariaExpanded = String(isOpen);
        byId.grip.ariaLabel = `${isOpen ? 'Hide' : 'Show'} clouds and results`;
    }

    /** The focus goes to the grip. */
    close() {
        if (this.isOpen && byId.library.contains(document.activeElement)) {
            byId.grip.focus();
        }
        this.open(false);
    }
}
