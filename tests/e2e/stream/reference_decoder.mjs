// A decoder of progressive streams written from docs/progressive-stream.md alone, section by section: as plain as that, and as slow.

const kTypeBits = [8, 8, 16, 16, 32, 32, 32, 32];

const lengthInBits = (v) => 32 - Math.clz32(Math.abs(v));
const bin = (v, k) => (v > 0 ? Math.min(k - 1, Math.floor(v)) : 0);
const classOf = (v, ...from) => from.filter((least) => v >= least).length;
const minus = (p, q) => p.map((x, k) => x - q[k]);
const dot = ([x, y, z], [u, v, w]) => x * u + y * v + z * w;
const middleOf = (cell) => cell.map((c) => 2 * c + 1);
const squareBetween = (p, q) => minus(p, q).reduce((sum, d) => sum + d * d, 0);

function scale(v) {
    const l = lengthInBits(v);
    return v < 2 ? v : Math.min(31, 2 * l - 2 + ((v >> (l - 2)) & 1));
}

// ## Header

export function readHeader(bytes) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const doubles = (from) => [0, 8, 16].map((more) => view.getFloat64(from + more, true));
    let at = 76;
    const attributes = Array.from({ length: view.getUint16(16, true) }, () => {
        const name = String.fromCharCode(...bytes.subarray(at + 1, at + 1 + bytes[at]));
        at += 1 + bytes[at] + 20;
        const [type, components, , bits] = bytes.subarray(at - 20, at - 16);
        return { name, type, components, bits, low: view.getFloat64(at - 16, true), step: view.getFloat64(at - 8, true) };
    });
    const batches = Array.from({ length: view.getUint16(18, true) }, () => {
        const [shift, lift, blockBits, sharpening] = bytes.subarray(at + 8, at + 12);
        at += 16;
        return { points: view.getUint32(at - 16, true), bytes: view.getUint32(at - 12, true), shift, lift, blockBits, sharpening };
    });
    return {
        has: (flag) => (bytes[5] & flag) !== 0, gridBits: bytes[6], normalBits: bytes[7], length: view.getUint32(8, true),
        step: view.getFloat64(20, true), low: doubles(28), origin: doubles(52), attributes, batches,
    };
}

// ## Points: neighbours

function neighborsOf(places, blockBits) {
    const blockOf = (place) => place.map((x) => x >> blockBits);
    const blocks = new Map();
    places.forEach((place, i) => {
        const key = blockOf(place).join();
        blocks.set(key, [...(blocks.get(key) ?? []), i].slice(0, 32));
    });
    const ways = [-1, 0, 1].flatMap((x) => [-1, 0, 1].flatMap((y) => [-1, 0, 1].map((z) => [x, y, z])));
    return places.map((place, i) => {
        const around = ways.flatMap((way) => blocks.get(blockOf(place).map((x, k) => x + way[k]).join()) ?? [])
            .map((other) => ({ other, square: squareBetween(places[other], place) }));
        const nearest = [];
        for (const { other } of around.filter((one) => one.square > 0).sort((a, b) => a.square - b.square)) {
            const isAlone = nearest.every((n) => squareBetween(places[n], places[other]) > 0);
            if (isAlone && nearest.length < 8) nearest.push(other);
        }
        return { nearest, isShadow: around.some(({ other, square }) => square === 0 && other < i) };
    });
}

// ## Points: its plane

function planeOf(place, others, withItself) {
    const count = others.length + (withItself ? 1 : 0), most = Math.max(count, 1);
    const mean = [0, 1, 2].map((k) => others.reduce((sum, q) => sum + (q[k] - place[k]), 0) / most);
    const S = [0, 0, 0, 0, 0, 0];
    for (const q of withItself ? [place, ...others] : others) {
        const [x, y, z] = minus(minus(q, place), mean);
        [x * x, x * y, x * z, y * y, y * z, z * z].forEach((product, k) => { S[k] += product; });
    }
    const lift = 1e-3 * most + 1e-7 * (S[0] + S[3] + S[5]);
    const n = leastAxis([S[0] + lift, S[1], S[2], S[3] + lift, S[4], S[5] + lift]);
    const [x, y, z] = n;
    const square = x * (S[0] * x + 2 * S[1] * y + 2 * S[2] * z) + y * (S[3] * y + 2 * S[4] * z) + z * S[5] * z;
    const [ax, ay, az] = n.map(Math.abs);
    const a = az >= ax && az >= ay ? 2 : ay >= ax ? 1 : 0;
    return { n, height: dot(n, mean), roughness: Math.sqrt(Math.max(0, square / most)), a, b: (a + 1) % 3, c: (a + 2) % 3 };
}

