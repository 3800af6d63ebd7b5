/**
 * Decoder of progressive streams (docs/progressive-stream.md): every prefix of the bytes is a good cloud of fewer points. The
 * same numbers, bit by bit, as the decoder of the C++ library. No dependencies.
 */

const kMagic = 0x43505453; // STPC
const kMemory = 63;
const kPositionBits = 25;
const kScales = 32;
const kRoughest = 7;
const kTypes = [Int8Array, Uint8Array, Int16Array, Uint16Array, Int32Array, Uint32Array, Float32Array, Float64Array];
const kTypeBits = [8, 8, 16, 16, 32, 32, 32, 32];
const kFloat = 6;
const kDouble = 7;

const bitWidth = (value) => 32 - Math.clz32(value);

/** Of each bit how probable a 0 is, of 2^16, and how many were seen. */
class Bits {
    constructor(count) {
        this.zero = new Uint16Array(count).fill(1 << 15);
        this.seen = new Uint8Array(count);
    }
}

/** A binary range decoder, which reads zeros behind the end. */
class RangeDecoder {
    start(bytes, end) {
        this.bytes = bytes;
        this.at = 0;
        this.end = end;
        this.range = 0xffffffff;
        this.code = 0;
        for (let i = 0; i < 4; ++i) {
            this.code = ((this.code << 8) | this.next()) >>> 0;
        }
    }

    next() {
        return this.at < this.end ? this.bytes[this.at++] : 0;
    }

    bit(bits, i) {
        const probability = bits.zero[i];
        const rate = bitWidth(bits.seen[i] + 1);
        const zero = (this.range >>> 16) * probability;
        const value = this.code >= zero ? 1 : 0;
        if (value) {
            this.code -= zero;
            this.range -= zero;
            bits.zero[i] = probability - (probability >> rate);
        } else {
            this.range = zero;
            bits.zero[i] = probability + ((65535 - probability) >> rate);
        }
        if (bits.seen[i] < kMemory) {
            ++bits.seen[i];
        }
        this.normalize();
        return value;
    }

    /** Up to 16 bits as they are. */
    direct(count) {
        this.range >>>= count;
        const value = Math.min(Math.floor(this.code / this.range), 2 ** count - 1);
        this.code = (this.code - value * this.range) >>> 0;
        this.normalize();
        return value;
    }

    /** Up to 32 bits. */
    wide(count) {
        const high = count > 16 ? this.direct(count - 16) * 65536 : 0;
        const low = Math.min(count, 16);
        return low > 0 ? high + this.direct(low) : high;
    }

    normalize() {
        while (this.range < 0x1000000) {
            this.range = (this.range << 8) >>> 0;
            this.code = ((this.code << 8) | this.next()) >>> 0;
        }
    }

    tree(bits, first, size) {
        let node = 1;
        while (node < size) {
            node = 2 * node + this.bit(bits, first + node);
        }
        return node - size;
    }
}

/** Numbers with a sign: trees of 16 bits for the sizes, and what is common to them. */
class SignedModel {
    constructor(trees, signs) {
        this.sizes = new Bits(16 * trees);
        this.larger = new Bits(32);
        this.second = new Bits(33);
        this.sign = new Bits(signs);
    }

    decode(coder, tree, sign, most) {
        let size = coder.tree(this.sizes, 16 * tree, 16);
        if (size === 15) {
            size = Math.min(15 + coder.tree(this.larger, 0, 32), most);
        }
        if (size === 0) {
            return 0;
        }
        const negative = coder.bit(this.sign, sign);
        let value = 1;
        if (size >= 2) {
            const second = coder.bit(this.second, size);
            value = (2 + second) * 2 ** (size - 2) + coder.wide(size - 2);
        }
        return negative ? -value : value;
    }
}

function scaleOf(length) {
    if (length < 2) {
        return length;
    }
    const size = bitWidth(length);
    return Math.min(2 * size - 2 + ((length >>> (size - 2)) & 1), kScales - 1);
}

function sideOf(component, reach) {
    if (2 * Math.abs(component) <= reach) {
        return 1;
    }
    return component > 0 ? 2 : 0;
}

