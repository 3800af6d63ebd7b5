// Beside the page: for every point the size of its splat, and its normal where the cloud brings none.
import { readTile } from '../decoding/glb_tile.js';
import { readPly } from '../decoding/ply_cloud.js';
import { estimateSurface, robustSpacing } from './surface_estimate.js';

/** Of points, or of those in files. */
onmessage = async ({ data: { id, files, kind, offset, isTile, spacing: told, points, ...given } }) => {
    try {
        const { positions, normals, colors = null, attributes = {} } = files ? joined(await Promise.all(files.map(readers[kind])), offset) : given;
        // An error map has other points than the candidate whose spacing is told.
        const spacing = robustSpacing(positions, told * Math.sqrt(points / (positions.length / 3)));
        const surface = estimateSurface(positions, normals, spacing, isTile);
        const arrays = [positions, surface, ...(colors ? [colors] : []), ...Object.values(attributes).map(({ values }) => values)];
        postMessage({ id, positions, surface, spacing, colors, attributes }, arrays.map(({ buffer }) => buffer));
    } catch (error) {
        postMessage({ id, failure: error.message });
    }
};

const readers = { ply: readPly, glb: readTile };

/** The points of all files of a level as one cloud, moved by an offset. */
function joined(clouds, offset) {
    const of = (read) => {
        const parts = clouds.map(read);
        return parts.every(Boolean) ? concatenated(parts) : null;
    };
    const moved = ({ positions }) => Float32Array.from(positions, (x, k) => x + offset[k % 3]);
    const names = Object.keys(clouds[0].attributes);
    return {
        positions: of(moved),
        normals: of(({ normals }) => normals),
        colors: of(({ colors }) => colors),
        attributes: Object.fromEntries(names.map((name) => [name, {
            components: clouds[0].attributes[name].components,
            values: of(({ attributes }) => attributes[name].values),
        }])),
    };
}

function concatenated(parts) {
    if (parts.length === 1) {
        return parts[0];
    }
    const all = new parts[0].constructor(parts.reduce((sum, { length }) => sum + length, 0));
    let at = 0;
    for (const part of parts) {
        all.set(part, at);
        at += part.length;
    }
    return all;
}

// Before there is anything to do: the browser compiles well what has run a few times, on points that lie as those of scans do, also
// so far off that numbers of their cells are large. Asked as the page asks: V8 drops what it has compiled of arrays when one is
// given away for the first time, as every result is.
const kPractice = 2000, kFar = 10;
const practice = new Float32Array(3 * kPractice);
for (let i = 0; i < kPractice; i += 1) {
    const z = 1 - (2 * i + 1) / kPractice, ring = Math.sqrt(1 - z * z), angle = i * Math.PI * (3 - Math.sqrt(5));
    const bumps = 1 + 0.3 * Math.sin(5 * angle) * Math.sin(7 * z) + 0.01 * Math.sin(i * i);
    practice.set([bumps * ring * Math.cos(angle), bumps * ring * Math.sin(angle) + kFar, bumps * z], 3 * i);
}
for (let run = 0; run < 5; run += 1) {
    onmessage({ data: { id: null, positions: practice.slice(), normals: null, spacing: 0.05, points: kPractice } });
}