function leastAxis([xx, xy, xz, yy, yz, zz]) {
    let m = [yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy, xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy];
    for (let squaring = 0; squaring < 3; squaring += 1) {
        const inverse = 1 / (m[0] + m[3] + m[5]);
        const [p, q, r, s, t, u] = m.map((v) => v * inverse);
        m = [p * p + q * q + r * r, p * q + q * s + r * t, p * r + q * t + r * u, q * q + s * s + t * t, q * r + s * t + t * u, r * r + t * t + u * u];
    }
    const [p, q, r, s, t, u] = m;
    const row = p >= s && p >= u ? [p, q, r] : s >= u ? [q, s, t] : [r, t, u];
    const length = Math.sqrt(dot(row, row));
    return row.map((v) => v / length);
}

function spacingOf(place, others) {
    const six = others.slice(0, 6).map((q) => Math.sqrt(squareBetween(q, place)));
    return six.reduce((sum, d) => sum + d, 0) / Math.max(six.length, 1);
}

// ## Coder

class Coder {
    constructor() {
        this.contexts = new Map();
    }

    begin(bytes) {
        Object.assign(this, { bytes, at: 0, range: 2 ** 32 - 1, code: 0 });
        for (let i = 0; i < 4; i += 1) this.code = this.code * 256 + this.next();
    }

    next() {
        return this.bytes[this.at++] ?? 0;
    }

    renormalize() {
        while (this.range < 2 ** 24) {
            this.range *= 256;
            this.code = this.code * 256 + this.next();
        }
    }

    bit(...names) {
        const name = names.join();
        if (!this.contexts.has(name)) this.contexts.set(name, { p: 2 ** 15, seen: 0 });
        const context = this.contexts.get(name);
        const z = (this.range >>> 16) * context.p;
        const l = lengthInBits(Math.min(context.seen++, 63) + 1);
        const bit = this.code < z ? 0 : 1;
        context.p += bit ? -(context.p >> l) : (65535 - context.p) >> l;
        this.range = bit ? this.range - z : z;
        this.code -= bit ? z : 0;
        this.renormalize();
        return bit;
    }

    asTheyAre(count) {
        if (count > 16) return this.asTheyAre(count - 16) * 65536 + this.asTheyAre(16);
        this.range >>>= count;
        const value = Math.floor(this.code / this.range);
        this.code -= value * this.range;
        this.renormalize();
        return value;
    }

    tree(bits, ...names) {
        let node = 1;
        for (let i = 0; i < bits; i += 1) node = 2 * node + this.bit(...names, node);
        return node - 2 ** bits;
    }

    /** @param of  whose number it is; @param size  the context of its size */
    number(of, size, mostBits) {
        let l = this.tree(4, of, 'size', size);
        if (l === 15) l = Math.min(mostBits, 15 + this.tree(5, of, 'longer'));
        if (l === 0) return 0;
        const isNegative = this.bit(of, 'sign');
        const value = l === 1 ? 1 : (2 + this.bit(of, 'below', l)) * 2 ** (l - 2) + this.asTheyAre(l - 2);
        return isNegative ? -value : value;
    }
}

export class ReferenceDecoder {
    constructor(bytes) {
        this.bytes = bytes;
        this.header = readHeader(bytes);
        this.coder = new Coder();
        this.groups = this.groupsOfChannels();
        this.cells = [];
        this.channels = []; // of each point, in a row
        this.over = 0; // batches
        this.at = this.header.length;
    }

    // ## Channels

    groupsOfChannels() {
        const { has, normalBits, attributes } = this.header;
        const group = (count, bits) => Array(count).fill(bits);
        return [
            ...(has(1) ? [group(2, normalBits)] : []), ...(has(2) ? [group(3, 8)] : []), ...(has(4) ? [group(1, 8)] : []),
            ...attributes.map(({ type, components, bits }) => group(components * (type === 7 ? 2 : 1), bits || kTypeBits[type])),
        ];
    }

