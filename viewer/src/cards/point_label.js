import { byId, element } from '../page/element.js';
import * as format from '../page/format.js';

/** The point that is looked at closely, until the cloud is moved by hand. */
export class PointLabel {
    constructor() {
        byId.stage.addEventListener('pointerdown', () => this.hide());
    }

    /** @param place  in the coordinates of its file; @param radius  of the cloud; @param value  tells what its colour stands for now, or null */
    show({ place }, radius, value) {
        this.place = element('span', { className: 'place', textContent: format.place(place, radius) });
        this.value = value;
        byId.point.hidden = false;
        this.renew();
    }

    /** Colours stand for something else. */
    renew() {
        if (!byId.point.hidden) {
            byId.point.replaceChildren(...[this.place, this.value()].filter(Boolean));
        }
    }

    hide() {
        byId.point.hidden = true;
    }
}