/** Takes a stream piece by piece; the cloud grows with it. */
export class ProgressiveDecoder {
    /** @param {number} mostPoints  stops when so many are there */
    constructor(mostPoints = Infinity) {
        this.mostPoints = mostPoints;
        this.size = 0; // points that are there
        this.total = 0; // of the whole stream; 0 before its header is there
        this.batches = []; // {points, bytes, step, meanError}: points and bytes from the start of the stream
        this.taken = 0; // bytes
        this.pending = new Uint8Array(0);
        this.batch = 0;
        this.started = false;
        this.coder = new RangeDecoder();
    }

    get done() {
        return this.total > 0 && (this.batch === this.batches.length || this.size >= this.mostPoints);
    }

    /** The next bytes, any number of them. Throws an Error for what is no such stream. */
    feed(bytes) {
        if (this.done) {
            return;
        }
        const joined = new Uint8Array(this.pending.length + bytes.length);
        joined.set(this.pending);
        joined.set(bytes, this.pending.length);
        this.taken += bytes.length;
        this.pending = joined;
        if (this.total === 0 && !this.takeHeader()) {
            return;
        }
        while (!this.done && this.runBatch()) {
            this.pending = this.pending.subarray(this.layout.batches[this.batch].bytes);
            this.started = false;
            ++this.batch;
        }
    }

    takeHeader() {
        const view = new DataView(this.pending.buffer, this.pending.byteOffset, this.pending.byteLength);
        if (view.byteLength < 12) {
            return false;
        }
        if (view.getUint32(0, true) !== kMagic || view.getUint8(4) !== 1) {
            throw new Error('this is no progressive stream of version 1');
        }
        const length = view.getUint32(8, true);
        if (view.byteLength < length) {
            return false;
        }
        this.layout = readHeader(view);
        this.prepare(length);
        this.pending = this.pending.subarray(length);
        return true;
    }

    prepare(headerBytes) {
        const { layout } = this;
        let bytes = headerBytes;
        this.batches = layout.batches.map((batch) => {
            bytes += batch.bytes;
            return { points: batch.points, bytes, step: layout.step * 2 ** batch.shift, meanError: batch.meanError };
        });
        this.total = layout.points;
        this.room = 0;
        this.more = new Bits(3 * 5 * kScales);
        this.offsets = [
            new SignedModel(kScales, 3),
            new SignedModel(kScales * 8, 3),
            new SignedModel((kRoughest + 1) * 16, 6),
        ];
        this.channelModels = layout.channels.map(() => new SignedModel(8, 1));
        this.grow(256);
    }

    grow(points) {
        const enlarged = (Type, each, old) => {
            const array = new Type(points * each);
            if (old) {
                array.set(old);
            }
            return array;
        };
        this.room = points;
        this.cells = enlarged(Int32Array, 3, this.cells);
        this.towards = enlarged(Int32Array, 3, this.towards);
        this.normals = enlarged(Float32Array, 3, this.normals);
        this.roughness = enlarged(Uint8Array, 1, this.roughness);
        this.bend = enlarged(Int8Array, 1, this.bend);
        this.idle = enlarged(Uint8Array, 1, this.idle);
        this.values = enlarged(Uint32Array, this.layout.channels.length, this.values);
    }

    /** A new point; what is known of it is filled in by the caller. */
    add() {
        if (this.size === this.room) {
            this.grow(2 * this.room);
        }
        return this.size++;
    }

