// What of the page is in its address: the result, and how it is looked at. So it is there again after a reload, or for someone else.

/** How a result is looked at where an address says nothing of it. */
export const kAsNew = {
    chosen: null, bound: null, view: null, color: null, splatSize: null, shading: null, right: null, layout: null, at: null,
};

const kTypes = ['pyramid', 'job'];
const kLooks = ['level', 'error', 'color', 'splat', 'shading', 'view', 'beside', 'with', 'layout', 'at'];
const kLayouts = ['beside', 'swipe'];
const kFarthest = 1000;  // radii of the cloud from its middle
const kDigits = 10;  // a bound is as exact as the errors that it is compared with

/**
 * The result that the address names, or nothing: `{id, type}` with `chosen`, a level from 0, or `bound`, of the error; `color`, `splatSize`, `shading`;
 * `view` (see Stage); `right`, what it is compared with (`level:N`, from 0, or `result:ID`), with `layout` and the line `at` a share of the width.
 * What it does not say is null.
 */
export function readAddress() {
    const query = new URLSearchParams(location.search);
    const type = kTypes.find((name) => query.has(name));
    const number = (name) => (query.get(name)?.trim() && Number.isFinite(Number(query.get(name))) ? Number(query.get(name)) : null);
    const level = (name) => (Number.isInteger(number(name)) && number(name) > 0 ? number(name) - 1 : null);
    const view = (query.get('view') ?? '').split(',').map(Number);
    return type && {
        id: query.get(type), type,
        chosen: level('level'),
        bound: number('error') > 0 ? number('error') : null,
        color: query.get('color'),
        splatSize: number('splat') > 0 ? number('splat') : null,
        shading: number('shading'),
        view: isView(view) ? view : null,
        right: query.get('with') ? `result:${query.get('with')}` : level('beside') === null ? null : `level:${level('beside')}`,
        layout: kLayouts.find((layout) => layout === query.get('layout')) ?? null,
        at: number('at'),
    };
}

/** The address of a result that is not yet looked at, or, of null, that of the page without one; what it has beside these stays. */
export function addressOf(result) {
    const address = new URL(location.href);
    [...kTypes, ...kLooks].forEach((name) => address.searchParams.delete(name));
    if (result) {
        address.searchParams.set(result.type === 'pyramid' ? 'pyramid' : 'job', result.id);
    }
    return address.href;
}

/** Two places, apart, from which the cloud can be seen. */
function isView(view) {
    const [position, target] = [view.slice(0, 3), view.slice(3)];
    return view.length === 6 && view.every((x) => Math.abs(x) <= kFarthest) && position.some((x, axis) => x !== target[axis]);
}

/** Writes what `readAddress` reads; what the address has beside it stays. */
export function writeAddress({ id, type, chosen, bound, color, splatSize, shading, view, right, layout, at }) {
    const address = new URL(addressOf({ id, type }));
    const [kind, other] = right?.split(':') ?? [];
    const how = {
        level: chosen === null ? null : chosen + 1,
        error: bound === null ? null : Number(bound.toPrecision(kDigits)),
        color, splat: splatSize, shading,
        view: view?.join() ?? null,
        beside: kind === 'level' ? Number(other) + 1 : null,
        with: kind === 'result' ? other : null,
        layout, at,
    };
    if (!readAddress() && Object.values(how).every((value) => value === null)) {
        return;  // whatever is newest
    }
    for (const name of kLooks.filter((look) => how[look] !== null)) {
        address.searchParams.set(name, how[name]);
    }
    const wanted = address.href.replaceAll('%2C', ',');
    if (wanted !== location.href) {
        history.replaceState(null, '', wanted);
    }
}
