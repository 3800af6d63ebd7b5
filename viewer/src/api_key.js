// The key of a server that asks for one: kept by this browser alone, for this tab or, if wished, for later visits.
import { byId } from './element.js';

const kName = 'stipple.api-key';
let asking = null;

/** The header fields that show the key; none while there is no key. */
export function authorization() {
    const key = read(sessionStorage) ?? read(localStorage);
    return key ? { Authorization: `Bearer ${key}` } : {};
}

/** Asks the person for a key; resolves once there is one. Requests that are refused meanwhile wait for the same answer. */
export function askForKey(reason) {
    asking ??= new Promise((resolve) => {
        byId['key-reason'].textContent = reason;
        byId['key-form'].onsubmit = (event) => {
            event.preventDefault();
            keep(byId.key.value.trim(), byId['key-stays'].checked);
            byId.key.value = '';
            byId['key-dialog'].close();
            asking = null;
            resolve();
        };
        byId['key-dialog'].oncancel = (event) => event.preventDefault();  // nothing can be shown without one
        byId['key-dialog'].onclose = () => asking && byId['key-dialog'].showModal();  // a second Escape cannot be prevented
        byId['key-dialog'].showModal();
    });
    return asking;
}

function keep(key, stays) {
    for (const [storage, wanted] of [[sessionStorage, true], [localStorage, stays]]) {
        try {
            storage.removeItem(kName);
            if (wanted) {
                storage.setItem(kName, key);
            }
        } catch {
            // Storage is switched off: the key is asked for again when it is needed.
        }
    }
}

function read(storage) {
    try {
        return storage.getItem(kName);
    } catch {
        return null;
    }
}
