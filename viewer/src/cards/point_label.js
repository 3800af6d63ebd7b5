import { byId, element } from '../page/element.js';
import * as format from '../page/format.js';

/** The point that is looked at closely, until the cloud is moved by hand. */
export class PointLabel {
    constructor() {
        byId.stage.addEventListener('pointerdown', () => this.hide());
    }

    /** @param place  in the coordinates of its file; @param radius  of the cloud; @param value  what its colour stands for, or null */
    show({ place }, radius, value) {
        byId.point.replaceChildren(element('span', { className: 'place', textContent: format.place(place, radius) }), ...(value ? [value] : []));
        byId.point.hidden = false;
    }

    hide() {
        byId.point.hidden = true;
    }
}