    readChannels(parent) {
        const row = [];
        for (const group of this.groups) {
            let before = 0;
            for (const bits of group) {
                const difference = this.coder.number(`channel ${row.length}`, before, 32);
                before = Math.min(7, lengthInBits(difference));
                const value = (parent?.[row.length] ?? 0) + difference;
                row.push(((value % 2 ** bits) + 2 ** bits) % 2 ** bits);
            }
        }
        return row;
    }

    // ## Points

    /** The next batch. */
    decodeBatch() {
        const { batches, gridBits } = this.header;
        const batch = batches[this.over], before = batches[this.over - 1];
        this.coder.begin(this.bytes.subarray(this.at, this.at + batch.bytes));
        this.at += batch.bytes;
        if (!before) {
            const bits = gridBits - batch.shift;
            this.add([0, 1, 2].map(() => this.coder.asTheyAre(bits)), null);
        }
        const find = () => neighborsOf(this.cells.map(middleOf), batch.blockBits);
        let neighbors = find();
        if (before && batch.shift < before.shift) this.split(neighbors, before.shift - batch.shift);
        while (this.cells.length < batch.points) {
            this.round(neighbors ?? find(), Math.min(batch.points, 2 * this.cells.length), batch.lift);
            neighbors = null;
        }
        this.over += 1;
    }

    add(cell, parent) {
        this.cells.push(cell);
        this.channels.push(this.readChannels(this.channels[parent]));
    }

    split(neighbors, planes) {
        const places = this.cells.map((cell) => middleOf(cell).map((x) => x * 2 ** planes));
        this.cells.forEach((cell, i) => {
            const plane = planeOf(places[i], neighbors[i].nearest.map((n) => places[n]), false);
            this.cells[i] = this.bitsWithin(cell, planes, plane, null);
            places[i] = middleOf(this.cells[i]);
        });
    }

    /** The cell of a point in a larger one. @param toPoint  from its middle to the place that is looked around; null: it is split */
    bitsWithin(cell, planes, { n, height, roughness, a, b, c }, toPoint) {
        const kind = toPoint ? 'new' : 'split', fine = [...cell], m = [0, 0, 0];
        for (let p = planes - 1; p >= 0; p -= 1) {
            const size = 4 * 2 ** p, r = bin(8 * roughness / size, 8);
            for (const axis of [b, c, a]) {
                const h = (height - dot(n, m)) / size;
                const along = () => (toPoint ? bin(4 + 4 * (toPoint[axis] - m[axis]) / size, 8) : r >> 1);
                const bit = axis === a ? this.coder.bit(kind, 'a', r, bin(12 + 12 * h / n[a], 24))
                    : this.coder.bit(kind, 'b, c', along(), bin(4 + 6 * h * n[axis], 8));
                fine[axis] = 2 * fine[axis] + bit;
                m[axis] += bit ? 2 ** p : -(2 ** p);
            }
        }
        return fine;
    }

    round(neighbors, target, lift) {
        const places = this.cells.map(middleOf), found = places.map(() => []);
        const views = places.map((place, i) => {
            const others = neighbors[i].nearest.map((n) => places[n]);
            return { i, place, ...neighbors[i], others, plane: planeOf(place, others, true), spacing: spacingOf(place, others) };
        });
        const isOver = () => this.cells.length === target;
        for (const view of views) {
            if (isOver()) return;
            this.lookAround(view, places, found, lift, isOver);
        }
        for (const view of views) {
            if (isOver()) return;
            this.takeOffsets(view, isOver);
        }
        if (!isOver()) throw new Error(`a round ends at point ${this.cells.length} of ${target}`);
    }

