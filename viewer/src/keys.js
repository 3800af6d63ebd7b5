import { byId } from './element.js';

const kTurn = 1 / 48;
const kNearer = 1.15;
const kMoves = {
    ArrowLeft: [kTurn, 0], ArrowRight: [-kTurn, 0], ArrowUp: [0, kTurn], ArrowDown: [0, -kTurn],
    '+': [0, 0, kNearer], '=': [0, 0, kNearer], '-': [0, 0, 1 / kNearer],
};

/**
 * Keys that work everywhere but where one writes, and those that turn the cloud while it has the focus.
 * @param onKey  by key, in lower case; @param onLevel  told the number of a level, from 0
 */
export function listenToKeys({ onMove, onLevel, onKey }) {
    byId.stage.onkeydown = (event) => {
        if (event.key in kMoves && !event.ctrlKey && !event.metaKey) {
            event.preventDefault();
            onMove(...kMoves[event.key]);
        }
    };
    addEventListener('keydown', (event) => {
        if (event.ctrlKey || event.metaKey || event.altKey || isFor(event)) {
            return;
        }
        const act = onKey[event.key.toLowerCase()];
        if (act) {
            event.preventDefault();
            act();
        } else if (event.key >= '1' && event.key <= '9') {
            onLevel(Number(event.key) - 1);
        }
    });
}

/** Whether what has the focus takes the key itself. */
const isFor = ({ target, key }) => target.closest('dialog, select, input[type=number], input[type=text]') ||
    (key === ' ' && target.closest('a, button, input, summary, [role=slider]'));
