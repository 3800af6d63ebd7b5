import { byId, element } from './element.js';
import * as format from './format.js';
import { kGradient } from './coloring.js';

const kDistance = 'distance';  // the attribute of an error map
const kAlways = [['clay', 'Clay'], ['normal', 'Normals'], ['x', 'Position, x'], ['y', 'Position, y'], ['z', 'Position, z']];

/** The card that says how the cloud is drawn: what its colours stand for, how large splats are, how dark its hollows. */
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
        return [...own, ...kAlways.slice(0, 2), ...attributes.map(({ name }) => [name, name]), ...kAlways.slice(2)];
    }

    /** @param range  of the values, or null */
    show(level, range) {
        byId.color.replaceChildren(...this.choices(level).map(([value, textContent]) => element('option', { value, textContent })));
        byId.color.value = this.colorOf(level);
        byId.legend.hidden = !range;
        if (range) {
            byId['legend-low'].textContent = format.quantity(range.low);
            byId['legend-high'].textContent = format.quantity(range.high);
        }
    }
}
