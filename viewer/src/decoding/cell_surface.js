/**
 * What the cells in which points lie tell of the surface between them (docs/progressive-stream.md). The same, bit by bit, as
 * core/src/progressive/cell_surface.cpp finds: doubles are summed in the order of there.
 */

export const kMostNeighbors = 8;
const kMostOfBlock = 32;
const kSpacingNeighbors = 6;
const kUnknown = 255;
const kBetweenStops = 4096;
const kDistances = 11;
const kHeights = 6;
export const kSpacingClasses = 6;
export const kCandidateContexts = kSpacingClasses * kDistances * kHeights;

/** The whole part of a number, 0 for negative ones and what is none, at most count - 1. */
export function bin(value, count) {
    if (!(value > 0)) {
        return 0;
    }
    return value < count ? Math.floor(value) : count - 1;
}

/** Of a mean distance of neighbours, in sides of the cells that are asked. */
function spacingClass(spacing) {
    return spacing < 0.9 ? 0 : spacing < 1.2 ? 1 : spacing < 1.6 ? 2 : spacing < 2.2 ? 3 : spacing < 3 ? 4 : 5;
}

/** That of a candidate. */
export function spacingsOf(context) {
    return Math.floor(context / (kDistances * kHeights));
}

/** The eigenvector of the least eigenvalue of a matrix xx xy xz yy yz zz: the cofactors' largest, found by squaring them. */
function leastAxis(xx, xy, xz, yy, yz, zz, axis) {
    let a = yy * zz - yz * yz;
    let b = xz * yz - xy * zz;
    let c = xy * yz - xz * yy;
    let d = xx * zz - xz * xz;
    let e = xy * xz - xx * yz;
    let f = xx * yy - xy * xy;
    for (let i = 0; i < 3; ++i) {
        const scale = 1 / (a + d + f);
        a *= scale;
        b *= scale;
        c *= scale;
        d *= scale;
        e *= scale;
        f *= scale;
        const aa = a * a + b * b + c * c;
        const bb = a * b + b * d + c * e;
        const cc = a * c + b * e + c * f;
        const dd = b * b + d * d + e * e;
        const ee = b * c + d * e + e * f;
        f = c * c + e * e + f * f;
        a = aa;
        b = bb;
        c = cc;
        d = dd;
        e = ee;
    }
    let x = c;
    let y = e;
    let z = f;
    if (a >= d && a >= f) {
        x = a;
        y = b;
        z = c;
    } else if (d >= f) {
        x = b;
        y = d;
        z = e;
    }
    const length = Math.sqrt(x * x + y * y + z * z);
    axis[0] = x / length;
    axis[1] = y / length;
    axis[2] = z / length;
}

/**
 * The ways from places to where the surface through them passes, 3 numbers each: along the normal to the mean of a place and
 * its neighbours; none where there are fewer than three. A generator, which stops now and then for what cannot wait.
 */
export function* waysToSurface(places, count, blockBits) {
    const surface = new CellSurface(places, count, blockBits);
    const ways = new Float64Array(3 * count);
    for (let n = 0; n < count; ++n) {
        if (n % kBetweenStops === 0) {
            yield;
        }
        const i = surface.numbers[n];
        surface.findNeighbors(i);
        if (surface.counts[i] < 3) {
            continue;
        }
        surface.fitPlane(places, i, true);
        const { normal, offset } = surface.plane;
        for (let axis = 0; axis < 3; ++axis) {
            ways[3 * i + axis] = offset * normal[axis];
        }
    }
    return ways;
}

/** Of the first `count` places (3 numbers each), by the blocks of 2^blockBits a side in which they lie. */
export class CellSurface {
    constructor(places, count, blockBits) {
        this.places = places;
        this.blockBits = blockBits;
        this.neighbors = new Uint32Array(kMostNeighbors * count); // of each cell, nearest first
        this.counts = new Uint8Array(count).fill(kUnknown); // of them
        this.shadows = new Uint8Array(count); // 1: a cell of a lower number is the same one
        this.distances = new Float64Array(kMostNeighbors);
        this.spacing = 0; // what findTangent found
        this.plane = { normal: new Float64Array(3), offset: 0, roughness: 0, axis: 0 };
        this.candidateCount = 0;
        this.candidateMiddles = new Int32Array(3 * 1024);
        this.candidateOffsets = new Float64Array(1024); // of the plane, from the middle
        this.candidateContexts = new Uint16Array(1024);

        this.bucketBits = 32 - Math.clz32(count);
        this.begin = new Uint32Array(2 ** this.bucketBits + 1);
        this.numbers = new Uint32Array(count);
        const buckets = new Uint32Array(count);
        for (let i = 0; i < count; ++i) {
            buckets[i] = this.bucketOf(places[3 * i] >> blockBits, places[3 * i + 1] >> blockBits, places[3 * i + 2] >> blockBits);
            ++this.begin[buckets[i] + 1];
        }
        for (let b = 1; b < this.begin.length; ++b) {
            this.begin[b] += this.begin[b - 1];
        }
        this.sorted = new Int32Array(3 * count); // the places as the numbers have them
        const next = this.begin.slice();
        for (let i = 0; i < count; ++i) {
            const to = next[buckets[i]]++;
            this.numbers[to] = i;
            this.sorted[3 * to] = places[3 * i];
            this.sorted[3 * to + 1] = places[3 * i + 1];
            this.sorted[3 * to + 2] = places[3 * i + 2];
        }
    }

