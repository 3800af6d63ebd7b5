// How errors fall as points grow, both on logarithmic axes: a picture to read values from by pointer, touch and arrow keys.
import { element } from '../page/element.js';
import * as format from '../page/format.js';

const kHeight = 250;
const kEdges = { left: 62, right: 14, top: 22, bottom: 30 };
/** Errors fall: above the start of the upper curve and below the end of the lower one there is nothing. */
const kSeries = [
    ['largest', 'Largest', ([[x, y]]) => ({ x: x + 10, y: y - 6 })],
    ['mean', 'Mean', (places) => ({ x: places.at(-1)[0] - 10, y: places.at(-1)[1] + 14, 'text-anchor': 'end' })],
];
const kRoom = 0.06;  // above and below the curves, of their height

export class CurveChart {
    /** @param points  `{count, mean, largest}`, counts ascending, errors relative; @param onRead  told the one that is pointed at */
    constructor(points, onRead) {
        Object.assign(this, { points, onRead });
        this.svg = svg('svg', { 'aria-hidden': 'true' });
        this.element = element('div', { className: 'chart', role: 'slider', tabIndex: 0, ariaLabel: 'Points on the curve of the error' }, this.svg);
        this.element.ariaValueMin = String(points[0].count);
        this.element.ariaValueMax = String(points.at(-1).count);
        const point = ({ clientX }) => this.read(this.nearestTo(clientX - this.svg.getBoundingClientRect().left));
        this.element.onpointermove = point;
        this.element.onpointerdown = point;
        this.element.onkeydown = (event) => {
            const to = { ArrowLeft: this.at - 1, ArrowDown: this.at - 1, ArrowRight: this.at + 1, ArrowUp: this.at + 1, Home: 0, End: points.length - 1 }[event.key];
            if (to !== undefined) {
                event.preventDefault();
                this.read(Math.min(points.length - 1, Math.max(0, to)));
            }
        };
        this.read(points.length >> 1);
        this.observer = new ResizeObserver(() => this.draw());
        this.observer.observe(this.element);
    }

    end() {
        this.observer.disconnect();
    }

    read(index) {
        this.at = index;
        const { count, mean, largest } = this.points[index];
        this.element.ariaValueNow = String(count);
        this.element.ariaValueText = `${format.points(count)}, mean error ${format.percent(mean)}, largest ${format.percent(largest)}`;
        this.onRead(this.points[index]);
        this.mark?.();
    }

    nearestTo(x) {
        const distances = this.points.map(({ count }) => Math.abs(this.x(count) - x));
        return distances.indexOf(Math.min(...distances));
    }

    draw() {
        const width = this.element.clientWidth;
        if (width === 0) {
            return;
        }
        const counts = this.points.map(({ count }) => count);
        const errors = this.points.flatMap(({ mean, largest }) => [mean, largest]).filter((error) => error > 0);
        const { left, right, top, bottom } = kEdges;
        this.x = scaleOf(counts, left, width - right, 0);
        this.y = scaleOf(errors.length > 0 ? errors : [1], kHeight - bottom, top, kRoom);
        const tick = (at, text) => svg('text', at, text);
        const parts = [
            ...this.y.ticks.flatMap((error) => [
                svg('line', { class: 'grid', x1: left, x2: width - right, y1: this.y(error), y2: this.y(error) }),
                tick({ x: left - 8, y: this.y(error) + 4, 'text-anchor': 'end' }, format.percent(error)),
            ]),
            ...this.x.ticks.flatMap((count) => [
                svg('line', { class: 'grid', x1: this.x(count), x2: this.x(count), y1: top, y2: kHeight - bottom }),
                tick({ x: this.x(count), y: kHeight - 10, 'text-anchor': 'middle' }, format.compactCount(count)),
            ]),
            ...kSeries.flatMap((series) => this.curveOf(...series)),
        ];
        const line = svg('line', { class: 'guide', y1: top, y2: kHeight - bottom });
        const dots = kSeries.map(([name]) => svg('circle', { class: `dot ${name}`, r: 5 }));
        this.svg.setAttribute('viewBox', `0 0 ${width} ${kHeight}`);
        this.svg.replaceChildren(...parts, line, ...dots);
        this.mark = () => {
            const point = this.points[this.at];
            set(line, { x1: this.x(point.count), x2: this.x(point.count) });
            kSeries.forEach(([name], i) => set(dots[i], { cx: this.x(point.count), cy: this.y(point[name]) || 0, visibility: point[name] > 0 ? 'visible' : 'hidden' }));
        };
        this.mark();
    }

    /** Of what is 0 a logarithm shows nothing. */
    curveOf(name, title, nameAt) {
        const shown = this.points.filter((point) => point[name] > 0).map((point) => [this.x(point.count), this.y(point[name])]);
        if (shown.length === 0) {
            return [];
        }
        return [
            svg('path', { class: `curve ${name}`, d: shown.map(([x, y], i) => `${i === 0 ? 'M' : 'L'}${x.toFixed(1)} ${y.toFixed(1)}`).join('') }),
            ...shown.map(([cx, cy]) => svg('circle', { class: `place ${name}`, cx, cy, r: 2 })),
            svg('text', { class: `name ${name}`, ...nameAt(shown) }, title),
        ];
    }
}

/** From values to places on a logarithmic axis; `ticks` of it. @param room  beyond the values, as a share */
function scaleOf(values, from, to, room) {
    let [low, high] = [Math.log10(Math.min(...values)), Math.log10(Math.max(...values))];
    const beyond = high > low ? room * (high - low) : 0.5;
    [low, high] = [low - beyond, high + beyond];
    const place = (value) => from + (to - from) * (Math.log10(value) - low) / (high - low);
    const steps = high - low < 1.2 ? [1, 2, 5] : high - low < 3.2 ? [1, 3] : [1];
    const decades = Array.from({ length: Math.ceil(high) - Math.floor(low) + 1 }, (_, i) => Math.floor(low) + i);
    return Object.assign(place, {
        ticks: decades.flatMap((decade) => steps.map((step) => Number(`${step}e${decade}`)))
            .filter((value) => Math.log10(value) >= low && Math.log10(value) <= high),
    });
}

function svg(name, attributes, ...children) {
    const made = document.createElementNS('http://www.w3.org/2000/svg', name);
    set(made, attributes);
    made.append(...children);
    return made;
}

const set = (made, attributes) => Object.entries(attributes).forEach(([name, value]) => made.setAttribute(name, value));
