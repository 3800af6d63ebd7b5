// A cloud's id is the hash of its bytes; the file name it was uploaded under is remembered by this browser alone.

const kKey = 'stipple.cloud-names';
const kMost = 200;

export function nameOf(cloudId) {
    return read()[cloudId] ?? `Cloud ${cloudId.slice(0, 7)}`;
}

export function remember(cloudId, fileName) {
    const others = Object.entries(read()).filter(([id]) => id !== cloudId);
    try {
        localStorage.setItem(kKey, JSON.stringify(Object.fromEntries([...others, [cloudId, fileName]].slice(-kMost))));
    } catch {
        // Storage is full or switched off: names are a comfort only.
    }
}

function read() {
    try {
        return JSON.parse(localStorage.getItem(kKey)) ?? {};
    } catch {
        return {};
    }
}
