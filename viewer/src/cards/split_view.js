import { drawnErrorOf, errorText } from '../loading/level_error.js';
import { byId, element, setHidden } from '../page/element.js';
import * as format from '../page/format.js';
import { isPhone } from '../page/sheet.js';

const kStep = 0.02;
const kOtherUnit = 100;  // times as large: metres and kilometres, not a part and the whole

/** Two panes with one camera: the line between them, the labels above, the list of what can be on the right. */
export class SplitView {
    /**
     * @param onStart  told that there are two; @param onEnd  that there is one again; @param onLayout  that they lie otherwise
     * @param onChoice  told which of `choices` is wanted on the right
     */
    constructor(stage, { onStart, onEnd, onChoice, onLayout }) {
        Object.assign(this, { stage, onStart, onEnd, onChoice, onLayout });
        byId.compare.onclick = () => (this.isOn ? this.end() : this.start());
        byId['compare-with'].onchange = () => onChoice(byId['compare-with'].value);
        byId['compare-mode'].onclick = () => this.setMode(stage.split.mode === 'swipe' ? 'beside' : 'swipe');
        byId.divider.onpointerdown = (event) => this.drag(event);
        byId.divider.onkeydown = (event) => {
            const { at, mode } = stage.split;
            const to = { ArrowLeft: at - kStep, ArrowRight: at + kStep, Home: 0, End: 1 }[event.key];
            if (mode === 'swipe' && to !== undefined) {
                event.preventDefault();
                this.moveTo(to);
            }
        };
        addEventListener('resize', () => this.place());
    }

    get isOn() {
        return this.stage.split.mode !== 'one';
    }

    start({ layout = null, at = null } = {}) {
        byId.compare.ariaPressed = 'true';
        document.body.classList.add('comparing');
        this.setMode(layout ?? 'swipe');
        this.moveTo(at ?? 0.5);
        this.onStart();
    }

    /** How they lie; null: as at the start, or not at all. */
    get layout() {
        const { mode, at } = this.stage.split;
        return { layout: mode === 'beside' ? mode : null, at: mode === 'swipe' && at !== 0.5 ? Number(at.toFixed(3)) : null };
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
        byId.divider.tabIndex = mode === 'swipe' ? 0 : -1;
        setHidden(byId.divider, mode === 'one', byId.compare);
        setHidden(byId['compare-bar'], mode === 'one', byId.compare);
        this.place();
        this.onLayout();
    }

    drag(event) {
        if (this.stage.split.mode === 'swipe') {
            byId.divider.setPointerCapture(event.pointerId);
            byId.divider.onpointermove = ({ clientX }) => {
                const { left, right } = this.stage.insets;
                this.moveTo((clientX - left) / (innerWidth - left - right));
            };
            byId.divider.onpointerup = byId.divider.onpointercancel = () => { byId.divider.onpointermove = null; };
        }
    }

    moveTo(at) {
        this.stage.setSplit({ at: Math.min(0.98, Math.max(0.02, at)) });
        this.place();
        this.onLayout();
    }

    place() {
        byId.divider.style.bottom = `${this.stage.insets.bottom}px`;  // its handle in the middle of what is seen
        const { style } = document.documentElement;
        style.setProperty('--split', `${this.stage.line()}px`);
        style.setProperty('--right', `${this.stage.insets.right}px`);
        byId.divider.ariaValueNow = String(Math.round(100 * this.stage.split.at));
    }

    /** @param groups  of choices: `{label, choices: [{value, text}]}`; @param chosen  the value of one of them */
    showChoices(groups, chosen) {
        byId['compare-with'].replaceChildren(...groups.filter(({ choices }) => choices.length > 0).map(({ label, choices }) =>
            element('optgroup', { label }, ...choices.map(({ value, text }) => element('option', { value, textContent: text })))));
        byId['compare-with'].value = chosen;
    }

    /** What is left and right: `level`, or null, `names`, what tells them apart, and whether it `isMap`. */
    label(left, right) {
        const [leftText, rightText] = [left, right].map(({ level, names, isMap }) => (level ? [...names, ...figuresOf(level, isMap)] : ['Loading']));
        const doubt = left.level && right.level ? doubtOf(this.stage.boxOf(left.level), this.stage.boxOf(right.level)) : null;
        byId['left-label'].textContent = textOf(leftText);
        byId['right-label'].textContent = textOf([...rightText, doubt]);
    }
}

const textOf = (parts) => parts.filter(Boolean).join(' · ');

/** Why there may be nothing to see of one beside the other, or null. */
function doubtOf(box, other) {
    const [size, otherSize] = [box, other].map(({ min, max }) => min.distanceTo(max));
    if (size > kOtherUnit * otherSize && otherSize > 0 || otherSize > kOtherUnit * size && size > 0) {
        return 'in different units?';
    }
    return box.intersectsBox(other) ? null : 'lies elsewhere';
}

/** What is drawn, which of a level that comes in tiles may be a part. */
function drawnOf({ drawn, points }) {
    return !drawn || drawn.points === points
        ? format.compactPoints(points) : `${format.compactCount(drawn.points)} of ${format.compactPoints(points)}`;
}

/** A level has a file of its own, or is the first bytes of a stream; the bytes of a view of tiles are not known. Of a map the error alone. */
function figuresOf(level, isMap) {
    const error = drawnErrorOf(level);
    const bytes = level.tiles ? [] : [format.bytes(level.file?.bytes ?? level.bytes)];
    return [...(isMap ? [] : [drawnOf(level), ...bytes]), ...(error ? [`error\u00a0${errorText(error, { isShort: isPhone() })}`] : [])];
}