    bucketOf(x, y, z) {
        const mixed = Math.imul(x, 73856093) ^ Math.imul(y, 19349663) ^ Math.imul(z, 83492791);
        return this.bucketBits === 0 ? 0 : Math.imul(mixed, 0x9e3779b1) >>> (32 - this.bucketBits);
    }

    /** Looked for in the 27 blocks around, among the first places of each; of places that are the same the first counts. */
    findNeighbors(i) {
        if (this.counts[i] !== kUnknown) {
            return;
        }
        this.counts[i] = 0;
        const { sorted, numbers, begin, blockBits, distances } = this;
        const px = this.places[3 * i];
        const py = this.places[3 * i + 1];
        const pz = this.places[3 * i + 2];
        const x = px >> blockBits;
        const y = py >> blockBits;
        const z = pz >> blockBits;
        let farthest = Infinity; // what a neighbour is to be nearer than
        for (let u = x - 1; u <= x + 1; ++u) {
            for (let v = y - 1; v <= y + 1; ++v) {
                for (let w = z - 1; w <= z + 1; ++w) {
                    const bucket = this.bucketOf(u, v, w);
                    const last = begin[bucket + 1];
                    let seen = 0;
                    for (let at = begin[bucket]; at < last && seen < kMostOfBlock; ++at) {
                        const qx = sorted[3 * at];
                        const qy = sorted[3 * at + 1];
                        const qz = sorted[3 * at + 2];
                        if (qx >> blockBits !== u || qy >> blockBits !== v || qz >> blockBits !== w) {
                            continue;
                        }
                        ++seen;
                        const d = (qx - px) * (qx - px) + (qy - py) * (qy - py) + (qz - pz) * (qz - pz);
                        if (d < farthest) {
                            this.take(i, numbers[at], d);
                            farthest = this.counts[i] === kMostNeighbors ? distances[kMostNeighbors - 1] : Infinity;
                        }
                    }
                }
            }
        }
    }

    /** A place at the squared distance d takes its rank among the neighbours of place i. */
    take(i, other, d) {
        const { places, distances, neighbors } = this;
        const first = kMostNeighbors * i;
        const count = this.counts[i];
        if (d === 0) {
            if (other < i) {
                this.shadows[i] = 1;
            }
            return;
        }
        let at = count;
        while (at > 0 && distances[at - 1] > d) {
            --at;
        }
        for (let same = at - 1; same >= 0 && distances[same] === d; --same) {
            const n = 3 * neighbors[first + same];
            if (places[n] === places[3 * other] && places[n + 1] === places[3 * other + 1] && places[n + 2] === places[3 * other + 2]) {
                return;
            }
        }
        const last = Math.min(count, kMostNeighbors - 1);
        for (let to = last; to > at; --to) {
            distances[to] = distances[to - 1];
            neighbors[first + to] = neighbors[first + to - 1];
        }
        distances[at] = d;
        neighbors[first + at] = other;
        this.counts[i] = last + 1;
    }

    /** The plane of place i and its neighbours, from the place; and the mean distance of its nearest. */
    findTangent(i) {
        const { places, neighbors, counts } = this;
        this.fitPlane(places, i, true);
        const six = Math.min(counts[i], kSpacingNeighbors);
        this.spacing = 0;
        for (let n = 0; n < six; ++n) {
            const other = 3 * neighbors[kMostNeighbors * i + n];
            const dx = places[other] - places[3 * i];
            const dy = places[other + 1] - places[3 * i + 1];
            const dz = places[other + 2] - places[3 * i + 2];
            this.spacing += Math.sqrt(dx * dx + dy * dy + dz * dz);
        }
        if (six > 0) {
            this.spacing /= six;
        }
    }

