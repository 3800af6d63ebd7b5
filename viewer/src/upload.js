import { kKeyNeeded, problemFrom, unreachable } from './api.js';
import { askForKey, authorization } from './api_key.js';

const kCreated = 201;

/** Sends a file; resolves to the document of its cloud, with `isNew`: whether the server did not have it already. */
export async function uploadCloud(file, onProgress) {
    try {
        return await send(file, onProgress);
    } catch (error) {
        if (error.status !== kKeyNeeded) {
            throw error;
        }
        await askForKey(error.message);
        return uploadCloud(file, onProgress);
    }
}

/** By XMLHttpRequest, since fetch tells no upload progress. */
function send(file, onProgress) {
    return new Promise((resolve, reject) => {
        const request = new XMLHttpRequest();
        request.open('POST', `/v1/clouds?name=${encodeURIComponent(file.name.replace(/\p{Cc}/gu, ''))}`);
        request.setRequestHeader('Content-Type', 'application/octet-stream');
        Object.entries(authorization()).forEach(([name, value]) => request.setRequestHeader(name, value));
        request.upload.onprogress = ({ loaded, total }) => onProgress(total > 0 ? loaded / total : 1);
        request.onload = () => {
            if (request.status >= 200 && request.status < 300) {
                resolve({ ...JSON.parse(request.responseText), isNew: request.status === kCreated });
            } else {
                reject(problemFrom(request.status, request.statusText, request.responseText));
            }
        };
        request.onerror = () => reject(unreachable());
        request.send(file);
    });
}

/** Calls `onFiles` with the files that are dropped anywhere on the page; `onHover` tells when one is held above it. */
export function acceptDrops(onFiles, onHover) {
    let depth = 0;  // dragenter and dragleave also come for every child
    const carriesFiles = (event) => event.dataTransfer?.types.includes('Files');
    const hover = (change) => {
        depth = change === 0 ? 0 : Math.max(0, depth + change);
        onHover(depth > 0);
    };
    addEventListener('dragenter', (event) => carriesFiles(event) && hover(1));
    addEventListener('dragleave', (event) => carriesFiles(event) && hover(-1));
    addEventListener('dragover', (event) => carriesFiles(event) && event.preventDefault());
    addEventListener('drop', (event) => {
        if (carriesFiles(event)) {
            event.preventDefault();
            hover(0);
            onFiles([...event.dataTransfer.files]);
        }
    });
}
