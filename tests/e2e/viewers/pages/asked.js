// What the test asks of a page, and what the page tells when its picture stands.
const query = new URLSearchParams(location.search);

export const server = query.get('server');
export const job = query.get('job');
/** `eye`, `target`, `up`, in the file's coordinates; `fov` in degrees, of a square picture; `isFlat`: of colours alone. */
export const view = JSON.parse(query.get('view'));

export function tell(drawn) {
    window.drawn = drawn;
}

export const nextFrame = () => new Promise(requestAnimationFrame);