    /** The plane of the neighbours of place i, and of itself if asked, from it. */
    fitPlane(places, i, withItself) {
        const { neighbors } = this;
        const first = kMostNeighbors * i;
        const count = this.counts[i];
        const all = count + (withItself ? 1 : 0);
        const px = places[3 * i];
        const py = places[3 * i + 1];
        const pz = places[3 * i + 2];
        let mx = 0;
        let my = 0;
        let mz = 0;
        for (let n = 0; n < count; ++n) {
            const q = 3 * neighbors[first + n];
            mx += places[q] - px;
            my += places[q + 1] - py;
            mz += places[q + 2] - pz;
        }
        if (all > 0) {
            mx /= all;
            my /= all;
            mz /= all;
        }
        let xx = 0;
        let xy = 0;
        let xz = 0;
        let yy = 0;
        let yz = 0;
        let zz = 0;
        for (let n = withItself ? -1 : 0; n < count; ++n) {
            const q = 3 * (n < 0 ? i : neighbors[first + n]);
            const x = places[q] - px - mx;
            const y = places[q + 1] - py - my;
            const z = places[q + 2] - pz - mz;
            xx += x * x;
            xy += x * y;
            xz += x * z;
            yy += y * y;
            yz += y * z;
            zz += z * z;
        }
        const { plane } = this;
        const { normal } = plane;
        const of = Math.max(all, 1);
        const lift = 1e-3 * of + 1e-7 * (xx + yy + zz);
        leastAxis(xx + lift, xy, xz, yy + lift, yz, zz + lift, normal);
        const [x, y, z] = normal;
        const square = x * (xx * x + 2 * xy * y + 2 * xz * z) + y * (yy * y + 2 * yz * z) + z * zz * z;
        plane.roughness = Math.sqrt(Math.max(0, square / of));
        plane.offset = x * mx + y * my + z * mz;
        const ax = Math.abs(x);
        const ay = Math.abs(y);
        const az = Math.abs(z);
        plane.axis = az >= ax && az >= ay ? 2 : ay >= ax ? 1 : 0;
    }

    /** Which cells around place i, of 2^lift steps a side, are asked for points: those near its plane, nearer to it than to others. */
    findCandidates(i, lift) {
        this.candidateCount = 0;
        const { places } = this;
        const side = 2 ** (lift + 1);
        const spacing = this.spacing / side;
        if (this.counts[i] < 3 || spacing >= 8 || this.shadows[i] === 1) {
            return;
        }
        const { normal, offset, roughness, axis: a } = this.plane;
        const b = (a + 1) % 3;
        const c = (a + 2) % 3;
        const reach = Math.min(Math.max(1.3 * spacing, 1.5), 5) * side;
        const thickness = 0.75 * side + 1.5 * roughness;
        const steps = Math.ceil(reach / side);
        const spacings = spacingClass(spacing);
        const reachSq = reach * reach;
        const from = [places[3 * i], places[3 * i + 1], places[3 * i + 2]];
        const own = from.map((place) => ((place >> (lift + 1)) * 2 + 1) * 2 ** lift - place); // the way to the middle of its cell
        const [ownA, ownB, ownC] = [own[a], own[b], own[c]];
        const [na, nb, nc] = [normal[a], normal[b], normal[c]];
        for (let u = -steps; u <= steps; ++u) {
            const x = ownB + side * u;
            for (let v = -steps; v <= steps; ++v) {
                const y = ownC + side * v;
                if (x * x + y * y > reachSq) {
                    continue;
                }
                const along = nb * x + nc * y - offset;
                const one = (-thickness - along) / na;
                const other = (thickness - along) / na;
                const low = Math.max(Math.ceil((Math.min(one, other) - ownA) / side), -steps);
                const high = Math.min(Math.floor((Math.max(one, other) - ownA) / side), steps);
                for (let w = low; w <= high; ++w) {
                    const z = ownA + side * w;
                    const d = x * x + y * y + z * z;
                    if (d > reachSq) {
                        continue;
                    }
                    const to = 3 * this.candidateCount;
                    this.candidateMiddles[to + a] = from[a] + z;
                    this.candidateMiddles[to + b] = from[b] + x;
                    this.candidateMiddles[to + c] = from[c] + y;
                    if (this.nearerToAnother(i, to, d)) {
                        continue;
                    }
                    const off = na * z + along;
                    const far = bin((8 * Math.sqrt(d)) / this.spacing, kDistances);
                    const over = bin((6 * Math.abs(off)) / side, kHeights);
                    this.candidateOffsets[this.candidateCount] = -off;
                    this.candidateContexts[this.candidateCount++] = (spacings * kDistances + far) * kHeights + over;
                }
            }
        }
    }

    /** Whether a candidate, of which the middle stands at `at`, is nearer to a neighbour of place i than to that. */
    nearerToAnother(i, at, d) {
        const { places, neighbors } = this;
        const first = kMostNeighbors * i;
        const count = this.counts[i];
        const x = this.candidateMiddles[at];
        const y = this.candidateMiddles[at + 1];
        const z = this.candidateMiddles[at + 2];
        for (let n = 0; n < count; ++n) {
            const other = neighbors[first + n];
            const dx = places[3 * other] - x;
            const dy = places[3 * other + 1] - y;
            const dz = places[3 * other + 2] - z;
            const e = dx * dx + dy * dy + dz * dz;
            if (e < d || (e === d && other < i)) {
                return true;
            }
        }
        return false;
    }
}
