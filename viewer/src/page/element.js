/** A new element with properties and children. Text only ever goes in as text. */
export function element(name, properties = {}, ...children) {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
}

const kDoubtMs = 5_000;

/** Has a button ask once more before it acts: what it does cannot be undone. @returns what takes the question back */
export function actOnSecondClick(button, act) {
    const { textContent } = button;
    let isAsked = false;
    let doubt = null;
    const ask = (wanted) => {
        clearTimeout(doubt);
        isAsked = wanted;
        button.textContent = wanted ? 'Really?' : textContent;
        button.classList.toggle('alarm', wanted);
    };
    button.onclick = () => {
        const isSure = isAsked;
        ask(!isSure);
        if (isSure) {
            act();
        } else {
            doubt = setTimeout(() => ask(false), kDoubtMs);
        }
    };
    return () => ask(false);
}

/** For a button's `onclick`: it says what it does for as long as that takes, and does it once at a time. @param act  returns a promise */
export function whileSaying(doing, act) {
    let isBusy = false;
    return async ({ currentTarget: button }) => {
        if (isBusy) {
            return;
        }
        const { textContent } = button;
        isBusy = true;
        button.textContent = doing;
        try {
            await act();
        } finally {
            isBusy = false;
            button.textContent = textContent;
        }
    };
}

/** Puts other children in. Where one of the old had the focus, the new one with its id has it, or else the stage. */
export function exchange(parent, ...children) {
    const focused = parent.contains(document.activeElement) ? document.activeElement.id : null;
    parent.replaceChildren(...children);
    if (focused !== null) {
        (byId[focused] ?? byId.stage).focus({ preventScroll: true });
    }
}

/** Hides a part of the page, or shows it. If the focus was in what is hidden, `next` has it now. */
export function setHidden(part, isHidden, next = byId.stage) {
    if (isHidden && part.contains(document.activeElement)) {
        next.focus();
    }
    part.hidden = isHidden;
}

const openers = new WeakMap();  // by the cards that took the focus when they were opened, what had it

/**
 * Opens a card that a button opens, or closes it: what is inside gives the focus back.
 * @param button  or null, where there is none now; @param takesFocus  whether the first that can be done in it has the focus then, as where a key opens it
 */
export function setOpen(card, isOpen, button, { takesFocus = false } = {}) {
    if (isOpen) {
        openers.set(card, takesFocus ? document.activeElement : null);
    }
    const next = [openers.get(card), button].find((part) => part && part !== document.body && part.checkVisibility());
    setHidden(card, !isOpen, next);
    if (button) {
        button.ariaExpanded = String(isOpen);
    }
    if (isOpen && takesFocus) {
        card.querySelector('button:not([hidden]), select, input')?.focus();
    }
}

/** The page's elements by their id: `byId.level`. */
export const byId = new Proxy({}, { get: (_, id) => document.getElementById(id) });
