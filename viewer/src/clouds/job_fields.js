// Fields of the form of jobs, each by its kind; job_forms.mjs says which there are.
import { element } from '../page/element.js';

const kSeparator = /\s*,\s*/;
const kUnknownNames = 'name: value, …';
/** As the server reads it: finite, too. */
const kNumber = '[+\\-]?(\\d+\\.?\\d*|\\.\\d+)([eE][+\\-]?\\d{1,2})?';

/**
 * A field: `row`, which goes into the form, and `value()`: what was filled in, or undefined where that is nothing, or what the server does anyway.
 * @param field  see job_forms.mjs; `preset`: what it starts with, where that is not its default
 * @param context  `clouds`: `{id, name}` of those that can be chosen, `attributes`: names of those of the cloud
 */
export function fieldOf(field, context) {
    switch (field.kind) {
        case 'group': return groupOf(field, context);
        case 'groups': return groupsOf(field, context);
        case 'choices': return choicesOf(field, field.choices.map((value) => ({ value, text: value })));
        case 'clouds': return choicesOf(field, context.clouds.map(({ id, name }) => ({ value: id, text: name })), 'Nothing to choose yet: add a cloud, or simplify this one.');
        default: return singleOf(field, context);
    }
}

const kTitles = { k: 'neighbours (k)', epsg: 'EPSG code' };

export const titleOf = ({ name }) => kTitles[name] ?? name.replaceAll('_', ' ');

/** What the form has no need to say: it shows no field of another method, and only one for candidates. */
const kOfContract = / ?(?:A field of another method is refused[^.]*|Give either `candidate` or `candidates`)\./;

const kWireName = /\b[a-z]+(?:_[a-z]+)+\b/g;

/** A description of the API in the words of the form. */
export const worded = (text) => text.replace(kOfContract, '').replace(/`(\w+)`|\b([a-z]+(?:_[a-z]+)+)\b/g, (_, quoted, plain) => titleOf({ name: quoted ?? plain }));

/** What a message of the server begins with: a field, or a part of one, as in `tiles.max_points: -3: expected` and `max_error -1: expected`. */
const kPlace = /^[a-z]\w*(?:\[\d+\]|\.\w+)*(?=(?: \S+)?: )/;

/**
 * A message of the server in the words of a form with these fields: its `text`, and `path`: the name of the field that it begins with and what
 * leads on from there to a part of it, a name or a number each; empty where it begins with none.
 */
export function wordedProblem(message, fields) {
    const [place = ''] = kPlace.exec(message) ?? [];
    const path = place.match(/\w+/g) ?? [];
    const known = namesOf(fields);
    const titled = (name) => (known.includes(name) ? titleOf({ name }) : name);
    if (!fields.some(({ name }) => name === path[0])) {
        return { text: message.replace(kWireName, titled), path: [] };
    }
    const where = place.replace(/s?\[(\d+)\]/g, (_, i) => ` ${Number(i) + 1}`).replaceAll('.', ', ').replace(/\w+/g, titled);
    return { text: where + message.slice(place.length).replace(kWireName, titled), path };
}

/** Also of the fields inside them. */
const namesOf = (fields) => fields.flatMap(({ name, fields: inner = [] }) => [name, ...namesOf(inner)]);

function singleOf(field, context) {
    const input = inputOf(field, context);
    const row = element('label', { className: 'field' }, nameOf(field), input, aboutOf(field));
    return { row, value: () => valueOf(field, input) };
}

/** Some of several: a box to tick for each. */
function choicesOf(field, options, none = '') {
    const start = field.preset ?? field.default ?? [];
    const boxes = options.map(({ value, text }) => {
        const box = element('input', { type: 'checkbox', name: field.name, value, checked: start.includes(value) });
        return element('label', { className: 'chip' }, box, text);
    });
    const row = element('fieldset', { className: 'field choices' },
        element('legend', { className: 'field-name', textContent: titleOf(field) }),
        element('div', { className: 'chips', textContent: options.length > 0 ? '' : none }), aboutOf(field));
    row.querySelector('.chips').append(...boxes);
    return {
        row,
        value() {
            const values = boxes.map((label) => label.firstChild).filter(({ checked }) => checked).map(({ value }) => value);
            return sameSet(values, field.default ?? []) ? undefined : values;
        },
    };
}

const sameSet = (a, b) => a.length === b.length && a.every((value) => b.includes(value));

/** Fields that belong together, folded. An object that is asked for by its presence alone has a box to tick. */
function groupOf(field, context, { isOpen = false } = {}) {
    const fields = field.fields.map((part) => fieldOf({ ...part, preset: field.preset?.[part.name] }, context));
    const row = element('details', { className: 'group', open: isOpen },
        element('summary', {}, nameOf(field)), aboutOf(field), ...fields.map((part) => part.row));
    const present = /^If present/.test(field.description) ? element('input', { type: 'checkbox', name: field.name, ariaLabel: titleOf(field) }) : null;
    if (present) {
        row.querySelector('summary').append(present);
    }
    return {
        row,
        value() {
            const values = valuesOf(field.fields, fields);
            return present?.checked || Object.keys(values).length > 0 ? values : undefined;
        },
    };
}

