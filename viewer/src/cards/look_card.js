import { kAxes, keyOf, kGradient, kGrey, kLowest } from '../drawing/coloring.js';
import { byId, element, setOpen } from '../page/element.js';
import * as format from '../page/format.js';

const kDistance = 'distance';  // the attribute of an error map
const kAnalyzed = ['line', 'variation'];  // what of an analysis is seen first: of its lines which, of its points how curved
const kAlways = [['clay', 'Clay'], ['normal', 'Normals'], ['x', 'Position, x'], ['y', 'Position, y'], ['z', 'Position, z']];

/** The card that says how the cloud is drawn, and the legend of the values that its colours stand for. */
export class LookCard {
    /** @param onOpen  told that it covers something */
    constructor({ onColor, onLook, onOpen }) {
        this.onOpen = onOpen;
        this.by = null;  // what was chosen, or null: the cloud's own colours where it has some
        byId['legend-bar'].style.background = kGradient;
        byId.color.onchange = () => {
            this.by = byId.color.value;
            onColor();
        };
        this.tell = () => onLook({ splatSize: 2 ** Number(byId['splat-size'].value), shading: Number(byId.shading.value) });
        byId['splat-size'].oninput = this.tell;
        byId.shading.oninput = this.tell;
        byId.look.onclick = () => this.toggle();
        byId['look-reset'].onclick = () => this.restore({ color: this.by });
    }

    /** What was chosen; null: as it is anyway. */
    get chosen() {
        const splatSize = Number((2 ** Number(byId['splat-size'].value)).toPrecision(3));
        const shading = Number(byId.shading.value);
        return { color: this.by, splatSize: splatSize === 1 ? null : splatSize, shading: shading === 1 ? null : shading };
    }

    restore({ color, splatSize = null, shading = null }) {
        this.by = color;
        byId['splat-size'].value = Math.log2(splatSize ?? 1);
        byId.shading.value = shading ?? 1;
        this.tell();
    }

    get isOpen() {
        return !byId['look-card'].hidden;
    }

    toggle(how) {
        setOpen(byId['look-card'], !this.isOpen, byId.look, how);
        if (this.isOpen) {
            this.onOpen();
        }
    }

    open() {
        if (!this.isOpen) {
            this.toggle();
        }
    }

    close() {
        if (this.isOpen) {
            this.toggle();
        }
    }

    /** As before a choice was made: an error map shows distances, an analysis what it found. */
    forgetColor() {
        this.by = null;
    }

    /** What the colours of a level stand for now. */
    colorOf(level) {
        const choices = this.choices(level).map(([value]) => value);
        return [this.by, ...(isErrorMap(level) ? [kDistance] : level.isAnalysis ? kAnalyzed : [])].find((by) => choices.includes(by)) ?? choices[0];
    }

    choices(level) {
        const own = level.isColored ? [['own', 'Own colours']] : [];
        const attributes = level.tiles && !level.tiles.withAttributes ? [] : level.attributes;
        return [...own, ...kAlways.slice(0, 2), ...attributes.map(({ name }) => [keyOf(name), isErrorMap(level) && name === kDistance ? 'Distance to input' : titleOf(name)]), ...kAlways.slice(2)];
    }

    /** What the colours say of a point of the stage: `Classification: Ground`; null where they stand for no values, or for coordinates. */
    valueAt({ level, geometry, index }) {
        if (geometry !== level.geometry || level.tiles) {
            return null;
        }
        const { colors, coloring: { by, range } } = level;
        const value = range && !kAxes.includes(by) ? colors?.get(by)?.valueOf?.(index) : undefined;
        if (value === undefined) {
            return null;
        }
        const { of, unit } = scaleOf(level, by);
        const text = !Number.isFinite(value) ? 'no value' : range.categories ? range.categories.nameOf(value)
            : unit ? `${format.quantity(of(value))} ${unit}` : format.value(value, colors.get(by).own.step);
        return `${new Map(this.choices(level)).get(by)}: ${text}`;
    }

    /** @param levels  that are on the stage, one or left and right, each with its `coloring` */
    show(levels) {
        const choices = new Map(levels.flatMap((level) => this.choices(level)));
        const by = choices.has(this.by) ? this.by : this.colorOf(levels[0]);
        byId.color.replaceChildren(...[...choices].map(([value, textContent]) => element('option', { value, textContent })));
        byId.color.value = by;
        const withValues = levels.filter(({ coloring }) => coloring.range);
        const told = withValues.find(({ coloring }) => coloring.by === by) ?? withValues[0];
        byId.legend.hidden = !told;
        if (told) {
            const { by: values, range } = told.coloring;
            const isOfBoth = levels.every(({ coloring }) => coloring.by === values);
            const { of, unit } = scaleOf(told, values);
            const [low, high] = [of(range.low), of(range.high)];
            const [lowText, highText] = format.ends(low, high, range.step);
            byId['legend-name'].textContent = [choices.get(values), unit, isOfBoth ? null : told === levels[0] ? 'left' : 'right'].filter(Boolean).join(', ');
            const categories = range.categories ?? (high > low ? null : constant(lowText));
            byId['legend-scale'].hidden = categories !== null;
            byId['legend-categories'].hidden = categories === null && !range.missing;
            byId['legend-categories'].replaceChildren(...(categories?.values ?? []).map((value) => swatch(categories.colorOf(value), categories.nameOf(value))),
                ...(range.missing ? [swatch(kGrey, 'No value')] : []));
            byId['legend-low'].textContent = lowText;
            byId['legend-low'].classList.toggle('beyond', range.below);
            byId['legend-high'].textContent = highText;
            byId['legend-scale'].classList.toggle('rounded', format.isRounded(range.step));
            byId['legend-high'].classList.toggle('beyond', range.above);
        }
    }
}

/** The levels of an evaluation, which have a range of distances. */
const isErrorMap = ({ error }) => error?.range !== undefined;

/** What a value `of` the colour map is called: distances as all errors are, coordinates as they are in the file. */
function scaleOf({ error, coloring: { range: { start } } }, values) {
    const isDistance = values === kDistance && isErrorMap({ error });
    if (isDistance && error.diagonal > 0) {
        return { of: (x) => 100 * x / error.diagonal, unit: '% of the diagonal' };
    }
    return { of: (x) => x + start, unit: isDistance || kAxes.includes(values) ? 'in units of the cloud' : null };
}

/** As a category, where all values are one. */
const constant = (text) => ({ values: [text], nameOf: () => text, colorOf: () => kLowest });

function swatch(color, text) {
    const dot = element('span', { className: 'swatch' });
    dot.style.background = color;
    return element('li', {}, dot, text);
}

/** An attribute's name as a person would write it. */
const titleOf = (name) => (name[0].toUpperCase() + name.slice(1)).replaceAll('_', ' ');
