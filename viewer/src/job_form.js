import { byId, element } from './element.js';

/* global JOB_FORMS: the types of jobs and their fields, from openapi.yaml by build.mjs */
const kTitles = { pyramid: 'Build a pyramid', simplify: 'Simplify', upsample: 'Add points', analyze: 'Analyse' };
const kMethods = JOB_FORMS.flatMap(({ fields }) => fields).find(({ name, choices }) => name === 'method' && choices.includes('random')).choices;
const kOwners = new RegExp(`^Of ((?:all|${kMethods.join('|')})(?:(?:, | and | but )(?:${kMethods.join('|')}))*)[.,;]? ?`);
const kStarts = { pyramid: 'Build', simplify: 'Simplify', upsample: 'Add points', analyze: 'Analyse' };

/** The dialog that asks for the parameters of a job. */
export class JobForm {
    /** @param onStart  told the type and the fields that were filled in; rejects where the server does, and the form stays */
    constructor({ onStart }) {
        byId['job-types'].replaceChildren(...JOB_FORMS.map(({ type }) => {
            const button = element('button', { type: 'button', textContent: kTitles[type] });
            button.dataset.type = type;
            button.onclick = () => this.choose(type);
            return button;
        }));
        byId['job-form'].oninput = () => this.showFitting();
        byId['job-form'].onsubmit = (event) => {
            event.preventDefault();
            this.start(onStart);
        };
        byId['job-close'].onclick = () => byId['job-dialog'].close();
    }

    async start(onStart) {
        byId['job-start'].disabled = true;
        this.tell('');
        try {
            await onStart({ ...this.subject, type: this.form.type, fields: this.values() });
            byId['job-dialog'].close();
        } catch (error) {
            this.tell(error.message);
        }
        byId['job-start'].disabled = false;
    }

    tell(problem) {
        byId['job-problem'].textContent = problem;
        byId['job-problem'].hidden = problem === '';
    }

    /** @param subject  what the job is for: `{cloud, name}` */
    open(subject) {
        this.subject = subject;
        byId['job-title'].textContent = subject.name;
        byId['job-title'].title = subject.name;
        this.choose(this.form?.type ?? 'pyramid');
        byId['job-dialog'].showModal();
    }

    choose(type) {
        this.form = JOB_FORMS.find((form) => form.type === type);
        for (const button of byId['job-types'].children) {
            button.ariaPressed = String(button.dataset.type === type);
        }
        byId['job-about'].textContent = this.form.description.replaceAll('`', '');
        byId['job-fields'].replaceChildren(...this.form.fields.map(rowOf));
        byId['job-start'].textContent = kStarts[type];
        this.tell('');
        this.showFitting();
    }

    /** Only the fields of the method that is chosen. */
    showFitting() {
        const method = byId['job-form'].elements.method?.value;
        for (const row of byId['job-fields'].children) {
            row.hidden = !isOf(method, row.dataset.about);
        }
    }

    /** What was filled in and belongs to the method; the rest is left to the server. */
    values() {
        const entries = this.form.fields
            .map((field) => [field, byId['job-form'].elements[field.name]])
            .filter(([, input]) => !input.closest('.field').hidden)
            .map(([field, input]) => [field.name, valueOf(field, input)]);
        return Object.fromEntries(entries.filter(([, value]) => value !== undefined));
    }
}

/** The contract says "Of hierarchical and incremental, ..." of a field that only they have. */
function isOf(method, about) {
    const owners = kOwners.exec(about)?.[1].split(/, | and | but /);
    return !method || !owners || owners.includes(method) !== owners.includes('all');
}

function rowOf(field) {
    const row = element('label', { className: 'field' },
        element('span', { className: 'field-name', textContent: field.name.replaceAll('_', ' ') }),
        inputOf(field),
        element('span', { className: 'field-about', textContent: field.description.replace(kOwners, '').trim() }));
    row.dataset.about = field.description;
    return row;
}

function inputOf({ name, kind, choices, default: standard, minimum, maximum, exclusiveMinimum }) {
    if (kind === 'choice') {
        const select = element('select', { name }, ...choices.map((value) => element('option', { value, textContent: value })));
        select.value = standard ?? choices[0];
        return select;
    }
    if (kind === 'boolean') {
        return element('input', { name, type: 'checkbox', checked: standard === true });
    }
    if (kind === 'integers') {
        return element('input', { name, type: 'text', placeholder: '1000, 10000, …', pattern: ' *\\d+( *, *\\d+)* *', inputMode: 'numeric' });
    }
    if (kind === 'quantity') {
        return element('input', { name, type: 'text', placeholder: '0.05 or 0.1%', pattern: ' *[\\d.eE+\\-]+ *%? *' });
    }
    return element('input', {
        name, type: 'number', step: kind === 'integer' ? '1' : 'any', placeholder: standard ?? '',
        min: minimum ?? exclusiveMinimum ?? '', max: maximum ?? '',
    });
}

function valueOf({ kind, default: standard }, input) {
    if (kind === 'boolean') {
        return input.checked === (standard === true) ? undefined : input.checked;
    }
    if (input.value.trim() === '' || input.value === standard) {
        return undefined;
    }
    const text = input.value.replaceAll(' ', '');
    switch (kind) {
        case 'choice': return text;
        case 'integers': return text.split(',').map(Number);
        case 'quantity': return text.endsWith('%') ? text : Number(text);
        default: return Number(text);
    }
}
