/* global ASSETS: the URL of each file, put in by build.mjs */

const kMostWorkers = Math.min(4, Math.max(1, navigator.hardwareConcurrency - 1));
const workers = [];  // `{worker, waiting}`: by id, who waits for its replies
let lastId = 0;

/** Starts a worker before the first level needs it. */
export function preloadSurface() {
    if (workers.length === 0) {
        workers.push(started());
    }
}

/** `estimateSurface` beside the page. Takes `positions` over and gives it back. */
export function estimateSurfaceInWorker(positions, normals, spacing) {
    return ask({ positions, normals, spacing }, positions.buffer);
}

/** The same of the points in a glb, with their colours or null and their attributes. Takes `glb` over. */
export const readTileInWorker = (glb, spacing) => ask({ glb, spacing }, glb);

function ask(message, buffer) {
    const { worker, waiting } = leastBusy();
    return new Promise((resolve, reject) => {
        lastId += 1;
        waiting.set(lastId, { resolve, reject });
        worker.postMessage({ id: lastId, ...message }, [buffer]);
    });
}

function leastBusy() {
    const best = workers.toSorted((a, b) => a.waiting.size - b.waiting.size)[0];
    if (best && (best.waiting.size === 0 || workers.length === kMostWorkers)) {
        return best;
    }
    workers.push(started());
    return workers.at(-1);
}

function started() {
    const worker = new Worker(ASSETS['surface_worker.js'], { type: 'module' });
    const waiting = new Map();
    const self = { worker, waiting };
    const fail = (id, reason) => {
        waiting.get(id).reject(new Error(reason));
        waiting.delete(id);
    };
    worker.onmessage = ({ data }) => {
        if (data.failure) {
            fail(data.id, data.failure);
        } else {
            waiting.get(data.id).resolve(data);
            waiting.delete(data.id);
        }
    };
    worker.onerror = () => {
        [...waiting.keys()].forEach((id) => fail(id, 'estimating the surface ran out of memory'));
        worker.terminate();
        workers.splice(workers.indexOf(self), 1);
    };
    return self;
}
