// What the page asks of the server: openapi.yaml has the contract.
import { askForKey, authorization } from './api_key.js';

export const kKeyNeeded = 401;
const kPart = 206;
const kConflict = 409;

const kFirstPauseMs = 700;
const kLongestPauseMs = 10_000;
const kPage = 100;

/** A refusal: an RFC 9457 problem document, or its stand-in where there was no reply at all. */
export class Problem extends Error {
    constructor({ title, detail, status = 0 }) {
        super(detail || title);
        this.title = title;
        this.status = status;
    }
}

export async function getJson(url, signal) {
    return readJson(await send(url, { signal }));
}

/** @param onPiece  told of what has come since it was last told: how many bytes, and how many came for them over the line, where they may be packed */
export async function getBytes(url, signal, onPiece = () => {}) {
    const response = await send(url, { signal });
    const packed = packedLength(response);
    const reader = response.body.getReader();
    const pieces = [];
    for (;;) {
        const { done, value } = await arrival(reader.read());
        if (done) {
            onPiece(0, packed ?? 0);
            return new Blob(pieces).arrayBuffer();
        }
        pieces.push(value);
        onPiece(value.length, packed === null ? value.length : 0);
    }
}

/** The bytes of a reply that the browser unpacks, or null: of another one, and of one that does not say. */
const packedLength = ({ headers }) => (headers.get('Content-Encoding') && Number(headers.get('Content-Length'))) || null;

/** The bytes from one on, as they come: `take` is called with each piece, and says whether that was enough. */
export async function readBytes(url, from, take, signal) {
    const response = await send(url, { signal, headers: from > 0 ? { Range: `bytes=${from}-` } : {} });
    const reader = response.body.getReader();
    let before = response.status === kPart ? 0 : from;  // bytes that are there already
    for (;;) {
        const { done, value } = await arrival(reader.read());
        if (done) {
            throw unreachable();  // it ended early
        }
        const skipped = Math.min(before, value.length);
        before -= skipped;
        if (skipped < value.length && await take(value.subarray(skipped))) {
            await reader.cancel();
            return;
        }
    }
}

export const listClouds = (count) => list('clouds', count);
export const listJobs = (count) => list('jobs', count);
export const getJob = (id, signal) => getJson(pathOf('jobs', id), signal);

/** `items`, the newest `count` or a few more, and whether there `areMore`. */
async function list(collection, count) {
    const items = [];
    let next;
    do {
        const page = await getJson(`v1/${collection}?limit=${kPage}${next ? `&cursor=${encodeURIComponent(next)}` : ''}`);
        items.push(...page.items);
        next = page.next;
    } while (next && items.length < count);
    return { items, areMore: Boolean(next) };
}

let ahead = null;

/** Asks for a manifest that will soon be wanted: while the page still builds its stage, the reply is on its way. */
export function askAhead(result) {
    if (ahead?.id === result.id) {
        return;
    }
    ahead = { id: result.id, manifest: getManifest(result) };
    ahead.manifest.catch(() => {});  // told to whoever wants it
}

/** The levels that are there so far, of a pyramid with the bytes of the first; `complete` tells whether more will come. */
export function getManifest({ id, type }, signal) {
    if (ahead?.id === id) {
        const { manifest } = ahead;
        ahead = null;
        return manifest;
    }
    return getJson(type === 'pyramid' ? `${pathOf('pyramids', id)}/manifest.json?inline=drc` : `${pathOf('jobs', id)}/results`, signal);
}

/** @param fields  of the job beside its type and the cloud that it is about */
export async function startJob(type, cloudId, fields) {
    return readJson(await send('v1/jobs', {
        method: 'POST',
        headers: { 'Content-Type': 'application/json' },
        body: JSON.stringify({ type, [type === 'evaluate' ? 'reference' : 'input']: cloudId, ...fields }),
    }));
}

/** The distances of two clouds, by their hashes, as a coloured cloud. @param label  what the candidate is called where they are shown */
export const startEvaluation = (reference, candidate, label) => startJob('evaluate', reference, { candidate, labels: [label], map: ['drc'] });

/** One that has ended meanwhile stays as it is. */
export async function cancelJob(id) {
    await send(`${pathOf('jobs', id)}?only=unfinished`, { method: 'DELETE' }).catch((error) => {
        if (error.status !== kConflict) {
            throw error;
        }
    });
}

/** With its results. */
export async function removeJob(id) {
    await send(pathOf('jobs', id), { method: 'DELETE' });
}

export async function removeCloud(id) {
    await send(pathOf('clouds', id), { method: 'DELETE' });
}

/** The reply whose body tells of a job's events as they come. Not an EventSource: that shows no key. */
export const openEvents = (id, signal) => send(`${pathOf('jobs', id)}/events`, { signal });

export const isFinal = (job) => ['successful', 'failed', 'dismissed'].includes(job.status);

/** The problem in a reply's text: the server's own words where it sent some. */
export function problemFrom(status, statusText, text) {
    try {
        const { title, detail } = JSON.parse(text);
        if (title || detail) {
            return new Problem({ title: title ?? statusText, detail, status });
        }
    } catch {
        // Not a problem document: a proxy in between answered.
    }
    return new Problem({ title: `The server answered ${status}`, detail: statusText, status });
}

export const unreachable = () => new Problem({
    title: 'The server cannot be reached',
    detail: 'Check that the server (stippled) runs and that this machine is online.',
});

export const kLost = 'Connection lost; trying again';

/**
 * Asks until there is an answer, unless `signal` says that nobody waits any more, at growing intervals: `onLost` is told when the server first cannot be reached, or fails. What
 * it returns is called once that is over.
 */
export async function persist(ask, { signal, onLost }) {
    let onOver = null;
    try {
        for (let tried = 1; ; tried += 1) {
            try {
                return await ask();
            } catch (error) {
                if (signal?.aborted || !mayPass(error)) {
                    throw error;
                }
                onOver ??= onLost(error);
            }
            await pause(Math.min(kLongestPauseMs, kFirstPauseMs * 2 ** (tried - 1)), signal);
        }
    } finally {
        onOver?.();
    }
}

/** Ends at once when `signal` says so. */
export const pause = (ms, signal) => new Promise((resolve) => {
    const end = () => {
        clearTimeout(timer);
        signal?.removeEventListener('abort', end);
        resolve();
    };
    const timer = setTimeout(end, ms);
    signal?.addEventListener('abort', end);
});

/** Whether the same request may succeed a little later. */
export const mayPass = ({ status }) => status === 0 || status === 429 || status >= 500;

/** The ids of links may be anything. */
const pathOf = (collection, id) => `v1/${collection}/${encodeURIComponent(id)}`;

async function send(url, init = {}) {
    const response = await arrival(fetch(url, { ...init, headers: { ...init.headers, ...authorization() } }));
    if (response.ok) {
        return response;
    }
    const problem = problemFrom(response.status, response.statusText, await response.text());
    if (problem.status !== kKeyNeeded) {
        throw problem;
    }
    await askForKey(Object.keys(authorization()).length > 0 ? problem.message : 'This server asks for an API key.');
    return send(url, init);
}

export const readJson = (response) => arrival(response.json());

/** What the network brings, or the problem that it does not. */
async function arrival(promise) {
    try {
        return await promise;
    } catch (error) {
        throw error.name === 'AbortError' ? error : unreachable();
    }
}
