// What a cloud looks like: a plain picture of its points, to compare the pictures of viewers with.

const minus = (a, b) => a.map((x, k) => x - b[k]);
const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];
const unit = (a) => a.map((x) => x / Math.hypot(...a));
const kDark = 30;
const strongest = (colors) => colors.indexOf(Math.max(...colors));

/**
 * Every point as a square of `2 * reach + 1` pixels, the nearest in front.
 * @param points  `[x, y, z, red, green, blue]`
 * @returns {Int8Array} for each pixel which channel is strongest, or -1 where nothing is
 */
export function pictureOf(points, { eye, target, up, fov }, size, reach) {
    const forward = unit(minus(target, eye));
    const right = unit(cross(forward, up));
    const above = cross(right, forward);
    const scale = 0.5 * size / Math.tan(fov * Math.PI / 360);
    const picture = new Int8Array(size * size).fill(-1);
    const depths = new Float64Array(size * size).fill(Infinity);
    for (const [x, y, z, ...color] of points) {
        const offset = minus([x, y, z], eye);
        const depth = dot(offset, forward);
        const column = Math.floor(size / 2 + scale * dot(offset, right) / depth);
        const row = Math.floor(size / 2 - scale * dot(offset, above) / depth);
        for (let j = Math.max(0, row - reach); j <= Math.min(size - 1, row + reach); j += 1) {
            for (let i = Math.max(0, column - reach); i <= Math.min(size - 1, column + reach); i += 1) {
                if (depth < depths[size * j + i]) {
                    depths[size * j + i] = depth;
                    picture[size * j + i] = strongest(color);
                }
            }
        }
    }
    return picture;
}

/**
 * A viewer's screenshot against two pictures of the cloud, with `small` and with `large` points.
 * @returns `covered`: the share of the cloud (small points) that is lit; `spilled`: the share of what is lit that is far from it (large
 * points); `alike`: the share of what is lit on the cloud whose strongest channel is the cloud's
 */
export function compare({ data, channels, count }, small, large) {
    let lit = 0, cloud = 0, covered = 0, spilled = 0, alike = 0;
    for (let i = 0; i < count; i += 1) {
        const color = [...data.subarray(channels * i, channels * i + 3)];
        const isLit = Math.max(...color) > kDark;
        lit += isLit;
        cloud += small[i] >= 0;
        covered += isLit && small[i] >= 0;
        spilled += isLit && large[i] < 0;
        alike += isLit && small[i] >= 0 && strongest(color) === small[i];
    }
    return { covered: covered / cloud, spilled: spilled / Math.max(1, lit), alike: alike / Math.max(1, covered) };
}

/** The mean red, green and blue of what is lit in a screenshot. */
export function meanColor({ data, channels, count }) {
    const sum = [0, 0, 0];
    let lit = 0;
    for (let i = 0; i < count; i += 1) {
        const color = data.subarray(channels * i, channels * i + 3);
        if (Math.max(...color) > kDark) {
            lit += 1;
            color.forEach((value, k) => { sum[k] += value; });
        }
    }
    return sum.map((value) => value / lit);
}