    lookAround({ i, place, nearest, isShadow, plane, spacing }, places, found, lift, isOver) {
        const side = 2 ** (lift + 1), { n, a, b, c, height, roughness } = plane;
        if (isShadow || nearest.length < 3 || !(spacing < 8 * side)) return;
        const R = Math.min(Math.max(1.3 * (spacing / side), 1.5), 5) * side, steps = Math.ceil(R / side);
        const thickness = 0.75 * side + 1.5 * roughness;
        const own = place.map((x) => x >> (lift + 1)), toOwn = minus(own.map((x) => (2 * x + 1) * 2 ** lift), place);
        const spacings = classOf(spacing / side, 0.9, 1.2, 1.6, 2.2, 3);
        for (let u = -steps; u <= steps; u += 1) {
            for (let v = -steps; v <= steps; v += 1) {
                const way = [0, 0, 0];
                way[b] = toOwn[b] + side * u;
                way[c] = toOwn[c] + side * v;
                const along = n[b] * way[b] + n[c] * way[c] - height;
                const ends = [(-thickness - along) / n[a], (thickness - along) / n[a]].sort((p, q) => p - q);
                const first = Math.max(-steps, Math.ceil((ends[0] - toOwn[a]) / side)), last = Math.min(steps, Math.floor((ends[1] - toOwn[a]) / side));
                for (let w = first; w <= last; w += 1) {
                    way[a] = toOwn[a] + side * w;
                    const middle = place.map((x, k) => x + way[k]), square = squareBetween(middle, place);
                    const isNearerTo = (other) => {
                        const distance = squareBetween(places[other], middle);
                        return distance < square || distance === square && other < i;
                    };
                    if (square > R * R || nearest.some(isNearerTo)) continue;
                    const off = n[a] * way[a] + along;
                    const news = [i, ...nearest].flatMap((parent) => found[parent]);
                    const toNew = Math.sqrt(Math.min(...news.map((q) => squareBetween(q, middle)))) / side;
                    const firstTime = ['first', spacings, bin(8 * Math.sqrt(square) / spacing, 11), bin(6 * Math.abs(off) / side, 6), classOf(toNew, 0.7, 1, 1.5)];
                    for (let times = 0; this.coder.bit(...(times === 0 ? firstTime : ['more', spacings, times === 1])); times += 1) {
                        const cell = middle.map((x) => x >> (lift + 1));
                        this.add(this.bitsWithin(cell, lift, { ...plane, height: -off }, way.map((x) => -x)), i);
                        found[i].push(middleOf(this.cells.at(-1)));
                        if (isOver()) return;
                    }
                }
            }
        }
    }

    takeOffsets({ i, plane: { n, a, b, c, height, roughness }, spacing }, isOver) {
        const half = scale(Math.floor(spacing / 2));
        for (let were = 0; this.coder.bit('offset', Math.min(were, 2), half, bin(16 * roughness / spacing, 4)); were += 1) {
            const o = [0, 0, 0];
            o[b] = this.coder.number('b', half, 25);
            o[c] = this.coder.number('c', `${half} ${Math.min(Math.max(scale(Math.abs(o[b])) - half + 5, 0), 7)}`, 25);
            const longer = Math.max(Math.abs(o[b]), Math.abs(o[c]));
            const miss = this.coder.number('a', `${bin(2 * roughness, 16)} ${Math.min(15, scale(longer))}`, 25);
            o[a] = Math.floor(0.5 + (height / 2 - (n[b] * o[b] + n[c] * o[c])) / n[a]) + miss;
            this.add(this.cells[i].map((x, k) => x + o[k]), i);
            if (isOver()) return;
        }
    }

    // ## Where points are shown

    /** 3 floats for each point. */
    positions() {
        const { batches, low, step } = this.header;
        const last = batches[this.over - 1], next = batches[this.over];
        const places = this.cells.map((cell) => middleOf(cell).map((x) => x * 2 ** last.shift));
        const f = last.sharpening / 64;
        const neighbors = f > 0 ? neighborsOf(places, Math.min(30, next.blockBits + last.shift)) : [];
        return Float32Array.from(places.flatMap((place, i) => {
            const w = f > 0 ? this.outOfSurface(place, neighbors[i].nearest.map((n) => places[n])) : [0, 0, 0];
            return place.map((x, k) => low[k] + step * 0.5 * (x - 1 + -f * w[k]));
        }));
    }

    outOfSurface(place, others) {
        if (others.length < 3) return [0, 0, 0];
        const { n, height } = planeOf(place, others, true);
        return n.map((x) => height * x);
    }
}
