import { actOnSecondClick, byId, element } from '../page/element.js';
import * as format from '../page/format.js';
import { fieldOf, titleOf, valuesOf, worded, wordedProblem } from './job_fields.js';

/* global JOB_FORMS: the types of jobs and their fields, from openapi.yaml by build.mjs */
const kTitles = { pyramid: 'Pyramid', simplify: 'Simplify', evaluate: 'Compare', upsample: 'Add points', analyze: 'Analyse', curve: 'Curve' };
const kStarts = { pyramid: 'Build the pyramid', simplify: 'Simplify', evaluate: 'Measure the error', upsample: 'Add points', analyze: 'Analyse', curve: 'Measure the curve' };
const kMethods = JOB_FORMS.flatMap(({ fields }) => fields).find(({ name, choices }) => name === 'method' && choices.includes('random')).choices;
const kOwners = new RegExp(`^For ((?:all|${kMethods.join('|')})(?:(?:, | and | but )(?:${kMethods.join('|')}))*)[.,;:]? ?`);

/** Asked for first; the rest is folded away. */
const kFirst = {
    pyramid: ['method', 'levels', 'ratio', 'base_points', 'formats'],
    simplify: ['method', 'points', 'ratio', 'max_error'],
    evaluate: ['candidates', 'map', 'pictures'],
    upsample: ['points', 'ratio'],
    analyze: ['k', 'orient', 'feature_lines'],
    curve: ['method', 'count', 'points'],
};

/** What the page asks for where the contract leaves it open, or would make what it cannot show. */
const kPresets = { format: 'drc', map: ['drc'] };
const kPresetsOf = { simplify: { ratio: 0.1 }, upsample: { ratio: 4 } };

/** Only one of these makes sense: filling it in empties the others. */
const kOneOf = { simplify: ['points', 'ratio', 'max_error'], upsample: ['points', 'ratio'] };

/** Of a type of job: how many points there are to be, at most as many as in its cloud. More are no error, but cannot be had. */
const kCounts = { pyramid: ['levels', 'base_points'], simplify: ['points'], curve: ['points'] };

/** What the server calls the fields of which there has to be one. */
const kTarget = /^target: /;

const kLongestLabel = 50;  // characters, of up to 4 bytes: the server takes 200

/** The dialog that asks for the parameters of a job. */
export class JobForm {
    /**
     * @param onStart  told the type and the fields that were filled in; rejects where the server does, and the form stays
     * @param onRemove  told the cloud
     */
    constructor({ onStart, onRemove }) {
        this.marked = [];  // inputs of what is wrong
        byId['job-types'].replaceChildren(...JOB_FORMS.map(({ type }) => {
            const button = element('button', { type: 'button', textContent: kTitles[type] });
            button.dataset.type = type;
            button.onclick = () => this.choose(type);
            return button;
        }));
        byId['job-form'].oninput = ({ target }) => {
            this.emptyOthers(target);
            this.showFitting();
            this.tell(this.doubt());
        };
        byId['job-form'].onsubmit = (event) => {
            event.preventDefault();
            this.start(onStart);
        };
        byId['job-form'].addEventListener('invalid', ({ target }) => unfold(target), true);
        byId['job-close'].onclick = () => byId['job-dialog'].close();
        this.keep = actOnSecondClick(byId['job-remove'], () => {
            byId['job-dialog'].close();
            onRemove(this.subject.cloud);
        });
    }

    /** Its button stays enabled, so that it keeps the focus. */
    async start(onStart) {
        if (this.isStarting) {
            return;
        }
        this.isStarting = true;
        byId['job-start'].ariaBusy = 'true';
        this.tell('');
        try {
            const fields = this.named(valuesOf(this.fields, this.parts));
            if (this.form.type === 'evaluate' && !fields.candidates) {
                throw new Error('Choose at least one cloud to compare with.');
            }
            await onStart({ cloud: this.subject.cloud, type: this.form.type, fields });
            byId['job-dialog'].close();
            focusOn(byId.results.querySelector('[aria-current=true]'), byId.stage);
        } catch (error) {
            this.explain(error.message);
        }
        this.isStarting = false;
        byId['job-start'].ariaBusy = 'false';
    }

    /** Candidates are called as in the form, unless they were given other names. */
    named(fields) {
        const nameOf = (id) => this.subject.others.find((other) => other.id === id).name;
        return fields.candidates ? { labels: fields.candidates.map((id) => [...nameOf(id)].slice(0, kLongestLabel).join('')), ...fields } : fields;
    }

    emptyOthers({ name, value }) {
        const names = kOneOf[this.form.type] ?? [];
        if (names.includes(name) && value !== '') {
            names.filter((other) => other !== name).forEach((other) => { byId['job-form'].elements[other].value = ''; });
        }
    }

