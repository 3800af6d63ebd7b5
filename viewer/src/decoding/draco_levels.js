import { DRACOLoader } from 'three/addons/loaders/DRACOLoader.js';

import { unreachable } from '../api/api.js';

/* global ASSETS: the URL of each file, put in by build.mjs */
const newLoader = () => new DRACOLoader()
    .setDecoderPath({ js: ASSETS['draco_wasm_wrapper.js'], wasm: ASSETS['draco_decoder.wasm'] })
    .setWorkerLimit(1);  // levels are decoded one after another
let loader = newLoader();

/** One point. */
const kSmallestFile = 'RFJBQ08CAwAAAAABAAAAAQEACQMAAAAAAAAAAAAAAAAAAAA=';

/** Starts the decoder before the first level needs it: it does so with the first file. */
export function preloadDecoder() {
    decodeLevel(Uint8Array.from(atob(kSmallestFile), (character) => character.charCodeAt(0)).buffer)
        .catch(() => {});  // what there is to tell is told of the first level
}

/**
 * Decodes a level in a worker; takes `bytes` over, unless the server could not be reached for the decoder.
 * @returns {Promise<THREE.BufferGeometry>} position, and normal and color where the file has them. Colours stay bytes, in sRGB.
 */
export async function decodeLevel(bytes) {
    const types = { position: 'Float32Array', normal: 'Float32Array', color: 'Uint8Array', uv: 'Float32Array' };
    const geometry = await decode(bytes, null, types);
    geometry.deleteAttribute('uv');
    geometry.setIndex(null);
    return geometry;
}

/** Of types wider than a float, the one that tells whole numbers apart. */
const kWholes = { int32: 'Int32Array', uint32: 'Uint32Array', float64: 'Int32Array' };

/** The values of the attribute with a unique id, point by point; takes `bytes` over. The decoder has no doubles: large ones are whole numbers. */
export async function decodeAttribute(bytes, id, type) {
    const wholes = kWholes[type] ?? 'Float32Array';
    const geometry = await decode(bytes, { position: 0, value: id, whole: id }, { position: 'Float32Array', value: 'Float32Array', whole: wholes });
    const [{ array: values }, { array: whole }] = ['value', 'whole'].map((name) => geometry.getAttribute(name));
    return type === 'float64' ? wholeWhereLarge(values, whole) : whole;
}

const kExact = 2 ** 24;  // up to it floats have every whole number
const kMostWhole = 2 ** 31 - 2 ** 7;  // the largest float that is an int

/** GPS times of one flight, 1.3e9 s and some, are one and the same float. */
function wholeWhereLarge(values, whole) {
    const isLarge = !values.some((value) => Math.abs(value) > kMostWhole) && values.some((value) => Math.abs(value) > kExact);
    return isLarge ? Float64Array.from(values, (value, i) => (Math.abs(value) > kExact ? whole[i] : value)) : values;
}

/** The step between the doubles that come through, of values that `decodeAttribute` gives: large ones are cut off after the point, others are floats. */
export function stepOf(values, type) {
    if (type !== 'float64') {
        return 0;
    }
    const largest = values.reduce((most, value) => (Number.isFinite(value) ? Math.max(most, Math.abs(value)) : most), 0);
    return values instanceof Float64Array ? 1 : 2 * largest / kExact;
}

async function decode(bytes, ids, types) {
    const started = await startedLoader();
    return new Promise((resolve, reject) => {
        const fail = (reason) => reject(new Error(reason.message ?? reason.error ?? 'the Draco decoder did not start'));
        started.decodeDracoFile(bytes, resolve, ids, types, undefined, fail);
    });
}

/** Once the decoder is there. A loader that failed to bring it never tries again: another takes its place for the next time. */
async function startedLoader() {
    const asked = loader;
    try {
        await asked.preload().decoderPending;
        return asked;
    } catch {
        if (loader === asked) {
            loader = newLoader();
            asked.dispose();
        }
        throw unreachable();
    }
}
