import { byId, element } from './element.js';
import * as format from './format.js';
import { kGradient } from './coloring.js';

const kDistance = 'distance';  // the attribute of an error map
const kAlways = [['clay', 'Clay'], ['normal', 'Normals'], ['x', 'Position, x'], ['y', 'Position, y'], ['z', 'Position, z']];
const kLengths = [kDistance, 'x', 'y', 'z'];  // in the unit of the cloud, whichever that is

/** The card that says how the cloud is drawn, and the legend of the values that its colours stand for. */
export class LookCard {
    constructor({ onColor, onLook }) {
        this.by = null;  // what was chosen, or null: the cloud's own colours where it has some
        byId['legend-bar'].style.background = kGradient;
        byId.color.onchange = () => {
            this.by = byId.color.value;
            onColor();
        };
        const tell = () => onLook({ splatSize: 2 ** Number(byId['splat-size'].value), shading: Number(byId.shading.value) });
        byId['splat-size'].oninput = tell;
        byId.shading.oninput = tell;
        byId.look.onclick = () => this.toggle();
        byId['look-reset'].onclick = () => {
            byId['splat-size'].value = 0;
            byId.shading.value = 1;
            tell();
        };
    }

    toggle() {
        byId['look-card'].hidden = !byId['look-card'].hidden;
        byId.look.ariaExpanded = String(!byId['look-card'].hidden);
    }

    /** As before a choice was made: an error map shows distances. */
    forgetColor() {
        this.by = null;
    }

    open() {
        if (byId['look-card'].hidden) {
            this.toggle();
        }
    }

    /** What the colours of a level stand for now. */
    colorOf(level) {
        const choices = this.choices(level).map(([value]) => value);
        return [this.by, kDistance].find((by) => choices.includes(by)) ?? choices[0];
    }

    choices(level) {
        const own = level.isColored ? [['own', 'Its own']] : [];
        const attributes = level.tiles && !level.tiles.withAttributes ? [] : level.attributes;
        return [...own, ...kAlways.slice(0, 2), ...attributes.map(({ name }) => [name, titleOf(name)]), ...kAlways.slice(2)];
    }

    /** @param range  of the values, or null */
    show(level, range) {
        const choices = this.choices(level);
        const by = this.colorOf(level);
        byId.color.replaceChildren(...choices.map(([value, textContent]) => element('option', { value, textContent })));
        byId.color.value = by;
        byId.legend.hidden = !range;
        if (range) {
            byId['legend-name'].textContent = choices.find(([value]) => value === by)[1] + (kLengths.includes(by) ? ', in units of the cloud' : '');
            byId['legend-low'].textContent = format.quantity(range.low);
            byId['legend-high'].textContent = format.quantity(range.high);
        }
    }
}

/** An attribute's name as a person would write it. */
const titleOf = (name) => (name === kDistance ? 'Distance to input' : name.replaceAll('_', ' '));
