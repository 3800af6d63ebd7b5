// What the colours of a picture stand for. Colours are computed for a level, or a tile, when they are first asked for, and kept with it.
import { interpolateViridis } from 'd3-scale-chromatic';
import { BufferAttribute } from 'three';

import { categoriesOf } from './categories.js';

const kOutliers = 0.01;  // share at either end of the values that the range leaves out
const kSampled = 20_000;
const kMostExact = 2 ** 24;  // from which on single precision has not all whole numbers
export const kAxes = ['x', 'y', 'z'];
const kBuiltIn = ['own', 'clay', 'normal', ...kAxes];
const kNoCategories = { values: [] };
const kNoValues = { values: [], components: 1 };
const kGreyBytes = [128, 128, 128];
const bytesOf = (hex) => hex.match(/[\da-f]{2}/g).map((digits) => parseInt(digits, 16));
const kViridis = Array.from({ length: 256 }, (_, i) => bytesOf(interpolateViridis(i / 255)));

/** What an attribute's colours go by: its name, unless that names others. */
export const keyOf = (name) => (kBuiltIn.includes(name) ? `attribute:${name}` : name);

/** For a legend: where there is no value, and the lower end of the colour map. */
export const kGrey = `rgb(${kGreyBytes})`;
export const kLowest = interpolateViridis(0);

/** `linear-gradient` of the colour map, for a legend. */
export const kGradient = `linear-gradient(90deg, ${Array.from({ length: 12 }, (_, i) => interpolateViridis(i / 11)).join(', ')})`;

/**
 * Gives a level the colours that `by` names: `own` (of the cloud), `clay` (none), `normal`, `x`, `y`, `z`, or an attribute.
 * @param way  what is added to coordinates, a Vector3; @param range  of the values, where it is not to be the level's own
 * @returns {Promise<?Object>} where there are values: `low` and `high` at the ends of the colour map; whether some are `below` or `above`, and some `missing`;
 * `start`, to be added to what is told of them; `step`, of those that lie closer together some are lost; `categories`, where they are few whole numbers, else null
 */
export async function colorize(level, by, { way, range = null, signal }) {
    const { geometry } = level;
    level.colors ??= startingWith(geometry);
    if (!level.colors.has(by)) {
        const attribute = level.attributes.find(({ name }) => keyOf(name) === by);
        const values = await attribute?.read(signal);
        const valueOf = valuesOf(geometry, by, way, attribute && { ...attribute, values });
        const step = attribute?.stepOf?.(values) ?? 0;
        level.colors.set(by, { valueOf, own: valueOf && { ...rangeOf(geometry.getAttribute('position').count, valueOf, attribute, step), start: startOf(level, by, way), step } });
    }
    const colors = level.colors.get(by);
    const wanted = colors.own && (range ?? colors.own);
    if (!('array' in colors) || colors.range !== wanted) {
        colors.array = computed(geometry, colors.valueOf, wanted);
        colors.range = wanted;
    }
    setColors(geometry, colors.array);
    return wanted;
}

/**
 * The same for a tile, on the colour map of a whole level, so that all tiles have one.
 * @param origin  what the tile's coordinates are relative to, in those of the colour map
 */
export function colorizeTile({ cloud, attributes }, by, range, origin) {
    cloud.userData.colors ??= startingWith(cloud);
    const { colors } = cloud.userData;
    if (!colors.has(by) || colors.get(by).range !== range) {
        colors.set(by, { array: computed(cloud, valuesOf(cloud, by, origin, attributes[by.replace(/^attribute:/, '')]), range), range });
    }
    setColors(cloud, colors.get(by).array);
}

/** Coordinates are relative to an origin, and drawn so; they are told as they are in the file. */
function startOf({ origin = [0, 0, 0] }, by, way) {
    const axis = kAxes.indexOf(by);
    return axis < 0 ? 0 : origin[axis] - way.getComponent(axis);
}

const startingWith = (geometry) => new Map([
    ['own', { array: geometry.getAttribute('color')?.array ?? null, own: null, range: null }],
    ['clay', { array: null, own: null, range: null }],
]);

