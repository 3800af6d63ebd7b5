import { MeshoptDecoder } from 'three/addons/libs/meshopt_decoder.module.js';

/** By `componentType`: what holds the values, and what a full one stands for. */
const kTypes = { 5120: [Int8Array, 127], 5121: [Uint8Array, 255], 5122: [Int16Array, 32767], 5123: [Uint16Array, 65535], 5126: [Float32Array, 1] };

/**
 * The points of a glb as our server writes it, compressed by EXT_meshopt_compression, on a grid.
 * @returns positions as floats, in the coordinates of the tileset; unit normals and sRGB colours (4 bytes each) or null; `attributes`:
 * by name, `{values, components}`, as they were in the file; NaN where they were not finite
 */
export async function readTile(glb) {
    await MeshoptDecoder.ready;
    const header = new DataView(glb);
    const jsonLength = header.getUint32(12, true);
    const gltf = JSON.parse(new TextDecoder().decode(new Uint8Array(glb, 20, jsonLength)));
    const binary = new Uint8Array(glb, 28 + jsonLength);
    const { attributes } = gltf.meshes[0].primitives[0];
    const accessorOf = (name) => gltf.accessors[attributes[name]];
    const read = (name) => (name in attributes ? decoded(gltf, accessorOf(name), binary) : null);
    const told = propertiesOf(gltf);
    const isOfTheCloud = (name) => name.startsWith('_') && !accessorOf(name).normalized; // normalized: the alpha of colours
    return {
        positions: placed(read('POSITION'), gltf.nodes.find(({ mesh }) => mesh !== undefined).matrix),
        normals: floats(read('NORMAL')),
        colors: inSrgb(read('COLOR_0')),
        attributes: Object.fromEntries(Object.keys(attributes).filter(isOfTheCloud)
            .map((name) => [name.slice(1), plain(read(name), accessorOf(name), told.get(name))])),
    };
}

/** The values of an accessor: `at(i, k)` is component k of value i. */
function decoded(gltf, { bufferView, componentType, count }, binary) {
    const { byteOffset = 0, byteLength, byteStride, mode, filter } = gltf.bufferViews[bufferView].extensions.EXT_meshopt_compression;
    const bytes = new Uint8Array(count * byteStride);
    MeshoptDecoder.decodeGltfBuffer(bytes, count, byteStride, binary.subarray(byteOffset, byteOffset + byteLength), mode, filter);
    const [Values, largest] = kTypes[componentType];
    const values = new Values(bytes.buffer);
    const stride = byteStride / values.BYTES_PER_ELEMENT;
    return { count, largest, at: (i, k) => values[stride * i + k] };
}

const kComponents = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };

/** By the names of attributes: what stands for values that are not finite, which glTF forbids, and what was taken off the others. */
function propertiesOf({ extensions }) {
    const { schema, propertyAttributes } = extensions?.EXT_structural_metadata ?? { propertyAttributes: [{ properties: {} }] };
    return new Map(Object.entries(propertyAttributes[0].properties).map(([id, { attribute }]) => [attribute, schema.classes.point.properties[id]]));
}

function plain({ count, at }, { type }, { noData, offset = 0 } = {}) {
    const components = kComponents[type];
    const [lacking] = [noData].flat();
    const [start] = [offset].flat();
    const valueOf = (value) => (value === lacking ? NaN : value + start);
    const Values = start ? Float64Array : Float32Array;
    return { components, values: Values.from({ length: count * components }, (_, j) => valueOf(at(Math.floor(j / components), j % components))) };
}

/** By the node's matrix, which also turns z up to y up: turned back here, as 3D Tiles ask. */
function placed({ count, at }, m) {
    const positions = new Float32Array(3 * count);
    for (let i = 0; i < count; i += 1) {
        const [x, y, z] = [at(i, 0), at(i, 1), at(i, 2)];
        positions[3 * i] = m[0] * x + m[4] * y + m[8] * z + m[12];
        positions[3 * i + 1] = -(m[2] * x + m[6] * y + m[10] * z + m[14]);
        positions[3 * i + 2] = m[1] * x + m[5] * y + m[9] * z + m[13];
    }
    return positions;
}

/** Along the axes of the grid, which are the tileset's: only the node turns them. */
function floats(normals) {
    return normals && Float32Array.from({ length: 3 * normals.count }, (_, j) => normals.at(Math.floor(j / 3), j % 3) / normals.largest);
}

/** glTF has colours in linear light. */
function inSrgb(colors) {
    if (!colors) {
        return null;
    }
    const array = new Uint8Array(4 * colors.count).fill(255);
    for (let i = 0; i < colors.count; i += 1) {
        for (let k = 0; k < 3; k += 1) {
            const c = colors.at(i, k) / colors.largest;
            array[4 * i + k] = Math.round(255 * (c < 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055));
        }
    }
    return array;
}
