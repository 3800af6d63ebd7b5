// What a job can be asked for, from the contract: the fields of each type of job, for the form in the page.
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';

const kTypes = { pyramid: 'PyramidRequest', simplify: 'SimplifyRequest', upsample: 'UpsampleRequest', analyze: 'AnalyzeRequest' };
const kGiven = ['type', 'input', 'format', 'formats'];  // by the page itself

/** @returns {{type, description, fields}[]} a field has `name`, `kind` (choice, integer, number, quantity, boolean, integers), `description`, limits and `default` */
export function jobForms(contract, modules) {
    const { parse } = createRequire(join(modules, 'package.json'))('yaml');
    const { schemas } = parse(readFileSync(contract, 'utf8')).components;
    const resolved = ({ $ref, ...rest }) => ($ref ? { ...resolved(schemas[$ref.split('/').at(-1)]), ...rest } : rest);
    return Object.entries(kTypes).map(([type, name]) => ({
        type,
        description: schemas[name].description,
        fields: Object.entries(schemas[name].properties)
            .filter(([field]) => !kGiven.includes(field))
            .map(([field, schema]) => fieldFrom(field, resolved(schema)))
            .filter(Boolean),
    }));
}

/** Null for what a form of single values cannot hold: that is left to the API. */
function fieldFrom(name, schema) {
    const kind = kindOf(schema);
    if (!kind) {
        return null;
    }
    const { description = '', enum: choices, default: standard, minimum, maximum, exclusiveMinimum, exclusiveMaximum } = schema;
    return { name, kind, description: description.replaceAll('`', '').trim(), choices, default: standard, minimum, maximum, exclusiveMinimum, exclusiveMaximum };
}

function kindOf({ enum: choices, type, items, oneOf }) {
    if (choices) {
        return 'choice';
    }
    if (oneOf?.map((option) => option.type).join() === 'number,string') {
        return 'quantity';
    }
    if (['integer', 'number', 'boolean'].includes(type)) {
        return type;
    }
    return type === 'array' && items.type === 'integer' ? 'integers' : null;
}
