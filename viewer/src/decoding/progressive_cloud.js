/**
 * Decoder of progressive streams (docs/progressive-stream.md): every prefix of the bytes is a good cloud of fewer points. The
 * same numbers, bit by bit, as the decoder of the C++ library.
 */

import { CellSurface, kMostNeighbors, waysToSurface } from './cell_surface.js';
import { PlaceModel } from './place_model.js';
import { headerLength, kDouble, kFloat, parseHeader } from './progressive_layout.js';
import { RangeDecoder, SignedModel } from './range_decoder.js';

const kSharpeningUnit = 64;
const kMostBlockBits = 30;
const kTypes = [Int8Array, Uint8Array, Int16Array, Uint16Array, Int32Array, Uint32Array, Float32Array, Float64Array];

function enlarged(Type, length, old) {
    const array = new Type(length);
    if (old) {
        array.set(old);
    }
    return array;
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
        this.way = [0, 0, 0];
        this.cell = [0, 0, 0];
    }

    get done() {
        return this.total > 0 && (this.batch === this.batches.length || this.size >= this.mostPoints);
    }

    /** The next bytes, any number of them. Throws an Error for what is no such stream. */
    feed(bytes) {
        if (this.done) {
            return;
        }
        this.append(bytes);
        if (this.total === 0 && !this.takeHeader()) {
            return;
        }
        while (!this.done && this.runBatch()) {
            this.pending = this.pending.subarray(this.layout.batches[this.batch].bytes);
            this.started = false;
            ++this.batch;
        }
    }

    /** Behind what is pending, in room that doubles: pieces may be small, and batches large. */
    append(bytes) {
        const { length } = this.pending;
        let { buffer, byteOffset } = this.pending;
        if (byteOffset + length + bytes.length > buffer.byteLength) {
            const room = new Uint8Array(Math.max(2 * length, length + bytes.length));
            room.set(this.pending);
            ({ buffer, byteOffset } = room);
        }
        this.pending = new Uint8Array(buffer, byteOffset, length + bytes.length);
        this.pending.set(bytes, length);
        this.taken += bytes.length;
    }

    takeHeader() {
        const length = headerLength(this.pending);
        if (length === null || this.pending.length < length) {
            return false;
        }
        this.layout = parseHeader(this.pending.subarray(0, length));
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
        this.model = new PlaceModel();
        this.channelModels = layout.channels.map(() => new SignedModel(8));
        this.grow(256);
    }

    grow(points) {
        this.room = points;
        this.places = enlarged(Int32Array, 3 * points, this.places);
        this.values = enlarged(Uint32Array, this.layout.channels.length * points, this.values);
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
        while (coder.at <= enough && this.size < this.mostPoints) {
            if (!this.step()) {
                return whole;
            }
        }
        return false;
    }

    startBatch(end) {
        const { batches, gridBits } = this.layout;
        const now = batches[this.batch];
        this.coder.start(this.pending, end);
        this.started = true;
        this.planes = this.batch === 0 ? 0 : batches[this.batch - 1].shift - now.shift;
        this.most = 2 ** (gridBits - now.shift); // cells along an axis
        if (this.batch === 0) {
            for (let axis = 0; axis < 3; ++axis) {
                this.places[axis] = 2 * this.coder.wide(gridBits - now.shift) + 1;
            }
            this.size = 1;
            this.decodeChannels(0, -1);
        }
        this.findSurface();
        if (this.planes === 0) {
            this.beginRound();
        } else {
            this.beginSplitting();
        }
    }

    findSurface() {
        this.known = this.size;
        this.surface = new CellSurface(this.places, this.known, this.layout.batches[this.batch].blockBits);
    }

    beginSplitting() {
        this.step = this.split;
        this.visited = 0;
        this.coarse = this.places.slice(0, 3 * this.size);
        this.surface.places = this.coarse;
        for (let i = 0; i < 3 * this.size; ++i) {
            this.places[i] *= 2 ** this.planes;
        }
    }

    /** Splits the cells of the points that are there. */
    split() {
        const { places, coarse, surface, planes } = this;
        if (this.visited === this.known) {
            this.beginRound();
            return true;
        }
        const i = this.visited;
        surface.findNeighbors(i);
        surface.fitPlane(places, i, false);
        const bits = this.model.split(this.coder, surface.plane, planes);
        for (let axis = 0; axis < 3; ++axis) {
            places[3 * i + axis] = 2 * ((coarse[3 * i + axis] >> 1) * 2 ** planes + bits[axis]) + 1;
        }
        ++this.visited;
        return true;
    }

    /** The points that are there get up to as many more. */
    beginRound() {
        this.step = this.lookAround;
        this.visited = 0;
        this.open = false;
        this.target = Math.min(this.layout.batches[this.batch].points, 2 * this.known);
        this.children = new Uint32Array(2 * this.known); // of each, those in cells around it: the first, and behind the last
    }

    endRound() {
        if (this.size === this.layout.batches[this.batch].points) {
            return false;
        }
        this.findSurface();
        this.beginRound();
        return true;
    }

    openVisit() {
        this.surface.places = this.places; // which may have grown
        this.surface.findNeighbors(this.visited);
        this.surface.findTangent(this.visited);
        this.found = 0;
        this.open = true;
    }

    closeVisit() {
        this.open = false;
        ++this.visited;
        return true;
    }

    /** Points in the cells around those that were there. */
    lookAround() {
        const { coder, model, surface, visited: i } = this;
        const { lift } = this.layout.batches[this.batch];
        if (this.size === this.target) {
            return this.endRound();
        }
        if (i === this.known) {
            this.visited = 0;
            this.step = this.lookFarther;
            return true;
        }
        if (!this.open) {
            this.openVisit();
            surface.findCandidates(i, lift);
            this.next = 0;
            this.children[2 * i] = this.children[2 * i + 1] = this.size;
        }
        if (this.next === surface.candidateCount) {
            return this.closeVisit();
        }
        const c = this.next;
        const nearest = this.found > 0 ? 0 : this.nearestNew(3 * c, lift);
        if (!model.candidate(coder, surface.candidateContexts[c], nearest, this.found)) {
            ++this.next;
            this.found = 0;
            return true;
        }
        const { way, cell } = this;
        for (let axis = 0; axis < 3; ++axis) {
            const middle = surface.candidateMiddles[3 * c + axis];
            way[axis] = this.places[3 * i + axis] - middle;
            cell[axis] = (middle >> (lift + 1)) * 2 ** lift;
        }
        const bits = model.placeWithin(coder, surface.plane, surface.candidateOffsets[c], lift, way);
        this.add(cell[0] + bits[0], cell[1] + bits[1], cell[2] + bits[2]);
        ++this.children[2 * i + 1];
        ++this.found;
        return true;
    }

    /** How far from a candidate, of which the middle stands at `at`, the nearest lies that came in this round, in its sides. */
    nearestNew(at, lift) {
        const { children, places, surface, visited } = this;
        const x = surface.candidateMiddles[at];
        const y = surface.candidateMiddles[at + 1];
        const z = surface.candidateMiddles[at + 2];
        let nearest = Infinity;
        for (let n = -1; n < surface.counts[visited]; ++n) {
            const parent = n < 0 ? visited : surface.neighbors[kMostNeighbors * visited + n];
            for (let i = children[2 * parent]; i < children[2 * parent + 1]; ++i) {
                const dx = places[3 * i] - x;
                const dy = places[3 * i + 1] - y;
                const dz = places[3 * i + 2] - z;
                nearest = Math.min(nearest, dx * dx + dy * dy + dz * dz);
            }
        }
        return Math.sqrt(nearest) / 2 ** (lift + 1);
    }

    /** The others, by their offsets. */
    lookFarther() {
        if (this.size === this.target) {
            return this.endRound();
        }
        if (this.visited === this.known) {
            throw new Error(`progressive stream: a batch ends at point ${this.size}: expected ${this.target}`);
        }
        if (!this.open) {
            this.openVisit();
        }
        if (!this.model.far(this.coder, this.surface, this.found)) {
            return this.closeVisit();
        }
        const from = 3 * this.visited;
        const offset = this.model.offset(this.coder, this.surface);
        const cell = offset.map((way, axis) => (this.places[from + axis] >> 1) + way);
        this.add(cell[0], cell[1], cell[2]);
        ++this.found;
        return true;
    }

    add(x, y, z) {
        const { most } = this;
        if (x < 0 || x >= most || y < 0 || y >= most || z < 0 || z >= most) {
            throw new Error(`progressive stream: point ${this.size} lies outside of the grid`);
        }
        if (this.size === this.room) {
            this.grow(2 * this.room);
        }
        const i = this.size++;
        this.places[3 * i] = 2 * x + 1;
        this.places[3 * i + 1] = 2 * y + 1;
        this.places[3 * i + 2] = 2 * z + 1;
        this.decodeChannels(i, this.visited);
    }

    decodeChannels(i, parent) {
        const { channels } = this.layout;
        let before = 0;
        for (let c = 0; c < channels.length; ++c) {
            const { bits, follows } = channels[c];
            const difference = this.channelModels[c].decode(this.coder, follows ? before : 0, 32);
            const old = parent < 0 ? 0 : this.values[parent * channels.length + c];
            const unused = 32 - bits;
            this.values[i * channels.length + c] = ((old + difference) << unused) >>> unused;
            before = difference === 0 ? 0 : Math.min(Math.floor(Math.log2(Math.abs(difference))) + 1, 7);
        }
    }

    /** The middles of the points' cells, in half steps of the whole grid. */
    shownPlaces() {
        const { batches } = this.layout;
        const shown = new Int32Array(3 * this.size);
        const splitting = this.started && this.step === this.split;
        for (let i = 0; i < this.size; ++i) {
            const isFine = !splitting || i < this.visited;
            const { shift } = batches[this.started && (isFine || this.batch === 0) ? this.batch : this.batch - 1];
            const from = isFine ? this.places : this.coarse;
            for (let at = 3 * i; at < 3 * i + 3; ++at) {
                shown[at] = from[at] * 2 ** shift;
            }
        }
        return shown;
    }

    /** How much the points are put out of their surface. */
    sharpening() {
        const { batches } = this.layout;
        if (this.batch === batches.length) {
            return 0;
        }
        const now = batches[this.batch];
        const before = this.batch === 0 ? { points: 0, sharpening: 0 } : batches[this.batch - 1];
        if (this.size === before.points) {
            return before.sharpening / kSharpeningUnit;
        }
        const part = (this.size - before.points) / (now.points - before.points);
        return (before.sharpening + part * (now.sharpening - before.sharpening)) / kSharpeningUnit;
    }

    /** Where the points are, relative to `layout.origin`: 3 floats for each. */
    positions() {
        const work = this.findPositions();
        let step = work.next();
        while (!step.done) {
            step = work.next();
        }
        return step.value;
    }

    /** The same, as a generator that stops now and then for what cannot wait. */
    *findPositions() {
        const { low, step, batches } = this.layout;
        const places = this.shownPlaces();
        const sharpening = this.sharpening();
        let ways;
        if (sharpening > 0) {
            const { shift } = batches[Math.max(this.batch - 1, 0)];
            const blockBits = Math.min(batches[this.batch].blockBits + shift, kMostBlockBits);
            ways = yield* waysToSurface(places, this.size, blockBits);
        }
        const positions = new Float32Array(3 * this.size);
        for (let i = 0; i < this.size; ++i) {
            for (let axis = 0; axis < 3; ++axis) {
                const at = 3 * i + axis;
                const way = ways ? -sharpening * ways[at] : 0;
                positions[at] = low[axis] + step * 0.5 * (places[at] - 1 + way);
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
