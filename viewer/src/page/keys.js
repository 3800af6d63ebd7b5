import { byId } from './element.js';
import { keep, recall } from './storage.js';

const kTurn = 1 / 48;
const kPanPixels = 40;
const kNearer = 1.15;
const kOff = 'stipple.keys-off';
const kMoves = {
    ArrowLeft: [kTurn, 0], ArrowRight: [-kTurn, 0], ArrowUp: [0, kTurn], ArrowDown: [0, -kTurn],
    '+': [0, 0, kNearer], '=': [0, 0, kNearer], '-': [0, 0, 1 / kNearer],
};

/**
 * Keys that work everywhere but where one writes, unless they are switched off, and those that move the cloud while it has the focus.
 * @param onKey  by key, in lower case; @param onLevel  told the number of a level, from 0
 */
export function listenToKeys(stage, { onLevel, onKey }) {
    byId.shortcuts.checked = recall('localStorage', kOff) === null;
    byId.shortcuts.onchange = () => keep('localStorage', kOff, byId.shortcuts.checked ? null : 'yes');
    byId.stage.onkeydown = (event) => {
        const move = kMoves[event.key];
        if (event.ctrlKey || event.metaKey || event.altKey || !(move || event.key === 'Enter')) {
            return;
        }
        event.preventDefault();
        if (!move) {
            stage.focusMiddle();
        } else if (event.shiftKey && event.key.startsWith('Arrow')) {
            stage.pan(...move.map((turn) => kPanPixels * Math.sign(turn)));
        } else {
            stage.turn(...move);
        }
    };
    addEventListener('keydown', (event) => {
        if (event.ctrlKey || event.metaKey || event.altKey || isFor(event)) {
            return;
        }
        if (!byId.shortcuts.checked && event.key !== 'Escape') {
            return;
        }
        const act = onKey[event.key.toLowerCase()];
        if (act) {
            event.preventDefault();
            if (!event.repeat) {
                act();
            }
        } else if (event.key >= '1' && event.key <= '9') {
            onLevel(Number(event.key) - 1);
        }
    });
}

/** The cards that keys open; from inside, where the focus is then, they are closed by the same key and by Escape. */
const kCards = { l: '#look-card', s: '#share-card', escape: '.look-card' };

/** Whether what has the focus takes the key itself. */
const isFor = ({ target, key }) => !isOfCard(target, key) &&
    (target.closest('dialog, select, input[type=number], input[type=text]') || (key === ' ' && target.closest('a, button, input, summary, [role=slider]')));

const isOfCard = (target, key) => key.toLowerCase() in kCards && target.closest(kCards[key.toLowerCase()]);
