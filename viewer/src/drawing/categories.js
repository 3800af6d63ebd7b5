// Whole numbers that name what a point belongs to: classes of a survey, returns of a pulse, labels. Each has a colour of its own, the same in all levels.

const kMost = 12;

/** The classes of the ASPRS LAS specification, 1.4, with colours as maps have them. */
const kClasses = [
    ['Never classified', '#8f96a0'], ['Unclassified', '#b9bec6'], ['Ground', '#b5885a'], ['Low vegetation', '#a9cf6b'],
    ['Medium vegetation', '#5fae4a'], ['High vegetation', '#2c7f3f'], ['Building', '#dd6a48'], ['Low noise', '#d94fc0'],
    ['Model key point', '#f4d35e'], ['Water', '#3f8fd9'], ['Rail', '#8d6fd1'], ['Road', '#6f7682'],
    ['Overlap', '#d9c9a3'], ['Wire guard', '#e8b04a'], ['Wire conductor', '#f2e24b'], ['Transmission tower', '#c9a227'],
    ['Wire connector', '#e0cf7a'], ['Bridge deck', '#a4553a'], ['High noise', '#f07fd8'], ['Overhead structure', '#c78fd6'],
    ['Ignored ground', '#8a6a4b'], ['Snow', '#eaf4ff'], ['Temporal exclusion', '#5b616b'],
];
const kColors = ['#4e9bd9', '#f2933c', '#5fb85f', '#e0605e', '#a685d6', '#a5745f', '#e78ac8', '#9aa0a8', '#c6c244', '#3fc1c9', '#f0c27b', '#7f9c3b'];

const kShades = [[255, 0], [255, 0.45], [0, 0.35]];  // of each colour: itself, lighter and darker, so that 1 and 13 are told apart

/** What scans have their classes under. */
const isClassification = (name) => /^(scalar_)?class(ification)?$/i.test(name);

/**
 * What there is of few whole numbers: `values`, ascending, `nameOf` and `colorOf` each; null where numbers are not names.
 * @param values  of all points, since few of them may have what matters most
 */
export function categoriesOf(attribute, values) {
    const found = new Set();
    const isAsprs = isClassification(attribute);
    const most = kMost + (isAsprs ? kClasses.length : 0);
    for (const value of values) {
        found.add(value);
        if (found.size > most || !Number.isInteger(value)) {
            return null;
        }
    }
    if (found.size === 0) {
        return null;
    }
    return {
        values: [...found].sort((a, b) => a - b),
        nameOf: (value) => (isAsprs && kClasses[value]?.[0]) || value.toLocaleString('en').replaceAll('-', '\u2212'),
        colorOf: (value) => (isAsprs && kClasses[value]?.[1]) || colorOfNumber(value),
    };
}

/** By the number itself, which does not depend on what else there is, here or in another level. */
function colorOfNumber(value) {
    const all = kShades.length * kColors.length;
    const number = ((Math.round(value) % all) + all) % all;
    const [mixed, share] = kShades[Math.floor(number / kColors.length)];
    const channels = kColors[number % kColors.length].match(/[\da-f]{2}/g).map((digits) => parseInt(digits, 16));
    return `#${channels.map((channel) => Math.round(channel + share * (mixed - channel)).toString(16).padStart(2, '0')).join('')}`;
}
