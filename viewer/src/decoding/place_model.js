// Where the points of a progressive stream are (docs/progressive-stream.md): the bits of their places, by the plane of their neighbours.

import { bin, kCandidateContexts, kSpacingClasses, spacingsOf } from './cell_surface.js';
import { Bits, bitWidth, SignedModel } from './range_decoder.js';

const kPositionBits = 25;
const kScales = 32;
const kRelative = 8;
const kAcross = 16;
const kAcrossPlane = 24;
const kRough = 8;
const kAlong = 8;
const kToward = 8;

/** Two to an octave. */
function scaleOf(length) {
    if (length < 2) {
        return length;
    }
    const size = bitWidth(length);
    return Math.min(2 * size - 2 + ((length >>> (size - 2)) & 1), kScales - 1);
}

/** Probabilities of where points are. */
export class PlaceModel {
    constructor() {
        this.candidates = new Bits(4 * kCandidateContexts);
        this.more = new Bits(2 * kSpacingClasses);
        this.fars = new Bits(3 * kScales * 4);
        this.first = new SignedModel(kScales);
        this.second = new SignedModel(kScales * kRelative);
        this.across = new SignedModel(kAcross * kAcross);
        this.alongSplit = new Bits((kRough / 2) * kAlong);
        this.alongNew = new Bits(kToward * kAlong);
        this.acrossSplit = new Bits(kRough * kAcrossPlane);
        this.acrossNew = new Bits(kRough * kAcrossPlane);
        this.moved = [0, 0, 0];
        this.found = [0, 0, 0]; // the bits of a place
    }

    /** Whether one more point lies in a cell that has got `found`; `nearest`: how far off the nearest that came lies, in sides. */
    candidate(coder, context, nearest, found) {
        if (found > 0) {
            return coder.bit(this.more, 2 * spacingsOf(context) + Math.min(found, 2) - 1) === 1;
        }
        const near = nearest < 0.7 ? 0 : nearest < 1.0 ? 1 : nearest < 1.5 ? 2 : 3;
        return coder.bit(this.candidates, 4 * context + near) === 1;
    }

    /** Whether one more point is told by its offset from one that has got `told` so. */
    far(coder, { spacing, plane }, told) {
        const scale = scaleOf(Math.floor(0.5 * spacing));
        const context = (Math.min(told, 2) * kScales + scale) * 4 + bin((16 * plane.roughness) / spacing, 4);
        return coder.bit(this.fars, context) === 1;
    }

    /** The offset of a point, in steps: in the tangent plane, then from it. */
    offset(coder, { spacing, plane }) {
        const { normal, axis: a } = plane;
        const b = (a + 1) % 3;
        const c = (a + 2) % 3;
        const scale = scaleOf(Math.floor(0.5 * spacing));
        const offset = [0, 0, 0];
        offset[b] = this.first.decode(coder, scale, kPositionBits);
        const relative = Math.min(Math.max(scaleOf(Math.abs(offset[b])) - scale + 5, 0), kRelative - 1);
        offset[c] = this.second.decode(coder, kRelative * scale + relative, kPositionBits);
        const along = 0.5 * plane.offset - (normal[b] * offset[b] + normal[c] * offset[c]);
        const expected = Math.floor(0.5 + along / normal[a]);
        const distance = Math.min(scaleOf(Math.max(Math.abs(offset[b]), Math.abs(offset[c]))), kAcross - 1);
        const rough = bin(2 * plane.roughness, kAcross);
        offset[a] = expected + this.across.decode(coder, kAcross * rough + distance, kPositionBits);
        return offset;
    }

    /** The bits of a point whose cell is split; the plane is seen from its middle. */
    split(coder, plane, planes) {
        return this.bits(coder, plane, plane.offset, planes, null);
    }

    /** The same of a point that came in a cell, `way` from its middle to the point around which it was asked for. */
    placeWithin(coder, plane, offset, planes, way) {
        return this.bits(coder, plane, offset, planes, way);
    }

    /** One plane of bits after the other, of each the axes along the surface first. */
    bits(coder, { normal: n, roughness, axis: a }, offset, planes, way) {
        const { moved, found: bits } = this;
        moved.fill(0);
        bits.fill(0);
        for (let p = planes - 1; p >= 0; --p) {
            const quarter = 2 ** p;
            const size = 4 * quarter;
            const rough = bin((8 * roughness) / size, kRough);
            for (let turn = 1; turn <= 3; ++turn) {
                const axis = (a + turn) % 3;
                const height = (offset - (n[0] * moved[0] + n[1] * moved[1] + n[2] * moved[2])) / size;
                let bit;
                if (axis === a) {
                    const context = rough * kAcrossPlane + bin(12 + (12 * height) / n[axis], kAcrossPlane);
                    bit = coder.bit(way ? this.acrossNew : this.acrossSplit, context);
                } else {
                    const context = bin(4 + 6 * height * n[axis], kAlong);
                    bit = way
                        ? coder.bit(this.alongNew, bin(4 + (4 * (way[axis] - moved[axis])) / size, kToward) * kAlong + context)
                        : coder.bit(this.alongSplit, (rough >> 1) * kAlong + context);
                }
                bits[axis] = 2 * bits[axis] + bit;
                moved[axis] += bit ? quarter : -quarter;
            }
        }
        return bits;
    }
}
