/* global ASSETS: the URL of each file, put in by build.mjs */
let worker = null;
let lastId = 0;
const waiting = new Map();

/** `estimateSurface` beside the page. Takes `positions` over and gives it back. */
export function estimateSurfaceInWorker(positions, normals, spacing) {
    worker ??= start();
    return new Promise((resolve, reject) => {
        lastId += 1;
        waiting.set(lastId, { resolve, reject });
        worker.postMessage({ id: lastId, positions, normals, spacing }, [positions.buffer]);
    });
}

function start() {
    const started = new Worker(ASSETS['surface_worker.js'], { type: 'module' });
    started.onmessage = ({ data }) => settle(data.id, 'resolve', data);
    started.onerror = () => {
        const failure = new Error('estimating the surface ran out of memory');
        [...waiting.keys()].forEach((id) => settle(id, 'reject', failure));
        started.terminate();
        worker = null;
    };
    return started;
}

function settle(id, how, value) {
    waiting.get(id)[how](value);
    waiting.delete(id);
}
