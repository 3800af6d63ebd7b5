// Beside the page: for every point the size of its splat, and its normal where the cloud brings none.
import { estimateSurface } from './surface_estimate.js';

onmessage = ({ data: { id, positions, normals, spacing } }) => {
    const surface = estimateSurface(positions, normals, spacing);
    postMessage({ id, positions, surface }, [positions.buffer, surface.buffer]);
};
