// The key of a server that asks for one: kept by this browser alone, for this tab or, if wished, for later visits.
import { byId } from '../page/element.js';
import { keep, recall } from '../page/storage.js';

const kName = 'stipple.api-key';
const kSendable = /^[\x20-\x7e]+$/;  // in a header field; the input's pattern, too
let asking = null;
let entered = null;  // also where the browser keeps nothing

/** The header fields that show the key; none while there is no key. */
export function authorization() {
    const key = [entered, recall('sessionStorage', kName), recall('localStorage', kName)].find((known) => known && kSendable.test(known));
    return key ? { Authorization: `Bearer ${key}` } : {};
}

/** Asks the person for a key; resolves once there is one. Requests that are refused meanwhile wait for the same answer. */
export function askForKey(reason) {
    asking ??= new Promise((resolve) => {
        byId['key-reason'].textContent = reason;
        byId['key-form'].onsubmit = (event) => {
            event.preventDefault();
            entered = byId.key.value.trim();
            keep('sessionStorage', kName, entered);
            keep('localStorage', kName, byId['key-stays'].checked ? entered : null);
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