    runBatch() {
        const { layout, coder } = this;
        const now = layout.batches[this.batch];
        const whole = this.pending.length >= now.bytes;
        const end = Math.min(this.pending.length, now.bytes);
        // What a step may read.
        const stepBytes = 96 + 20 * layout.channels.length;
        if (!whole && end < stepBytes) {
            return false;
        }
        const enough = whole ? Infinity : end - stepBytes;
        if (!this.started) {
            this.startBatch(end);
        }
        coder.bytes = this.pending;
        coder.end = end;
        const split = this.batch === 0 ? 0 : layout.batches[this.batch - 1].shift - now.shift;
        while (this.visited < this.size) {
            if (coder.at > enough || this.size >= this.mostPoints) {
                return false;
            }
            const i = this.visited;
            if (!this.refined && split > 0 && i < this.before) {
                this.refine(i, split);
            }
            this.refined = true;
            if (this.size < now.points && this.hasMore(i)) {
                this.attach(i);
                ++this.attached;
                continue;
            }
            this.idle[i] = this.attached > 0 ? 1 : Math.min(Math.max(this.idle[i] + 1, 2), 4);
            ++this.visited;
            this.attached = 0;
            this.refined = false;
        }
        if (this.size < now.points) {
            throw new Error(`a batch ends at point ${this.size}, before ${now.points}`);
        }
        return whole;
    }

    startBatch(end) {
        this.coder.start(this.pending, end);
        this.started = true;
        this.before = this.size;
        this.visited = 0;
        this.attached = 0;
        this.refined = false;
        if (this.batch === 0) {
            const bits = this.layout.gridBits - this.layout.batches[0].shift;
            const i = this.add();
            for (let axis = 0; axis < 3; ++axis) {
                this.cells[axis] = this.coder.wide(bits);
            }
            this.normals[2] = 1;
            this.decodeChannels(i, -1);
        }
    }

    refine(i, bits) {
        const { cells, towards } = this;
        for (let plane = 0; plane < bits; ++plane) {
            const octant = this.coder.direct(3);
            for (let axis = 0; axis < 3; ++axis) {
                cells[3 * i + axis] = 2 * cells[3 * i + axis] + ((octant >> (2 - axis)) & 1);
            }
        }
        for (let axis = 0; axis < 3; ++axis) {
            towards[3 * i + axis] *= 2 ** bits;
        }
        this.roughness[i] = Math.min(this.roughness[i] + bits, kRoughest);
    }

    reach(i) {
        const t = this.towards;
        return Math.max(Math.abs(t[3 * i]), Math.abs(t[3 * i + 1]), Math.abs(t[3 * i + 2]));
    }

    hasMore(i) {
        const context = (Math.min(this.attached, 2) * 5 + this.idle[i]) * kScales + scaleOf(this.reach(i));
        return this.coder.bit(this.more, context) === 1;
    }

    /** A point attached to another: in the tangent plane by two offsets, and how far from it. */
    attach(parent) {
        const { coder } = this;
        const child = this.add();
        const { cells, towards, normals } = this;
        const p = 3 * parent;
        const a = mainAxis(normals, p);
        const b = (a + 1) % 3;
        const c = (a + 2) % 3;
        const reach = this.reach(parent);
        const scale = scaleOf(reach);
        const [first, second, across] = this.offsets;

        const offsetB = first.decode(coder, scale, sideOf(towards[p + b], reach), kPositionBits);
        const relative = Math.min(Math.max(scaleOf(Math.abs(offsetB)) - scale + 5, 0), 7);
        const offsetC = second.decode(coder, 8 * scale + relative, sideOf(towards[p + c], reach), kPositionBits);
        const along = normals[p + b] * offsetB + normals[p + c] * offsetC;
        const expected = Math.floor(0.5 - along / normals[p + a]);
        const distance = Math.min(scaleOf(Math.max(Math.abs(offsetB), Math.abs(offsetC))), 15);
        const upward = normals[p + a] > 0;
        const miss = across.decode(coder, 16 * this.roughness[parent] + distance,
            2 * (this.bend[parent] + 1) + (upward ? 1 : 0), kPositionBits);
        const offsetA = expected + miss;

        const offset = [0, 0, 0];
        offset[a] = offsetA;
        offset[b] = offsetB;
        offset[c] = offsetC;
        const most = 2 ** (this.layout.gridBits - this.layout.batches[this.batch].shift);
        for (let axis = 0; axis < 3; ++axis) {
            const cell = cells[p + axis] + offset[axis];
            if (cell < 0 || cell >= most) {
                throw new Error(`point ${child} lies outside of the grid`);
            }
            cells[3 * child + axis] = cell;
            towards[3 * child + axis] = -offset[axis];
            towards[p + axis] = offset[axis];
        }
        turn(normals, p, offset);
        this.roughness[parent] = Math.min(bitWidth(Math.abs(miss)), kRoughest);
        this.bend[parent] = miss === 0 ? 0 : miss > 0 === upward ? 1 : -1;
        normals.copyWithin(3 * child, p, p + 3);
        this.roughness[child] = this.roughness[parent];
        this.bend[child] = this.bend[parent];
        this.decodeChannels(child, parent);
    }

