// Numbers as people read them, and what files are called.

/** By their formats, of whole levels; tiles are for other viewers. */
export const kKinds = { drc: 'Draco', ply: 'PLY', stpc: 'stream', 'copc.laz': 'COPC', png: 'picture' };

const kCounts = new Intl.NumberFormat('en');
const kCompact = new Intl.NumberFormat('en', { notation: 'compact', maximumSignificantDigits: 3 });

export const count = (n) => kCounts.format(n);
/** 134.3K is 134K: for places too narrow for every digit. */
export const compactCount = (n) => (n < 10_000 ? count(n) : kCompact.format(n));
export const compactPoints = (n) => `${compactCount(n)} ${n === 1 ? 'point' : 'points'}`;
/** `312K of 2M`; where both look alike, and of all or more, one number. */
export const compactShare = (part, all) => [...new Set([part, all].map(compactCount))].join(' of ');
/** The same, and all as one number with every digit. */
export const share = (part, all) => (part >= all ? count(part) : compactShare(part, all));
export const points = (n) => `${count(n)} ${n === 1 ? 'point' : 'points'}`;

export function bytes(n) {
    const units = ['B', 'kB', 'MB', 'GB', 'TB'];
    let unit = 0;
    while (n >= 999.5 && unit < units.length - 1) {
        n /= 1000;
        unit += 1;
    }
    return `${unit === 0 || n >= 99.95 ? Math.round(n) : n.toFixed(1)}\u00a0${units[unit]}`;
}

const kTiny = 1e-5;
const kHuge = 1e13;
const withMinus = (text) => text.replaceAll('-', '\u2212');

/** `12.3 of 62.0 MB` */
export function bytesOf(part, all) {
    const [[n, unit], whole] = [bytes(part).split('\u00a0'), bytes(all)];
    return whole.endsWith(`\u00a0${unit}`) ? `${n} of ${whole}` : `${n}\u00a0${unit} of ${whole}`;
}

/** With three significant digits, and a minus sign as wide as a digit. */
export const quantity = (x) => withMinus(x === 0 || (Math.abs(x) >= 1e-4 && Math.abs(x) < 1e6)
    ? x.toLocaleString('en', { maximumSignificantDigits: 3 }) : x.toExponential(1));
/** Coordinates in a cloud of a size: to a ten thousandth of that. */
export function place(coordinates, size) {
    const decimals = Math.min(12, Math.max(0, 4 - Math.floor(Math.log10(size))));
    return coordinates.map((x) => withMinus(x.toLocaleString('en', { minimumFractionDigits: decimals, maximumFractionDigits: decimals }))).join('  ');
}

/**
 * A value by itself: a whole number with all its digits, others with those that single precision has, or double.
 * @param step  between the values that were told apart: of 1 and more, a value has only the digits that this leaves
 */
export function value(x, step = 0) {
    const size = Math.abs(x);
    if (isRounded(step)) {
        const digits = Math.max(1, Math.floor(Math.log10(Math.max(size, 1))) - placeOf(step) + 1);
        return `\u2248\u00a0${withMinus(size >= kHuge ? x.toExponential(Math.min(2, digits - 1)) : x.toLocaleString('en', { maximumSignificantDigits: digits }))}`;
    }
    if (x !== 0 && (size < kTiny || size >= kHuge)) {
        return withMinus(x.toExponential(2));
    }
    const digits = Math.fround(x) === x ? 7 : 15;
    return withMinus(x.toLocaleString('en', Number.isInteger(x) ? {} : { maximumSignificantDigits: digits }));
}

/** Whether whole numbers are rounded, too: that is told. */
export const isRounded = (step) => step >= 1;

/** The last place of a number that such a step leaves, as a power of ten. */
const placeOf = (step) => (step > 0 ? Math.ceil(Math.log10(step / 2)) : -Infinity);

/** The ends of a range: both in one notation, with as many digits as tell one from the other, and no more than a `step` leaves. */
export function ends(low, high, step = 0) {
    const [largest, length] = [Math.max(Math.abs(low), Math.abs(high)), high - low];
    if (!(length > 0)) {
        return [low, high].map((x) => value(x, step));
    }
    const last = Math.max(placeOf(step), Math.floor(Math.log10(length)) - 2);  // three digits of the difference
    if (largest < kTiny || largest >= kHuge) {
        const digits = Math.min(15, Math.max(0, Math.floor(Math.log10(largest)) - last));
        return [low, high].map((x) => withMinus(x === 0 ? '0' : x.toExponential(digits)));
    }
    const decimals = Math.min(12, Math.max(0, -last));
    const unit = 10 ** Math.max(0, placeOf(step));
    const rounded = (x) => (unit > 1 ? unit * Math.round(x / unit) : x);
    return [low, high].map((x) => withMinus(rounded(x).toLocaleString('en', { maximumFractionDigits: decimals })).replace(/^\u2212(?=[0.]+$)/, ''));
}

export const percent = (share) => `${quantity(100 * share)}\u00a0%`;

export const milliseconds = (ms) => (ms < 9_950 ? `${Math.round(ms)} ms` : `${(ms / 1000).toFixed(1)} s`);

export function duration(seconds) {
    const [n, unit] = seconds < 59.5 ? [seconds, 's'] : seconds < 3570 ? [seconds / 60, 'min'] : [seconds / 3600, 'h'];
    return `${Math.max(1, Math.round(n))} ${unit}`;
}

export function ago(time, now = Date.now()) {
    const seconds = (now - Date.parse(time)) / 1000;
    if (!(seconds >= 45)) {
        return 'just now';
    }
    const relative = new Intl.RelativeTimeFormat('en', { numeric: 'auto' });
    for (const [unit, size] of [['day', 86_400], ['hour', 3_600], ['minute', 60]]) {
        if (seconds >= size) {
            return relative.format(-Math.floor(seconds / size), unit);
        }
    }
    return relative.format(-1, 'minute');
}
