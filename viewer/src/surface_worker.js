// Beside the page: for every point the size of its splat, and its normal where the cloud brings none.
import { readTile } from './glb_tile.js';
import { estimateSurface, robustSpacing } from './surface_estimate.js';

/** Spacings; see `estimateSurface`. */
const kLargestInTiles = 3;

/** Of points, or of those in a `glb`. */
onmessage = async ({ data: { id, glb, spacing: said, ...given } }) => {
    try {
        const { positions, normals, colors = null, attributes = {} } = glb ? await readTile(glb) : given;
        const spacing = robustSpacing(positions, said);
        const surface = estimateSurface(positions, normals, spacing, glb ? kLargestInTiles : undefined);
        const arrays = [positions, surface, ...(colors ? [colors] : []), ...Object.values(attributes).map(({ values }) => values)];
        postMessage({ id, positions, surface, spacing, colors, attributes }, arrays.map(({ buffer }) => buffer));
    } catch (error) {
        postMessage({ id, failure: error.message });
    }
};

// Before there is anything to do: the browser compiles well what has run a few times.
const practice = Float32Array.from({ length: 3 * 2000 }, (_, i) => (i * 0.618034) % 1);
for (let run = 0; run < 4; run += 1) {
    estimateSurface(practice, null, 0.05);
}
