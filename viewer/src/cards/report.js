import { getBytes } from '../api/api.js';
import { byId, element, setOpen } from '../page/element.js';
import * as format from '../page/format.js';
import { CurveChart } from './curve_chart.js';

const kDirections = [['forward', 'From the reference'], ['backward', 'To the reference']];
const kFigures = [['mean', 'Mean'], ['max', 'Largest'], ['rms', 'RMS'], ['p95', '95 %'], ['p99', '99 %']];  // on a phone the first are seen

/** What a result has to tell beside its picture, or without one: the figures of an evaluation, a curve, files for other programs. */
export class Report {
    /**
     * @param onDownload  told a file that is to be saved; @param onSimplify  told how many points, by a curve
     * @param onPyramid  asked for one that can be looked at; @param onPlace  told a place to look at, and of which candidate
     */
    constructor({ onDownload, onSimplify, onPyramid, onPlace }) {
        Object.assign(this, { onDownload, onSimplify, onPyramid, onPlace });
        byId['report-close'].onclick = () => this.hide();
    }

    get isOpen() {
        return !byId.report.hidden;
    }

    hide() {
        setOpen(byId.report, false, openerOf());
        this.chart?.end();
        this.chart = null;
        this.shownAs = null;
    }

    /**
     * Made anew only where something has come: a table that is replaced loses its reader.
     * @param job  of the result; @param name  of its cloud; @param nameOf  of a cloud by its id, or undefined
     * @param canClose  whether there is something else to see; @param takesFocus  whether it was asked for
     */
    show({ job, name, manifest, nameOf, canClose, takesFocus }) {
        const shownAs = JSON.stringify([job.id, name, manifest.levels.length, manifest.complete]);
        if (shownAs === this.shownAs) {
            return;
        }
        this.hide();
        this.shownAs = shownAs;
        const [title, content] = job.type === 'evaluate' ? evaluation(manifest, name, nameOf, canClose ? this.onPlace : null)
            : job.type === 'curve' ? this.curve(manifest, name) : this.files(manifest);
        byId['report-title'].textContent = title;
        byId['report-content'].replaceChildren(...content);
        byId['report-close'].hidden = !canClose;
        setOpen(byId.report, true, openerOf(), { takesFocus });
        this.chart?.draw();
    }

    curve({ levels, request }, name) {
        const points = levels.map(({ points: count, curve: { forward, backward, diagonal } }) => {
            const relative = (distance) => (diagonal > 0 ? distance / diagonal : 0);
            return { count, mean: relative(forward.mean), largest: relative(Math.max(forward.max, backward.max)) };
        });
        const told = element('output');
        const simplify = element('button', { className: 'action' });
        this.chart = new CurveChart(points, ({ count, mean, largest }) => {
            told.textContent = `${format.points(count)}: mean ${format.percent(mean)}, largest ${format.percent(largest)}`;
            simplify.textContent = `Simplify to ${format.compactPoints(count)}`;
            simplify.onclick = () => this.onSimplify(count);
        });
        return [`Error of ${name} by points, ${request.method}`, [
            element('div', { className: 'told' }, told, simplify),
            this.chart.element,
            note('Distance between the surfaces, percent of the diagonal.'),
            element('details', {}, element('summary', { textContent: 'As a table' }),
                table(['Points', 'Mean', 'Largest'], [[null, points.map(({ count, mean, largest }) =>
                    [format.count(count), ...[mean, largest].map(asPercent)])]])),
        ]];
    }

    files({ levels, request }) {
        const names = request.formats.map((kind) => format.kKinds[kind] ?? kind).join(' and ');
        const saves = ({ files }) => element('span', { className: 'saves' }, ...files.map((file) => element('button', {
            className: 'action', textContent: `Save ${format.kKinds[file.format] ?? file.format}, ${format.bytes(file.bytes)}`, onclick: () => this.onDownload(file),
        })));
        const rows = levels.map((level) => [format.count(level.points), level.error ? asPercent(level.error.relative.mean) : '–', level.files.length > 0 ? saves(level) : '']);
        return [`Made as ${names}, for other programs`, [
            note('This page draws levels in Draco, PLY, tiles (glb) and streams (stpc). You can save the files of this pyramid, or build another one to view.'),
            table(['Points', 'Mean error, %', 'File'], [[null, rows]]),
            element('button', { className: 'action', textContent: 'Build one to view', onclick: this.onPyramid }),
        ]];
    }
}

