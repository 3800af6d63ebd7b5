// How a level is read: from its Draco file, else from its PLY file, else from all of its tiles.
import { BufferAttribute, BufferGeometry, Vector3 } from 'three';

import { getBytes } from '../api/api.js';
import { decodeAttribute, decodeLevel, stepOf } from '../decoding/draco_levels.js';
import { estimateSurfaceInWorker, readFilesInWorker } from './surface.js';

/** Unique ids of attributes in our Draco files: those of position, normal and colour are less. */
const kFirstAttributeId = 3;

/**
 * What a level is read from: `files`, `attributes` (each can `read` its values, and tell the `stepOf` them where some are lost), `load(buffers, level, signal)`: geometry with surface and the
 * spacing as it is; `file`: that of the whole level, where there is one.
 * @param manifest  of the pyramid or the job; @param number  of the level
 * @returns null where it has no file that can be shown
 */
export function sourceOf({ levels, request, source }, number) {
    const entry = levels[number];
    const attributes = entry.attributes.filter(({ name }) => name !== 'normal' && name !== 'color');
    const drc = entry.files.find(({ format }) => format === 'drc');
    if (drc) {
        return ofDraco(drc, attributes);
    }
    const ply = entry.files.find(({ format }) => format === 'ply');
    if (ply) {
        return { file: ply, ...ofFiles([ply], attributes, { kind: 'ply', offset: entry.origin.map((x) => -x) }) };
    }
    // Of tiles that add to each other those above belong to it; the coordinates of all are told from the middle of the source.
    const tiles = levels.slice(request.refine === 'add' ? 0 : number, number + 1).flatMap(({ files }) => files.filter(({ format }) => format === 'glb'));
    if (tiles.length === 0) {
        return null;
    }
    const offset = middleOf(source).sub(new Vector3(...entry.origin)).toArray();
    return ofFiles(tiles, request.tiles?.attributes ? attributes : [], { kind: 'glb', offset });
}

export const middleOf = ({ bounds: { min, max } }) => new Vector3(...min).add(new Vector3(...max)).multiplyScalar(0.5);

function ofDraco(file, attributes) {
    const read = async (id, type, signal) => decodeAttribute(await getBytes(file.href, signal), id, type);
    return {
        file,
        files: [file],
        attributes: attributes.map((attribute, i) => ({
            ...attribute,
            read: (signal) => read(kFirstAttributeId + i, attribute.type, signal),
            stepOf: (values) => stepOf(values, attribute.type),
        })),
        async load([buffer], level, signal) {
            return withSurface(await decodeLevel(buffer), level, signal);
        },
    };
}

/** Files that are read beside the page; their attributes come with them. */
function ofFiles(files, attributes, { kind, offset }) {
    let read = {};
    return {
        files,
        attributes: attributes.map((attribute) => ({ ...attribute, read: async () => read[attribute.name].values })),
        async load(buffers, level, signal) {
            const cloud = await readFilesInWorker({ files: buffers, kind, offset }, level, signal);
            read = cloud.attributes;
            return { geometry: bounded(geometryOf(cloud)), spacing: cloud.spacing };
        },
    };
}

/** Splat sizes and missing normals, in the one attribute that the shader reads. */
export async function withSurface(geometry, level, signal) {
    const position = geometry.getAttribute('position');
    const normals = geometry.getAttribute('normal')?.array ?? null;
    const { positions, surface, spacing } = await estimateSurfaceInWorker(position.array, normals, level, signal);
    geometry.setAttribute('position', new BufferAttribute(positions, 3));
    geometry.setAttribute('surface', new BufferAttribute(surface, 4, true));
    geometry.deleteAttribute('normal');
    return { geometry: bounded(geometry), spacing };
}

export function geometryOf({ positions, surface, colors }) {
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(positions, 3));
    geometry.setAttribute('surface', new BufferAttribute(surface, 4, true));
    if (colors) {
        geometry.setAttribute('color', new BufferAttribute(colors, 4, true));
    }
    return geometry;
}

function bounded(geometry) {
    geometry.computeBoundingBox();
    geometry.computeBoundingSphere();
    return geometry;
}
