import { byId } from './element.js';
import { showProblem } from './notices.js';

const kHint = 'Drop a .ply or .drc anywhere, or choose a file';
const kHintByTouch = 'Choose a .ply or .drc file';

/** Where files come in: by the button, or dropped anywhere on the page. */
export class FilePicker {
    /** @param onFiles  told the files, one or more */
    constructor({ onFiles }) {
        byId['upload-hint'].textContent = matchMedia('(pointer: coarse)').matches ? kHintByTouch : kHint;
        byId.choose.onclick = () => byId.file.click();
        byId.file.onchange = () => {
            onFiles([...byId.file.files]);
            byId.file.value = '';
        };
        acceptDrops({
            onFiles: (files) => files.length > 0 && onFiles(files),
            onFolder: (name) => showProblem(new Error('Drop the files inside it.'), `${name} is a folder`),
            onHover: (isHeld) => { byId.drop.hidden = !isHeld; },
        });
    }
}

/**
 * Calls `onFiles` with the files that are dropped anywhere on the page; `onHover` tells when one is held above it.
 * @param onFolder  told the name of each folder among them
 */
function acceptDrops({ onFiles, onFolder, onHover }) {
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
            const isFolder = (item) => item.webkitGetAsEntry()?.isDirectory;
            const items = [...event.dataTransfer.items].filter(({ kind }) => kind === 'file');
            const folders = items.filter(isFolder);
            onFiles(items.filter((item) => !folders.includes(item)).map((item) => item.getAsFile()));
            folders.forEach((item) => onFolder(item.webkitGetAsEntry().name));  // after the files, with which notices of before go
        }
    });
}
