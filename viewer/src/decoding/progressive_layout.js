// The header of a progressive stream (docs/progressive-stream.md), with the checks of core/src/progressive/progressive_layout.cpp, in the same words.

const kMagic = 'STPC';
const kVersion = 3;
const kPreamble = 12;
const kMostHeader = 2 ** 20;
const kMostBatches = 64;
const kMostGridBits = 24;
const kMostAcross = 4e15;
const kFarthest = 3.4028234663852886e38; // of single precision
const kTypeBits = [8, 8, 16, 16, 32, 32, 32, 32];
export const kFloat = 6;
export const kDouble = 7;

function malformed(what) {
    throw new Error(`progressive stream: ${what}`);
}

function requireRange(what, value, least, most) {
    if (!(value >= least && value <= most)) {
        malformed(`${what} ${value}: expected ${least}..${most}`);
    }
    return value;
}

class Reader {
    constructor(bytes) {
        this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
        this.at = 0;
    }

    /** Where the next `size` bytes begin. */
    take(size) {
        const { at } = this;
        if (at + size > this.view.byteLength) {
            malformed('the header ends too early');
        }
        this.at += size;
        return at;
    }

    u8() {
        return this.view.getUint8(this.take(1));
    }

    u16() {
        return this.view.getUint16(this.take(2), true);
    }

    u32() {
        return this.view.getUint32(this.take(4), true);
    }

    f32() {
        return this.view.getFloat32(this.take(4), true);
    }

    finite(what) {
        const value = this.view.getFloat64(this.take(8), true);
        if (!Number.isFinite(value)) {
            malformed(`${what} is not a finite number`);
        }
        return value;
    }

    place(what) {
        return [0, 1, 2].map(() => this.finite(what));
    }

    text(length) {
        const at = this.take(length);
        return String.fromCharCode(...new Uint8Array(this.view.buffer, this.view.byteOffset + at, length));
    }
}

/** The header's length, once its first bytes are there; else null. */
export function headerLength(bytes) {
    const reader = new Reader(bytes.subarray(0, kPreamble));
    if (!kMagic.startsWith(reader.text(Math.min(bytes.length, kMagic.length)))) {
        malformed(`it does not start with '${kMagic}'`);
    }
    if (bytes.length < kPreamble) {
        return null;
    }
    const version = reader.u8();
    if (version !== kVersion) {
        throw new Error(`progressive stream of version ${version}: expected ${kVersion}`);
    }
    reader.take(3);
    return requireRange('length of the header', reader.u32(), kPreamble, kMostHeader);
}

/** @param bytes  as many as `headerLength` says. */
export function parseHeader(bytes) {
    const reader = new Reader(bytes);
    reader.take(5);
    const flags = requireRange('flags', reader.u8(), 0, 15);
    const layout = { normals: (flags & 1) !== 0, colors: (flags & 2) !== 0, alpha: (flags & 4) !== 0, attributes: [], batches: [], channels: [] };
    if (layout.alpha && !layout.colors) {
        malformed(`flags ${flags}: alpha without colours`);
    }
    layout.gridBits = requireRange('bits of the grid', reader.u8(), 1, kMostGridBits);
    layout.normalBits = requireRange('bits of normals', reader.u8(), 2, 16);
    reader.take(4);
    layout.points = requireRange('points', reader.u32(), 1, 2 ** 32 - 1);
    const attributes = reader.u16();
    const batches = requireRange('number of batches', reader.u16(), 1, kMostBatches);
    layout.step = reader.finite('the step of the grid');
    if (!(layout.step > 0)) {
        malformed('the step of the grid is not positive');
    }
    layout.low = reader.place('the corner of the grid');
    layout.origin = reader.place('the origin');
    requireReach(layout);
    addChannels(layout, layout.normals ? 2 : 0, layout.normalBits);
    addChannels(layout, layout.colors ? 3 : 0, 8);
    addChannels(layout, layout.alpha ? 1 : 0, 8);
    for (let a = 0; a < attributes; ++a) {
        readAttribute(reader, layout);
    }
    readBatches(reader, batches, layout);
    if (reader.at < bytes.length) {
        malformed('the header is longer than its contents');
    }
    return layout;
}

function requireReach({ low, step, gridBits }) {
    const across = step * 2 ** gridBits;
    const reach = Math.max(...low.map(Math.abs)) + across;
    if (across > kMostAcross) {
        malformed(`the grid is ${across} across: expected at most ${kMostAcross}; give the cloud in a larger unit, or without points that are far from all others`);
    }
    if (reach > kFarthest) {
        malformed(`the grid reaches ${reach} from the origin: expected at most ${kFarthest}; give the cloud in a larger unit`);
    }
}

function addChannels({ channels }, count, bits) {
    for (let c = 0; c < count; ++c) {
        channels.push({ bits, follows: c > 0 });
    }
}

function readAttribute(reader, layout) {
    const name = reader.text(reader.u8());
    if (!/^[!-~]+$/.test(name)) {
        malformed('the name of an attribute is not 1 to 255 printable ASCII characters without spaces');
    }
    const type = requireRange('type of an attribute', reader.u8(), 0, kTypeBits.length - 1);
    const components = requireRange('components of an attribute', reader.u8(), 1, 255);
    requireRange('reduction of an attribute', reader.u8(), 0, 4);
    const bits = requireRange('bits of an attribute', reader.u8(), 0, type === kFloat ? 32 : 0);
    const low = reader.finite('the lowest value of an attribute');
    const step = reader.finite('the step of an attribute');
    layout.attributes.push({ name, type, components, bits, low, step, first: layout.channels.length });
    addChannels(layout, components * (type === kDouble ? 2 : 1), bits || kTypeBits[type]);
}

function readBatches(reader, count, layout) {
    let points = 0;
    let shift = layout.gridBits - 1;
    for (let b = 0; b < count; ++b) {
        const batch = {
            points: reader.u32(), bytes: reader.u32(),
            shift: reader.u8(), lift: reader.u8(), blockBits: reader.u8(), sharpening: reader.u8(),
            meanError: reader.f32(),
        };
        requireRange('points up to a batch', batch.points, Math.max(points, 1), layout.points);
        requireRange('shift of a batch', batch.shift, 0, shift);
        requireRange('lift of a batch', batch.lift, 0, layout.gridBits - batch.shift);
        requireRange('bits of the blocks of a batch', batch.blockBits, 0, kMostGridBits);
        if (batch.points - points > mostPoints(batch.bytes, layout.channels.length)) {
            malformed(`a batch of ${batch.bytes} bytes cannot hold ${batch.points - points} points`);
        }
        ({ points, shift } = batch);
        layout.batches.push(batch);
    }
    if (points !== layout.points || shift !== 0 || layout.batches.at(-1).sharpening !== 0) {
        malformed('the batches do not add up to the whole');
    }
}

/** As many points as a batch of so many bytes may have: a bound for what the decoder allocates. */
function mostPoints(bytes, channels) {
    const few = 16;
    return 64 + Math.floor((8 * bytes * few) / Math.max(channels, few));
}