function setColors(geometry, array) {
    if (!array) {
        geometry.deleteAttribute('color');
    } else if (geometry.getAttribute('color')?.array !== array) {
        geometry.setAttribute('color', new BufferAttribute(array, array.length / geometry.getAttribute('position').count, true));
    }
}

/** What is shown of point i, coordinates from `origin`; null for normals, which are colours by themselves. */
function valuesOf(geometry, by, origin, attribute) {
    if (by === 'normal') {
        return null;
    }
    const axis = kAxes.indexOf(by);
    if (axis >= 0) {
        const { array } = geometry.getAttribute('position');
        const start = origin.getComponent(axis);
        return (i) => array[3 * i + axis] + start;
    }
    const { values, components } = attribute ?? kNoValues;
    if (components === 1) {
        return (i) => values[i];
    }
    return (i) => {
        let sum = 0;
        for (let k = 0; k < components; k += 1) {
            sum += values[components * i + k] ** 2;
        }
        return Math.sqrt(sum);
    };
}

const computed = (geometry, valueOf, range) => (valueOf
    ? mapped(geometry.getAttribute('position').count, valueOf, range) : colorsOfNormals(geometry.getAttribute('surface').array));

function colorsOfNormals(surface) {
    const count = surface.length / 4;
    const array = new Uint8Array(4 * count);
    for (let i = 0; i < count; i += 1) {
        const length = Math.hypot(surface[4 * i], surface[4 * i + 1], surface[4 * i + 2]) || 1;
        for (let k = 0; k < 3; k += 1) {
            array[4 * i + k] = 127.5 + 127.5 * surface[4 * i + k] / length;
        }
        array[4 * i + 3] = 255;
    }
    return array;
}

/** What all but a few outliers lie between; of an attribute with few whole numbers, which these are. */
function rangeOf(count, valueOf, attribute, step) {
    const stride = Math.ceil(count / kSampled);
    const sample = [];
    let isMissing = false;
    for (let i = 0; i < count; i += stride) {
        if (Number.isFinite(valueOf(i))) {
            sample.push(valueOf(i));
        } else {
            isMissing = true;
        }
    }
    sample.sort((a, b) => a - b);
    const at = (share) => sample[Math.round(share * (sample.length - 1))] ?? 0;
    const most = [at(kOutliers), at(1 - kOutliers)];
    const ends = most[0] < most[1] ? most : [at(0), at(1)];  // where most have one value, the few others are what there is to see
    const [low, high] = ends[1] - ends[0] > step ? ends : [ends[0], ends[0]];  // what may differ by rounding alone is one value
    const all = function* all() {
        for (let i = 0; i < count; i += 1) {
            if (Number.isFinite(valueOf(i))) {
                yield valueOf(i);
            }
        }
    };
    // Large doubles measure something, as times, of which single precision leaves few.
    const areLarge = attribute?.type === 'float64' && Math.max(-at(0), at(1)) >= kMostExact;
    const areNames = attribute !== undefined && !areLarge;
    const categories = sample.length === 0 ? kNoCategories : areNames ? categoriesOf(attribute.name, all()) : null;
    return { low, high, below: low > at(0), above: high < at(1), missing: isMissing, categories };
}

/** Values by the colour map, or by that of their category; grey where there is none. */
function mapped(count, valueOf, { low, high, categories }) {
    const scale = high > low ? 255 / (high - low) : 0;
    const known = new Map();
    const ofCategory = (value) => {
        if (!known.has(value)) {
            known.set(value, bytesOf(categories.colorOf(value)));
        }
        return known.get(value);
    };
    const colorOf = categories ? (value) => (Number.isFinite(value) ? ofCategory(value) : kGreyBytes)
        : (value) => (Number.isFinite(value) ? kViridis[Math.min(255, Math.max(0, Math.round((value - low) * scale)))] : kGreyBytes);
    const array = new Uint8Array(4 * count);
    for (let i = 0; i < count; i += 1) {
        array.set(colorOf(valueOf(i)), 4 * i);
        array[4 * i + 3] = 255;
    }
    return array;
}