/** Any number of objects. */
function groupsOf(field, context) {
    const groups = [];
    const single = titleOf(field).replace(/s$/, '');
    const add = element('button', { type: 'button', className: 'action', textContent: `Add a ${single}` });
    const row = element('fieldset', { className: 'field choices' },
        element('legend', { className: 'field-name', textContent: titleOf(field) }), element('div', { className: 'groups' }), add, aboutOf(field));
    add.onclick = () => {
        const group = groupOf({ ...field, name: `${single} ${groups.length + 1}`, description: '' }, context, { isOpen: true });
        const remove = element('button', { type: 'button', className: 'action', textContent: 'Remove' });
        remove.onclick = () => {
            groups.splice(groups.indexOf(group), 1);
            group.row.remove();
        };
        group.row.append(remove);
        groups.push(group);
        row.querySelector('.groups').append(group.row);
    };
    return {
        row,
        value() {
            const values = groups.map((group) => group.value()).filter(Boolean);
            return values.length > 0 ? values : undefined;
        },
    };
}

export const valuesOf = (fields, parts) => Object.fromEntries(
    fields.map(({ name }, i) => [name, parts[i].row.hidden ? undefined : parts[i].value()]).filter(([, value]) => value !== undefined));

const nameOf = (field) => element('span', { className: 'field-name', textContent: titleOf(field) });

const aboutOf = ({ about, description }) => element('span', { className: 'field-about', textContent: worded(about ?? description) });

function inputOf(field, { attributes }) {
    const { name, kind, choices, preset, default: standard, minimum, maximum, exclusiveMinimum, exclusiveMaximum } = field;
    const text = (placeholder, pattern, more = {}) => element('input', { name, type: 'text', placeholder, ...(pattern ? { pattern } : {}), ...more });
    switch (kind) {
        case 'choice': {
            const select = element('select', { name }, ...choices.map((value) => element('option', { value, textContent: value })));
            select.value = preset ?? standard ?? choices[0];
            return select;
        }
        case 'boolean': return element('input', { name, type: 'checkbox', checked: (preset ?? standard) === true });
        case 'quantity': return text('0.05 or 0.1%', ` *${kNumber} *%? *`);
        case 'text': return text('');
        case 'list': return listInput(field, text);
        case 'map': return mapInput(field, attributes, text);
        default: return element('input', {
            name, type: 'number', step: kind === 'integer' ? '1' : 'any', placeholder: standard ?? '', value: preset ?? '',
            min: minimum ?? exclusiveMinimum ?? '', max: maximum ?? exclusiveMaximum ?? '',
        });
    }
}

/** A word or a number for each of some attributes. */
function mapInput({ of }, attributes, text) {
    const [example, value] = of.kind === 'choice' ? [of.choices.at(-1), of.choices.join('|')] : ['0.5', kNumber];
    const pair = ` *[^:,]+: *(${value}) *`;
    return text(attributes?.length > 0 ? attributes.map((attribute) => `${attribute}: ${example}`).join(', ') : kUnknownNames, `${pair}(,${pair})*`);
}

/** Numbers or words, with commas between; as many as are asked for. */
function listInput({ of, minItems = 1, maxItems = '' }, text) {
    if (of === 'text') {
        return text('one, another, …');
    }
    const number = of === 'integer' ? '\\d+' : kNumber;
    const isFixed = minItems === maxItems;
    return text(isFixed ? `${minItems} numbers, separated by commas` : of === 'integer' ? '1000, 10000, …' : '0.1, 0.2, …',
        ` *${number}( *, *${number}){${minItems - 1},${maxItems === '' ? '' : maxItems - 1}} *`, { inputMode: isFixed ? 'text' : 'numeric' });
}

function valueOf(field, input) {
    const { kind, default: standard } = field;
    if (kind === 'boolean') {
        return input.checked === (standard === true) ? undefined : input.checked;
    }
    const text = input.value.trim();
    if (text === '' || text === standard) {
        return undefined;
    }
    switch (kind) {
        case 'choice': case 'text': return text;
        case 'quantity': return text.endsWith('%') ? text.replaceAll(' ', '') : Number(text);
        case 'list': return text.split(kSeparator).filter((part) => part !== '').map((part) => (field.of === 'text' ? part : Number(part)));
        case 'map': return Object.fromEntries(text.split(kSeparator).map((pair) => pair.split(/\s*:\s*/))
            .map(([name, value]) => [name, field.of.kind === 'choice' ? value : Number(value)]));
        default: return Number(text) === standard ? undefined : Number(text);
    }
}
