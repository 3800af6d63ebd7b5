// PLY files as our server writes them: binary, little endian, all attributes with the points.

const kTypes = {
    char: [1, 'Int8'], uchar: [1, 'Uint8'], short: [2, 'Int16'], ushort: [2, 'Uint16'], int: [4, 'Int32'], uint: [4, 'Uint32'],
    float: [4, 'Float32'], double: [8, 'Float64'],
};
const kWide = ['int', 'uint', 'double'];  // of which single precision does not hold all values
const kNames = { int8: 'char', uint8: 'uchar', int16: 'short', uint16: 'ushort', int32: 'int', uint32: 'uint', float32: 'float', float64: 'double' };
const kPositions = ['x', 'y', 'z'];
const kNormals = ['nx', 'ny', 'nz'];
const kColors = ['red', 'green', 'blue', 'alpha'];
const kEnd = 'end_header\n';
const kLongestHeader = 65_536;

/**
 * The points of a file.
 * @returns positions (doubles where the file has them) and unit normals as floats, colours as 4 bytes each, sRGB, or null; `attributes`: by name, `{values, components}`, each value as it is in the file
 */
export function readPly(buffer) {
    const { count, properties, start } = readHeader(buffer);
    const view = new DataView(buffer, start);
    let stride = 0;
    for (const property of properties) {
        const [size, kind] = kTypes[property.countType] ?? [0];
        property.at = stride + size;
        property.components = kind ? view[`get${kind}`](stride, true) : 1;  // as many for every point
        stride = property.at + property.components * kTypes[property.type][0];
    }
    if (view.byteLength < count * stride) {
        throw new Error('the file ends before its points do');
    }
    const columns = (names, Values) => {
        const found = names.map((wanted) => properties.find(({ name }) => name === wanted)).filter(Boolean);
        const components = found.reduce((sum, property) => sum + property.components, 0);
        const values = new Values(count * components);
        let k = 0;
        for (const { type, at, components: each } of found) {
            const [size, kind] = kTypes[type];
            const get = view[`get${kind}`].bind(view);
            for (let c = 0; c < each; c += 1, k += 1) {
                for (let i = 0; i < count; i += 1) {
                    values[components * i + k] = get(i * stride + at + c * size, true);
                }
            }
        }
        return { values, components };
    };
    const isDouble = properties.find(({ name }) => name === 'x').type === 'double';
    const has = (names) => names.every((wanted) => properties.some(({ name }) => name === wanted));
    const others = properties.filter(({ name }) => ![...kPositions, ...kNormals, ...kColors].includes(name));
    return {
        positions: columns(kPositions, isDouble ? Float64Array : Float32Array).values,
        normals: has(kNormals) ? columns(kNormals, Float32Array).values : null,
        colors: has(kColors.slice(0, 3)) ? withAlpha(columns(kColors, Uint8Array)) : null,
        attributes: Object.fromEntries(others.map(({ name, type }) => [name, columns([name], kWide.includes(type) ? Float64Array : Float32Array)])),
    };
}

function withAlpha({ values, components }) {
    if (components === 4) {
        return values;
    }
    const array = new Uint8Array(values.length / 3 * 4).fill(255);
    for (let i = 0; i < values.length; i += 1) {
        array[4 * Math.floor(i / 3) + i % 3] = values[i];
    }
    return array;
}

function readHeader(buffer) {
    const text = new TextDecoder('latin1').decode(new Uint8Array(buffer, 0, Math.min(buffer.byteLength, kLongestHeader)));
    const end = text.indexOf(kEnd);
    if (!text.startsWith('ply\n') || !text.includes('\nformat binary_little_endian 1.0\n') || end < 0) {
        throw new Error('this is not a PLY file as stipple writes them');
    }
    const [, count, lines] = /\nelement vertex (\d+)\n((?:property .*\n)*)/.exec(text);
    const typeOf = (word) => kNames[word] ?? word;
    const properties = lines.trim().split('\n').map((line) => line.split(' ')).map((words) => ({
        countType: words[1] === 'list' ? typeOf(words[2]) : null, type: typeOf(words.at(-2)), name: words.at(-1),
    }));
    return { count: Number(count), properties, start: end + kEnd.length };
}

/**
 * A file with the first `count` points of arrays that may be longer.
 * @param origin  is added to the positions, which become doubles unless it is 0
 * @param attributes  `{name, type, components, values}`, types as in openapi.yaml
 */
export function plyOf({ count, origin, positions, normals, colors, colorComponents = 4, attributes }) {
    const position = origin.every((x) => x === 0) ? 'float' : 'double';
    const columns = [
        ...kPositions.map((name, k) => ({ name, type: position, at: (i) => positions[3 * i + k] + origin[k] })),
        ...(normals ? kNormals.map((name, k) => ({ name, type: 'float', at: (i) => normals[3 * i + k] })) : []),
        ...(colors ? kColors.slice(0, colorComponents).map((name, k) => ({ name, type: 'uchar', at: (i) => colors[colorComponents * i + k] })) : []),
    ];
    for (const { name, type, components, values } of attributes) {
        if (components > 1) {
            columns.push({ list: `property list uchar ${kNames[type]} ${name}`, type: 'uchar', at: () => components });
        }
        for (let k = 0; k < components; k += 1) {
            columns.push({ name: components > 1 ? null : name, type: kNames[type], at: (i) => values[components * i + k] });
        }
    }
    const header = ['ply', 'format binary_little_endian 1.0', `element vertex ${count}`,
        ...columns.map(({ list, name, type }) => list ?? (name && `property ${type} ${name}`)).filter(Boolean), kEnd].join('\n');
    const stride = columns.reduce((sum, { type }) => sum + kTypes[type][0], 0);
    const bytes = new Uint8Array(header.length + count * stride);
    bytes.set(new TextEncoder().encode(header));
    const view = new DataView(bytes.buffer, header.length);
    let at = 0;
    for (const { type, at: valueOf } of columns) {
        const [size, kind] = kTypes[type];
        const set = view[`set${kind}`].bind(view);
        for (let i = 0; i < count; i += 1) {
            set(i * stride + at, valueOf(i), true);
        }
        at += size;
    }
    return bytes;
}
