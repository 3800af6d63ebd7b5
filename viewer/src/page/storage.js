// What the browser keeps for the page, where it may: with storage switched off nothing is kept.

/** @param where  `localStorage`, for later visits, or `sessionStorage`, for this tab */
export function recall(where, name) {
    try {
        return window[where].getItem(name);
    } catch {
        return null;
    }
}

/** @param value  null: forgets it */
export function keep(where, name, value) {
    try {
        if (value === null) {
            window[where].removeItem(name);
        } else {
            window[where].setItem(name, value);
        }
    } catch {
        // It is asked for again when it is needed.
    }
}
