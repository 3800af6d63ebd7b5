import { kKeyNeeded, Problem, problemFrom, readJson, unreachable } from './api.js';
import { askForKey, authorization } from './api_key.js';

const kCreated = 201;

/**
 * Sends a file; resolves to the document of its cloud, with `isNew`: whether the server did not have it already.
 * @param onProgress  told how many bytes were sent, of how many; @param signal  calls it off
 */
export async function uploadCloud(file, { onProgress = () => {}, signal } = {}) {
    if (file.size === 0) {
        throw new Problem({ title: 'The file is empty', detail: 'The file is empty: it has no bytes.', status: null });
    }
    try {
        const { status, responseText } = await send(file, onProgress, signal);
        return { ...await readJson(new Response(responseText)), isNew: status === kCreated };
    } catch (error) {
        if (error.status !== kKeyNeeded) {
            throw error;
        }
        await askForKey(error.message);
        return uploadCloud(file, { onProgress, signal });
    }
}

/** By XMLHttpRequest, since fetch tells no upload progress: resolves to it. */
function send(file, onProgress, signal) {
    return new Promise((resolve, reject) => {
        const request = new XMLHttpRequest();
        request.open('POST', `v1/clouds?name=${encodeURIComponent(file.name.replace(/\p{Cc}/gu, ''))}`);
        request.setRequestHeader('Content-Type', 'application/octet-stream');
        Object.entries(authorization()).forEach(([name, value]) => request.setRequestHeader(name, value));
        request.upload.onprogress = ({ loaded, total }) => onProgress(loaded, total);
        request.onload = () => {
            if (request.status >= 200 && request.status < 300) {
                resolve(request);
            } else {
                reject(problemFrom(request.status, request.statusText, request.responseText));
            }
        };
        request.onerror = async () => reject(await isReadable(file) ? unreachable() : unreadable());
        request.onabort = () => reject(signal.reason);
        signal?.throwIfAborted();
        signal?.addEventListener('abort', () => request.abort());
        request.send(file);
    });
}

/** It may have been moved since it was chosen, or be a folder. */
const isReadable = (file) => file.slice(0, 1).arrayBuffer().then(() => true, () => false);

const unreadable = () => new Problem({
    title: 'The file cannot be read',
    detail: 'The browser cannot read it: check that it still exists unchanged and that you may open it.',
    status: null,  // the server was not asked
});
