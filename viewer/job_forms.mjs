// What a job can be asked for, from the contract: the fields of each type of job, for the form in the page.
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';

const kTypes = {
    pyramid: 'PyramidRequest', simplify: 'SimplifyRequest', evaluate: 'EvaluateRequest', upsample: 'UpsampleRequest', analyze: 'AnalyzeRequest',
    curve: 'CurveRequest',
};
const kGiven = ['type', 'input', 'reference', 'candidate'];  // by the page itself; what is one candidate is one of `candidates`

/**
 * @returns {{type, description, fields}[]} a field has `name`, `kind`, `description`, limits and `default`. Kinds: `choice`, `integer`, `number`,
 * `quantity`, `boolean`, `text`; `choices`: some of several; `clouds`: some of those that are there; `list` of `integer`, `number` or `text`
 * (`of`); `map`: of an attribute's name to a choice or a number (`of`, a field); `group` of `fields`; `groups`: any number of such.
 */
export function jobForms(contract, modules) {
    const { parse } = createRequire(join(modules, 'package.json'))('yaml');
    const { schemas } = parse(readFileSync(contract, 'utf8')).components;
    const resolved = ({ $ref, ...rest }) => ($ref ? { isHash: $ref.endsWith('/Sha256'), ...resolved(schemas[$ref.split('/').at(-1)]), ...rest } : rest);

    /** The fields of an object. */
    function fieldsOf({ properties, required = [] }) {
        return Object.entries(properties)
            .filter(([name]) => !kGiven.includes(name))
            .map(([name, schema]) => ({ ...fieldFrom(name, resolved(schema)), required: required.includes(name) || undefined }));
    }

    function fieldFrom(name, schema) {
        const { description = '', default: standard, minimum, maximum, exclusiveMinimum, exclusiveMaximum, minItems, maxItems } = schema;
        return {
            name, ...kindOf(name, schema), description: description.replaceAll('`', '').replaceAll('\n', ' ').trim(),
            default: standard, minimum, maximum, exclusiveMinimum, exclusiveMaximum, minItems, maxItems,
        };
    }

    function kindOf(name, { enum: choices, type, items, oneOf, properties, additionalProperties }) {
        if (choices) {
            return { kind: 'choice', choices };
        }
        if (oneOf?.map((option) => option.type).join() === 'number,string') {
            return { kind: 'quantity' };
        }
        if (type === 'array') {
            return kindOfArray(name, resolved(items));
        }
        if (type === 'object') {
            return properties ? { kind: 'group', fields: fieldsOf({ properties }) }
                : { kind: 'map', of: fieldFrom('value', resolved(additionalProperties)) };
        }
        const kind = { integer: 'integer', number: 'number', boolean: 'boolean', string: 'text' }[type];
        if (!kind) {
            throw new Error(`the form has no way to ask for ${name}`);
        }
        return { kind };
    }

    function kindOfArray(name, items) {
        if (items.enum) {
            return { kind: 'choices', choices: items.enum };
        }
        if (items.isHash) {
            return { kind: 'clouds' };
        }
        if (items.properties) {
            return { kind: 'groups', fields: fieldsOf(items) };
        }
        return { kind: 'list', of: kindOf(name, items).kind };
    }

    return Object.entries(kTypes).map(([type, name]) => ({
        type, description: schemas[name].description.replaceAll('\n', ' '), fields: fieldsOf(schemas[name]),
    }));
}
