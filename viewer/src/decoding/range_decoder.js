// The entropy decoder of progressive streams (docs/progressive-stream.md): bits by their probabilities, and numbers made of them.

const kMemory = 63;

export const bitWidth = (value) => 32 - Math.clz32(value);

/** Of each bit how probable a 0 is, of 2^16, and how many were seen. */
export class Bits {
    constructor(count) {
        this.zero = new Uint16Array(count).fill(1 << 15);
        this.seen = new Uint8Array(count);
    }
}

/** A binary range decoder, which reads zeros behind the end. */
export class RangeDecoder {
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
export class SignedModel {
    constructor(trees) {
        this.sizes = new Bits(16 * trees);
        this.larger = new Bits(32);
        this.second = new Bits(33);
        this.sign = new Bits(1);
    }

    decode(coder, tree, most) {
        let size = coder.tree(this.sizes, 16 * tree, 16);
        if (size === 15) {
            size = Math.min(15 + coder.tree(this.larger, 0, 32), most);
        }
        if (size === 0) {
            return 0;
        }
        const negative = coder.bit(this.sign, 0);
        let value = 1;
        if (size >= 2) {
            const second = coder.bit(this.second, size);
            value = (2 + second) * 2 ** (size - 2) + coder.wide(size - 2);
        }
        return negative ? -value : value;
    }
}