    /** What is asked for and cannot be had. */
    doubt() {
        const { points } = this.subject;
        const countsOf = (name) => {
            const part = this.parts[this.fields.findIndex((field) => field.name === name)];
            return part.row.hidden ? [] : [part.value()].flat();
        };
        for (const name of kCounts[this.form.type] ?? []) {
            const count = countsOf(name).find((asked) => asked > points);
            if (count) {
                return `${titleOf({ name })} ${format.count(count)}: the cloud has only ${format.points(points)}.`;
            }
        }
        return '';
    }

    /** Why a job was refused, at the field that the message begins with. */
    explain(message) {
        const { text, path } = wordedProblem(message.replace(kTarget, ''), this.fields);
        this.tell(text);
        if (kTarget.test(message)) {
            this.mark((kOneOf[this.form.type] ?? []).map((name) => byId['job-form'].elements[name]));
        } else if (path.length > 0) {
            const input = this.inputAt(path);
            this.mark([input]);
            unfold(input);
            input.focus();
        }
    }

    /** Of a field, or of the part of it that a path leads to. */
    inputAt(path) {
        const { row } = this.parts[this.fields.findIndex(({ name }) => name === path[0])];
        const inputs = [...row.querySelectorAll('input, select')];
        const named = inputs.filter(({ name }) => name === path.at(-1));
        return named[path.find((part) => /^\d+$/.test(part)) ?? 0] ?? named[0] ?? inputs[0] ?? row.querySelector('button');
    }

    mark(inputs) {
        this.marked.forEach((input) => { input.ariaInvalid = null; });
        inputs.forEach((input) => { input.ariaInvalid = 'true'; });
        this.marked = inputs;
    }

    tell(problem) {
        if (problem === '') {
            this.mark([]);
        }
        if (byId['job-problem'].textContent !== problem) {
            byId['job-problem'].textContent = problem;  // said aloud
        }
        byId['job-problem'].hidden = problem === '';
    }

    /**
     * @param subject  what the job is for: `{cloud, name, points, attributes, others, presets}`; `points`: where they are known; `others`: `{id, name}` of what it can be compared with,
     * `presets`: what fields of a type of job start with for it
     */
    open(subject) {
        if (byId['job-dialog'].open) {
            return;  // a double click
        }
        this.subject = subject;
        this.keep();  // what was asked of another cloud is not answered for this one
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
        byId['job-about'].textContent = worded(this.form.description);
        const context = { clouds: this.subject.others, attributes: this.subject.attributes };
        const presets = { ...kPresets, ...kPresetsOf[type], ...this.subject.presets[type] };
        this.fields = this.form.fields.map((field) => ({ ...field, about: field.description.replace(kOwners, '').trim(), preset: presets[field.name] }));
        this.parts = this.fields.map((field) => fieldOf(field, context));
        const isFirst = ({ name }) => kFirst[type].includes(name);
        const rows = (wanted) => this.parts.filter((_, i) => isFirst(this.fields[i]) === wanted).map(({ row }) => row);
        const order = (row) => kFirst[type].indexOf(this.fields[this.parts.findIndex((part) => part.row === row)].name);
        byId['job-fields'].replaceChildren(
            ...rows(true).sort((a, b) => order(a) - order(b)),
            element('details', { className: 'group more-fields' }, element('summary', { textContent: 'More' }), ...rows(false)));
        byId['job-fields'].scrollTop = 0;
        byId['job-start'].textContent = kStarts[type];
        this.tell('');
        this.showFitting();
    }

    /** Only the fields of the method that is chosen. What is not seen is not checked either. */
    showFitting() {
        const method = byId['job-form'].elements.method?.value;
        this.parts.forEach(({ row }, i) => {
            row.hidden = !isOf(method, this.fields[i].description);
            row.querySelectorAll('input, select').forEach((input) => { input.disabled = row.hidden; });
        });
    }
}

/** What is wrong is shown also where it was folded away. */
function unfold(input) {
    for (let fold = input.closest('details'); fold; fold = fold.parentElement.closest('details')) {
        fold.open = true;
    }
}

/** What the dialog was opened by may be gone by now. */
function focusOn(...parts) {
    for (const part of parts) {
        if (document.activeElement === document.body || byId['job-dialog'].contains(document.activeElement)) {
            part?.focus();
        }
    }
}

/** The contract says "For hierarchical and incremental, ..." of a field that only they have. */
function isOf(method, about) {
    const owners = kOwners.exec(about)?.[1].split(/, | and | but /);
    return !method || !owners || owners.includes(method) !== owners.includes('all');
}
