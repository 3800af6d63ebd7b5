// What the colours of a picture stand for. Colours are computed for a level when they are first asked for, and kept with it.
import { interpolateViridis } from 'd3-scale-chromatic';
import { BufferAttribute } from 'three';

import { getBytes } from './api.js';
import { decodeAttribute } from './draco_levels.js';

const kFull = 32767;
const kOutliers = 0.01;  // share at either end of the values that the range leaves out
const kSampled = 20_000;
const kViridis = Array.from({ length: 256 }, (_, i) => interpolateViridis(i / 255).match(/[\da-f]{2}/g).map((hex) => parseInt(hex, 16)));

/** `linear-gradient` of the colour map, for a legend. */
export const kGradient = `linear-gradient(90deg, ${Array.from({ length: 12 }, (_, i) => interpolateViridis(i / 11)).join(', ')})`;

/**
 * Gives a level the colours that `by` names: `own` (of the cloud), `clay` (none), `normal`, `x`, `y`, `z`, or an attribute.
 * @returns {Promise<?{low: number, high: number}>} the values at the ends of the colour map, where there are values
 */
export async function colorize(level, by, signal) {
    const { geometry } = level;
    level.colors ??= new Map([['own', { array: geometry.getAttribute('color')?.array ?? null, range: null }], ['clay', { array: null, range: null }]]);
    if (!level.colors.has(by)) {
        level.colors.set(by, await computed(level, by, signal));
    }
    const { array, range } = level.colors.get(by);
    if (array) {
        geometry.setAttribute('color', new BufferAttribute(array, array.length / geometry.getAttribute('position').count, true));
    } else {
        geometry.deleteAttribute('color');
    }
    return range;
}

async function computed(level, by, signal) {
    const position = level.geometry.getAttribute('position').array;
    const axis = ['x', 'y', 'z'].indexOf(by);
    if (by === 'normal') {
        return { array: colorsOfNormals(level.geometry.getAttribute('surface').array), range: null };
    }
    if (axis >= 0) {
        return mapped(position.length / 3, (i) => position[3 * i + axis]);
    }
    const { id, components } = level.attributes.find(({ name }) => name === by);
    const values = await decodeAttribute(await getBytes(level.file.href, signal), id);
    return mapped(values.length / components, components === 1 ? (i) => values[i] : (i) => {
        let sum = 0;
        for (let k = 0; k < components; k += 1) {
            sum += values[components * i + k] ** 2;
        }
        return Math.sqrt(sum);
    });
}

function colorsOfNormals(surface) {
    const count = surface.length / 4;
    const array = new Uint8Array(4 * count);
    for (let i = 0; i < count; i += 1) {
        for (let k = 0; k < 3; k += 1) {
            array[4 * i + k] = 127.5 + 127.5 * surface[4 * i + k] / kFull;
        }
        array[4 * i + 3] = 255;
    }
    return array;
}

/** Values by the colour map, between what all but a few outliers lie between. */
function mapped(count, valueOf) {
    const step = Math.ceil(count / kSampled);
    const sample = [];
    for (let i = 0; i < count; i += step) {
        if (Number.isFinite(valueOf(i))) {
            sample.push(valueOf(i));
        }
    }
    sample.sort((a, b) => a - b);
    const at = (share) => sample[Math.round(share * (sample.length - 1))] ?? 0;
    const range = { low: at(kOutliers), high: at(1 - kOutliers) };
    const scale = range.high > range.low ? 255 / (range.high - range.low) : 0;
    const array = new Uint8Array(4 * count);
    for (let i = 0; i < count; i += 1) {
        const color = kViridis[Math.min(255, Math.max(0, Math.round((valueOf(i) - range.low) * scale)))] ?? [128, 128, 128];
        array.set(color, 4 * i);
        array[4 * i + 3] = 255;
    }
    return { array, range };
}
