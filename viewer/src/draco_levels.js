import { DRACOLoader } from 'three/addons/loaders/DRACOLoader.js';

/* global ASSETS: the URL of each file, put in by build.mjs */
const loader = new DRACOLoader()
    .setDecoderPath({ js: ASSETS['draco_wasm_wrapper.js'], wasm: ASSETS['draco_decoder.wasm'] })
    .setWorkerLimit(1);  // levels are decoded one after another

/** One point. */
const kSmallestFile = 'RFJBQ08CAwAAAAABAAAAAQEACQMAAAAAAAAAAAAAAAAAAAA=';

/** Starts the decoder before the first level needs it: it does so with the first file. */
export function preloadDecoder() {
    decodeLevel(Uint8Array.from(atob(kSmallestFile), (character) => character.charCodeAt(0)).buffer)
        .catch(() => {});  // what there is to tell is told of the first level
}

/**
 * Decodes a level in a worker; takes `bytes` over.
 * @returns {Promise<THREE.BufferGeometry>} position, and normal and color where the file has them. Colours stay bytes, in sRGB.
 */
export async function decodeLevel(bytes) {
    const types = { position: 'Float32Array', normal: 'Float32Array', color: 'Uint8Array', uv: 'Float32Array' };
    const geometry = await decode(bytes, null, types);
    geometry.deleteAttribute('uv');
    geometry.setIndex(null);
    return geometry;
}

/** The values of the attribute with a unique id, point by point; takes `bytes` over. */
export async function decodeAttribute(bytes, id) {
    const geometry = await decode(bytes, { position: 0, value: id }, { position: 'Float32Array', value: 'Float32Array' });
    return geometry.getAttribute('value').array;
}

function decode(bytes, ids, types) {
    return new Promise((resolve, reject) => {
        const fail = (reason) => reject(new Error(reason.message ?? reason.error ?? 'the Draco decoder did not start'));
        loader.decodeDracoFile(bytes, resolve, ids, types, undefined, fail);
    });
}
