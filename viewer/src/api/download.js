import { byId, element } from '../page/element.js';
import { getBytes, pause } from './api.js';

const kKeptMs = 60_000;

/** Saves a file of the level that is shown: one of the server, or one that the page makes. By the page, since a link shows the server no key. */
export async function download({ href, ply, format: extension }, { shown }) {
    const name = fileNameOf(shown, extension);
    save(new Blob([await (ply ? ply() : getBytes(href))]), name);
}

/** Saves what is on the stage, as it is seen. The page shows that it does first: while a large picture is drawn it shows nothing else. */
export async function savePicture(stage, { shown }) {
    await new Promise(requestAnimationFrame);
    await pause(0);
    save(await stage.picture(), fileNameOf(shown, 'png'));
}

/** What a level is called as a file; undefined: the result without one. */
export const fileNameOf = (level, extension) =>
    `${[byId.title.textContent.replace(/\.(ply|drc)$/i, ''), level?.points].filter(Boolean).join('-')}.${extension}`;

function save(blob, name) {
    const url = URL.createObjectURL(blob);
    element('a', { href: url, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(url), kKeptMs);
}