/** @param onPlace  of a result with pictures */
function evaluation({ levels, request }, name, nameOf, onPlace) {
    const titleOf = (points, i) => {
        const called = request.labels[i] ?? nameOf(request.candidates[i]);
        return called?.includes(points) ? called : [called, points].filter(Boolean).join(', ');
    };
    const groupsOf = (rowsOf) => levels.map(({ points, error }, i) =>
        [titleOf(format.points(points), i),
            kDirections.flatMap(([direction, title]) => rowsOf(error[direction], title))]);
    const figures = groupsOf((direction, title) => [[`${title}, %`, ...kFigures.map(([figure]) => asPercent(direction.relative[figure]))],
        ['in units of the cloud', ...kFigures.map(([figure]) => format.quantity(direction[figure]))]]);
    const haveLabels = levels.some(({ error }) => kDirections.some(([direction]) => error[direction].attributes?.some(({ differing }) => differing !== undefined)));
    const attributes = groupsOf(({ attributes = [] }, title) => attributes.map(({ name: attribute, mean, rms, max, differing }) =>
        [`${attribute}, ${title.toLowerCase()}`, ...[mean, rms, max].map(format.quantity),
            ...(haveLabels ? [differing === undefined ? '' : asPercent(differing)] : [])]));
    const warnings = new Set(levels.flatMap(({ error }) => error.warnings ?? []));
    return [`Distances from ${name}`, [
        table(['Distances', ...kFigures.map(([, title]) => title)], figures),
        ...levels.map(({ points, error }, i) =>
            largestAt(error, levels.length > 1 && titleOf(format.points(points), i), onPlace && ((place) => onPlace(i, place)))).filter(Boolean),
        note(`Percent of the diagonal, which is ${format.quantity(levels[0].error.diagonal)}.`),
        ...(attributes.some(([, rows]) => rows.length > 0) ? [table(['Attributes', 'Mean', 'RMS', 'Largest', ...(haveLabels ? ['Differing, %'] : [])], attributes), note('Colours as CIEDE2000, normals in radians.')] : []),
        ...[...warnings].map((warning) => note(`Beware: ${warning}${/[.?!]$/.test(warning) ? '' : '.'}`)),
        ...levels.flatMap(({ pictures = [] }) => pictures.map(pictureOf)),
    ]];
}

/** The button that opens the report, where there is one. */
const openerOf = () => document.querySelector('[aria-controls=report]');

/** Where a candidate is farthest off, as a sentence. @param title  of one of several; @param onPlace  where it can be looked at */
function largestAt({ forward, backward, diagonal }, title, onPlace) {
    const [side, { max, max_at: at }] = forward.max >= backward.max ? ['reference', forward] : ['candidate', backward];
    if (!at || max === 0) {
        return null;  // of clouds far apart, or by an older server
    }
    const place = element(onPlace ? 'button' : 'span', { className: 'place', textContent: format.place(at, diagonal / 2) });
    if (onPlace) {
        Object.assign(place, { title: 'Look at it', onclick: () => onPlace(at) });
    }
    return element('p', { className: 'note' }, `${title ? `${title}: largest` : 'Largest'} at `, place, `, on the ${side}.`);
}

/** By the page, since an address in the page shows the server no key. */
function pictureOf({ href, width, height }) {
    const image = element('img', { width, height, alt: 'The candidates from all views, coloured by distance' });
    getBytes(href).then((bytes) => {
        const reader = new FileReader();
        reader.onload = () => { image.src = reader.result; };
        reader.readAsDataURL(new Blob([bytes], { type: 'image/png' }));
    }).catch(() => image.remove());  // the figures are there; the file can still be saved
    return image;
}

/** @param groups  `[title or null, rows]`; the first cell of a row is its header */
function table(columns, groups) {
    const cell = (content, scope) => element(scope ? 'th' : 'td', scope ? { scope } : {}, content);
    const row = ([first, ...cells]) => element('tr', {}, cell(first, 'row'), ...cells.map((content) => cell(content)));
    const groupOf = (title) => element('tr', { className: 'group-title' }, Object.assign(cell(title, 'rowgroup'), { colSpan: columns.length }));
    return element('div', { className: 'table' }, element('table', {},
        element('thead', {}, element('tr', {}, ...columns.map((title) => cell(title, 'col')))),
        ...groups.map(([title, rows]) => element('tbody', {}, ...(title === null ? [] : [groupOf(title)]), ...rows.map(row)))));
}

const note = (textContent) => element('p', { className: 'note', textContent });
const asPercent = (share) => format.quantity(100 * share);