    decodeChannels(i, parent) {
        const { channels } = this.layout;
        let before = 0;
        for (let c = 0; c < channels.length; ++c) {
            const { bits, follows } = channels[c];
            const difference = this.channelModels[c].decode(this.coder, follows ? before : 0, 0, 32);
            const old = parent < 0 ? 0 : this.values[parent * channels.length + c];
            const unused = 32 - bits;
            this.values[i * channels.length + c] = ((old + difference) << unused) >>> unused;
            before = difference === 0 ? 0 : Math.min(Math.floor(Math.log2(Math.abs(difference))) + 1, 7);
        }
    }

    shiftOf(i) {
        const { batches } = this.layout;
        if (this.batch === batches.length) {
            return 0;
        }
        const fine = this.started && (i >= this.before || i < this.visited || (i === this.visited && this.refined));
        return batches[fine || this.batch === 0 ? this.batch : this.batch - 1].shift;
    }

    /** Where the points are, relative to `layout.origin`: 3 floats for each. */
    positions() {
        const { low, step } = this.layout;
        const positions = new Float32Array(3 * this.size);
        for (let i = 0; i < this.size; ++i) {
            const shift = this.shiftOf(i);
            const middle = 0.5 * (2 ** shift - 1);
            for (let axis = 0; axis < 3; ++axis) {
                const cell = this.cells[3 * i + axis] * 2 ** shift;
                positions[3 * i + axis] = low[axis] + step * (cell + middle);
            }
        }
        return positions;
    }

    /** 3 floats for each point, or null. */
    pointNormals() {
        if (!this.layout.normals) {
            return null;
        }
        const each = this.layout.channels.length;
        const middle = 2 ** (this.layout.normalBits - 1) - 1;
        const normals = new Float32Array(3 * this.size);
        for (let i = 0; i < this.size; ++i) {
            unpackNormal(this.values[i * each], this.values[i * each + 1], middle, normals, 3 * i);
        }
        return normals;
    }

    /** Red, green and blue for each point, sRGB, and alpha where there is one; or null. */
    colors() {
        const { layout } = this;
        if (!layout.colors) {
            return null;
        }
        const each = layout.channels.length;
        const first = layout.normals ? 2 : 0;
        const components = layout.alpha ? 4 : 3;
        const colors = new Uint8Array(components * this.size);
        for (let i = 0; i < this.size; ++i) {
            const from = i * each + first;
            const green = this.values[from];
            colors[components * i] = this.values[from + 1] + green;
            colors[components * i + 1] = green;
            colors[components * i + 2] = this.values[from + 2] + green;
            if (layout.alpha) {
                colors[components * i + 3] = this.values[from + 3];
            }
        }
        return colors;
    }

    /** The values of attribute `number` of `layout.attributes`, in its own type, for the first `count` points. */
    attribute(number, count = this.size) {
        const { attributes, channels } = this.layout;
        const { type, components, bits, low, step, first } = attributes[number];
        const values = new kTypes[type](count * components);
        const word = new DataView(new ArrayBuffer(8));
        for (let i = 0; i < count; ++i) {
            for (let c = 0; c < components; ++c) {
                const from = i * channels.length + first + c * (type === kDouble ? 2 : 1);
                const raw = this.values[from];
                let value = raw;
                if (type === kDouble) {
                    word.setUint32(0, raw);
                    word.setUint32(4, this.values[from + 1]);
                    value = word.getFloat64(0);
                } else if (type === kFloat && bits === 0) {
                    word.setUint32(0, raw);
                    value = word.getFloat32(0);
                } else if (type === kFloat) {
                    value = low + step * raw;
                }
                values[i * components + c] = value;
            }
        }
        return values;
    }
}

