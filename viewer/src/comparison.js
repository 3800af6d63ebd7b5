import { byId, element } from './element.js';
import * as format from './format.js';
import { meanErrorOf } from './result_session.js';

const kStep = 0.02;

/** Two results with one camera: what is on the right, the line between them, the labels above. */
export class Comparison {
    /** @param onChoice  told which of `choices` is wanted on the right */
    constructor(stage, { onStart, onEnd, onChoice }) {
        Object.assign(this, { stage, onStart, onEnd, onChoice });
        byId.compare.onclick = () => (this.isOn ? this.end() : this.start());
        byId['compare-with'].onchange = () => onChoice(byId['compare-with'].value);
        byId['compare-mode'].onclick = () => this.setMode(stage.split.mode === 'swipe' ? 'beside' : 'swipe');
        byId.divider.onpointerdown = (event) => this.drag(event);
        byId.divider.onkeydown = (event) => {
            const step = { ArrowLeft: -kStep, ArrowRight: kStep }[event.key];
            if (step) {
                event.preventDefault();
                this.moveTo(stage.split.at + step);
            }
        };
        addEventListener('resize', () => this.place());
    }

    get isOn() {
        return this.stage.split.mode !== 'one';
    }

    start() {
        byId.compare.ariaPressed = 'true';
        document.body.classList.add('comparing');
        this.setMode('swipe');
        this.onStart();
    }

    end() {
        if (this.isOn) {
            byId.compare.ariaPressed = 'false';
            document.body.classList.remove('comparing');
            this.setMode('one');
            this.onEnd();
        }
    }

    setMode(mode) {
        this.stage.setSplit({ mode });
        byId['compare-mode'].textContent = mode === 'swipe' ? 'Side by side' : 'Swipe';
        byId.divider.classList.toggle('fixed', mode === 'beside');
        byId.divider.hidden = mode === 'one';
        byId['compare-bar'].hidden = mode === 'one';
        this.place();
    }

    drag(event) {
        if (this.stage.split.mode === 'swipe') {
            byId.divider.setPointerCapture(event.pointerId);
            byId.divider.onpointermove = ({ clientX }) => {
                const { left, right } = this.stage.insets;
                this.moveTo((clientX - left) / (innerWidth - left - right));
            };
            byId.divider.onpointerup = () => { byId.divider.onpointermove = null; };
        }
    }

    moveTo(at) {
        this.stage.setSplit({ at: Math.min(0.98, Math.max(0.02, at)) });
        this.place();
    }

    place() {
        byId.divider.style.left = `${this.stage.line()}px`;
        byId.divider.ariaValueNow = String(Math.round(100 * this.stage.split.at));
    }

    /** @param groups  of choices: `{label, choices: [{value, text}]}`; @param chosen  the value of one of them */
    showChoices(groups, chosen) {
        byId['compare-with'].replaceChildren(...groups.filter(({ choices }) => choices.length > 0).map(({ label, choices }) =>
            element('optgroup', { label }, ...choices.map(({ value, text }) => element('option', { value, textContent: text })))));
        byId['compare-with'].value = chosen;
    }

    /** What is left and right: levels, or null. */
    label(left, right) {
        byId['left-label'].textContent = left ? `${format.compactPoints(left.points)} · ${costOf(left)}` : 'Loading';
        byId['right-label'].textContent = right ? costOf(right) : 'Loading';
    }
}

function costOf(level) {
    const error = meanErrorOf(level);
    return [format.bytes(level.file.bytes), ...(error >= 0 ? [`error ${format.percent(error)}`] : [])].join(' · ');
}
