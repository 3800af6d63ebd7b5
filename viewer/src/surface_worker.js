// Beside the page: for every point the size of its splat, and its normal where the cloud brings none.
import { readTile } from './glb_tile.js';
import { readPly } from './ply_cloud.js';
import { estimateSurface, robustSpacing } from './surface_estimate.js';

/** Of points, or of those in files. */
onmessage = async ({ data: { id, files, kind, offset, largest, spacing: told, points, ...given } }) => {
    try {
        const { positions, normals, colors = null, attributes = {} } = files ? joined(await Promise.all(files.map(readers[kind])), offset) : given;
        // An error map has other points than the candidate whose spacing is told.
        const spacing = robustSpacing(positions, told * Math.sqrt(points / (positions.length / 3)));
        const surface = estimateSurface(positions, normals, spacing, largest);
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

// Before there is anything to do: the browser compiles well what has run a few times.
const practice = Float32Array.from({ length: 3 * 2000 }, (_, i) => (i * 0.618034) % 1);
for (let run = 0; run < 4; run += 1) {
    estimateSurface(practice, null, 0.05);
}