function mainAxis(normals, at) {
    const x = Math.abs(normals[at]);
    const y = Math.abs(normals[at + 1]);
    const z = Math.abs(normals[at + 2]);
    if (z >= x && z >= y) {
        return 2;
    }
    return y >= x ? 1 : 0;
}

/** Turns a normal so that it is across an offset, less for short ones, which say little. */
function turn(normals, at, [x, y, z]) {
    const n = [normals[at], normals[at + 1], normals[at + 2]];
    const t = (n[0] * x + n[1] * y + n[2] * z) / (x * x + y * y + z * z + 2);
    const nx = n[0] - t * x;
    const ny = n[1] - t * y;
    const nz = n[2] - t * z;
    const lengthSq = nx * nx + ny * ny + nz * nz;
    if (lengthSq > 1e-6) {
        const scale = 1 / Math.sqrt(lengthSq);
        normals[at] = nx * scale;
        normals[at + 1] = ny * scale;
        normals[at + 2] = nz * scale;
    }
}

/** From the unfolded octahedron. */
function unpackNormal(u, v, middle, normals, at) {
    if (u > 2 * middle || v > 2 * middle) {
        return;
    }
    let x = (u - middle) / middle;
    let y = (v - middle) / middle;
    const z = 1 - Math.abs(x) - Math.abs(y);
    if (z < 0) {
        const old = x;
        x = (1 - Math.abs(y)) * (old < 0 ? -1 : 1);
        y = (1 - Math.abs(old)) * (y < 0 ? -1 : 1);
    }
    const length = Math.sqrt(x * x + y * y + z * z);
    normals[at] = x / length;
    normals[at + 1] = y / length;
    normals[at + 2] = z / length;
}

function readHeader(view) {
    const flags = view.getUint8(5);
    const layout = {
        normals: (flags & 1) !== 0,
        colors: (flags & 2) !== 0,
        alpha: (flags & 4) !== 0,
        gridBits: view.getUint8(6),
        normalBits: view.getUint8(7),
        points: view.getUint32(12, true),
        step: view.getFloat64(20, true),
        low: [28, 36, 44].map((at) => view.getFloat64(at, true)),
        origin: [52, 60, 68].map((at) => view.getFloat64(at, true)),
        attributes: [],
        batches: [],
        channels: [],
    };
    const add = (count, bits) => {
        for (let c = 0; c < count; ++c) {
            layout.channels.push({ bits, follows: c > 0 });
        }
    };
    add(layout.normals ? 2 : 0, layout.normalBits);
    add(layout.colors ? 3 : 0, 8);
    add(layout.alpha ? 1 : 0, 8);
    let at = 76;
    for (let a = view.getUint16(16, true); a > 0; --a) {
        const length = view.getUint8(at);
        const name = String.fromCharCode(...new Uint8Array(view.buffer, view.byteOffset + at + 1, length));
        at += 1 + length;
        const attribute = {
            name,
            type: view.getUint8(at),
            components: view.getUint8(at + 1),
            bits: view.getUint8(at + 3),
            low: view.getFloat64(at + 4, true),
            step: view.getFloat64(at + 12, true),
            first: layout.channels.length,
        };
        at += 20;
        add(attribute.components * (attribute.type === kDouble ? 2 : 1), attribute.bits || kTypeBits[attribute.type]);
        layout.attributes.push(attribute);
    }
    if (layout.gridBits < 1 || layout.gridBits > 24) {
        throw new Error(`the grid has ${layout.gridBits} bits`);
    }
    let shift = layout.gridBits - 1;
    for (let b = view.getUint16(18, true); b > 0; --b) {
        if (view.getUint8(at + 8) > shift) {
            throw new Error(`batch ${layout.batches.length} has a coarser grid than may be`);
        }
        shift = view.getUint8(at + 8);
        layout.batches.push({
            points: view.getUint32(at, true),
            bytes: view.getUint32(at + 4, true),
            shift: view.getUint8(at + 8),
            meanError: view.getFloat32(at + 9, true),
        });
        at += 13;
    }
    return layout;
}
