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

/**
 * `estimateSurface` beside the page, by `robustSpacing`, which it gives too. Takes `positions` over and gives it back. When the
 * signal says that nobody waits any more, the work ends. The `spacing` that is told is that of so many `points`.
 */
export function estimateSurfaceInWorker(positions, normals, { spacing, points }, signal) {
    return ask({ positions, normals, spacing, points }, [positions.buffer], signal);
}

/**
 * The same of the points in files, with their colours or null and their attributes. Takes the files over.
 * @param what  `files`, all of one `kind` (`ply`, `glb`); `offset`, which is added to their positions; `isTile`: whether beyond their border lie points of other tiles
 */
export const readFilesInWorker = (what, { spacing, points }, signal) => ask({ ...what, spacing, points }, what.files, signal);

async function ask(message, buffers, signal) {
    signal?.throwIfAborted();
    const self = leastBusy();
    const id = lastId += 1;
    const giveUp = () => {
        const { reject } = self.waiting.get(id);
        self.waiting.delete(id);
        if (self.waiting.size === 0) {
            end(self);
        }
        reject(signal.reason);
    };
    signal?.addEventListener('abort', giveUp, { once: true });
    try {
        return await new Promise((resolve, reject) => {
            self.waiting.set(id, { resolve, reject });
            self.worker.postMessage({ id, ...message }, buffers);
        });
    } finally {
        self.waiting.delete(id);  // also what could not be sent
        signal?.removeEventListener('abort', giveUp);
    }
}

/** Whatever it is at: a worker cannot be told to stop. */
function end(self) {
    self.worker.terminate();
    const at = workers.indexOf(self);
    if (at >= 0) {
        workers.splice(at, 1);
    }
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
        waiting.get(id)?.reject(new Error(reason));
        waiting.delete(id);
    };
    worker.onmessage = ({ data }) => {
        if (data.failure) {
            fail(data.id, data.failure);
        } else {
            waiting.get(data.id)?.resolve(data);  // unless it was given up, or is practice
            waiting.delete(data.id);
        }
    };
    worker.onerror = () => {
        [...waiting.keys()].forEach((id) => fail(id, 'the surface could not be estimated: for lack of memory, or since the page is another version than its server; load it anew'));
        end(self);
    };
    return self;
}
