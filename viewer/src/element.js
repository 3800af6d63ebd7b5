/** A new element with properties and children. Text only ever goes in as text. */
export function element(name, properties = {}, ...children) {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
}

/** The page's elements by their id: `byId.level`. */
export const byId = new Proxy({}, { get: (_, id) => document.getElementById(id) });
