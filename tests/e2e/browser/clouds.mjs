// Clouds with known looks, as PLY files.

/** A torus in three colours, a third of the way round each: red, green, blue. It lies along z, so that it is seen from above. */
export function coloredTorusPoints(count) {
    const points = [];
    for (let i = 0; i < count; i += 1) {
        const around = 2 * Math.PI * (i + 0.5) / count;
        const across = 2 * Math.PI * ((i * 0.6180339887498949) % 1);
        const ring = 1 + 0.4 * Math.cos(across);
        const color = [[220, 40, 40], [40, 190, 60], [50, 80, 230]][Math.floor(3 * i / count)];
        points.push([ring * Math.cos(around), ring * Math.sin(around), 0.4 * Math.sin(across), ...color]);
    }
    return points;
}

/** Evenly spread over the unit sphere (Fibonacci). */
export function spherePoints(count) {
    return Array.from({ length: count }, (_, i) => {
        const z = 1 - 2 * (i + 0.5) / count;
        const radius = Math.sqrt(1 - z * z);
        const angle = i * Math.PI * (3 - Math.sqrt(5));
        return [radius * Math.cos(angle), radius * Math.sin(angle), z];
    });
}

/** With a scalar, `height`, that is z. */
export const coloredTorus = (count) => ply(coloredTorusPoints(count), true, { scalars: { height: ([, , z]) => z } });
export const sphere = (count) => ply(spherePoints(count), false);
export const waves = (side) => ply(Array.from({ length: side * side }, (_, i) => {
    const x = 10 * ((i % side) + 0.5) / side, y = 10 * (Math.floor(i / side) + 0.5) / side;
    return [x, y, 0.5 * Math.sin(x / 0.9) * Math.cos(y / 0.7)];
}), false);
export const line = (count) => ply(Array.from({ length: count }, (_, i) => [i / count, 0, 0]), false);
export const onePoint = () => ply([[1, 2, 3]], false);

/** A header that promises more than follows. */
export const truncated = () => sphere(1000).subarray(0, 4000);

/** A value that is no number, which only who reads the points finds. */
export const broken = () => Buffer.from(['ply', 'format ascii 1.0', 'element vertex 2',
    ...['x', 'y', 'z'].map((name) => `property float ${name}`), 'end_header', '0 0 0', '1 two 3', ''].join('\n'));

/**
 * @param points  `[x, y, z]`, and `red, green, blue` where `isColored`, and `alpha` where `hasAlpha`
 * @param scalars  by name, of a point
 * @param type  of coordinates and scalars: `float` or `double`
 */
export function ply(points, isColored, { hasAlpha = false, scalars = {}, type = 'float' } = {}) {
    const channels = isColored ? ['red', 'green', 'blue', ...(hasAlpha ? ['alpha'] : [])] : [];
    const header = ['ply', 'format binary_little_endian 1.0', `element vertex ${points.length}`,
        ...['x', 'y', 'z'].map((name) => `property ${type} ${name}`),
        ...channels.map((name) => `property uchar ${name}`),
        ...Object.keys(scalars).map((name) => `property ${type} ${name}`), 'end_header', ''];
    const size = type === 'double' ? 8 : 4;
    const fixed = 3 * size + channels.length;
    const stride = fixed + size * Object.keys(scalars).length;
    const body = Buffer.alloc(stride * points.length);
    const write = (value, at) => (type === 'double' ? body.writeDoubleLE(value, at) : body.writeFloatLE(value, at));
    points.forEach((point, i) => {
        point.forEach((value, k) => {
            if (k >= 3) {
                body.writeUInt8(value, stride * i + 3 * size + k - 3);
            } else {
                write(value, stride * i + size * k);
            }
        });
        Object.values(scalars).forEach((valueOf, k) => write(valueOf(point), stride * i + fixed + size * k));
    });
    return Buffer.concat([Buffer.from(header.join('\n')), body]);
}
