/** A new element with properties and children. Text only ever goes in as text. */
export function element(name, properties = {}, ...children) {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
}

const kDoubtMs = 5_000;

/** Has a button ask once more before it acts: what it does cannot be undone. */
export function actOnSecondClick(button, act) {
    const { textContent } = button;
    let isAsked = false;
    const ask = (wanted) => {
        isAsked = wanted;
        button.textContent = wanted ? 'Really?' : textContent;
        button.classList.toggle('alarm', wanted);
    };
    button.onclick = () => {
        if (isAsked) {
            act();
        } else {
            setTimeout(() => ask(false), kDoubtMs);
        }
        ask(!isAsked);
    };
}

/** The page's elements by their id: `byId.level`. */
export const byId = new Proxy({}, { get: (_, id) => document.getElementById(id) });
