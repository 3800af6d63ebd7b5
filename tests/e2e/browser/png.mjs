import assert from 'node:assert/strict';
import { inflateSync } from 'node:zlib';

/** The pixels of a screenshot: 8 bits a channel, not interlaced, as browsers write them. */
export function decodePng(file) {
    const width = file.readUInt32BE(16);
    const height = file.readUInt32BE(20);
    const channels = { 2: 3, 6: 4 }[file[25]];
    assert.ok(file[24] === 8 && channels && file[28] === 0, 'a PNG of 8-bit RGB or RGBA, not interlaced');
    const rows = inflateSync(Buffer.concat(dataChunks(file)));
    const stride = width * channels;
    const data = Buffer.alloc(stride * height);
    for (let y = 0; y < height; y += 1) {
        unfilter(rows[(stride + 1) * y], rows.subarray((stride + 1) * y + 1, (stride + 1) * (y + 1)), data, stride * y, stride, channels);
    }
    return { data, channels, count: width * height };
}

function dataChunks(file) {
    const chunks = [];
    for (let at = 8; at < file.length; at += 12 + file.readUInt32BE(at)) {
        if (file.toString('latin1', at + 4, at + 8) === 'IDAT') {
            chunks.push(file.subarray(at + 8, at + 8 + file.readUInt32BE(at)));
        }
    }
    return chunks;
}

/** PNG specification, section 9: each byte is told against those to the left, above, and both. */
function unfilter(type, row, data, start, stride, channels) {
    for (let i = 0; i < stride; i += 1) {
        const left = i >= channels ? data[start + i - channels] : 0;
        const above = start > 0 ? data[start + i - stride] : 0;
        const corner = start > 0 && i >= channels ? data[start + i - stride - channels] : 0;
        data[start + i] = row[i] + [0, left, above, (left + above) >> 1, paeth(left, above, corner)][type];
    }
}

function paeth(left, above, corner) {
    const toLeft = Math.abs(above - corner);
    const toAbove = Math.abs(left - corner);
    const toCorner = Math.abs(left + above - 2 * corner);
    if (toLeft <= toAbove && toLeft <= toCorner) {
        return left;
    }
    return toAbove <= toCorner ? above : corner;
}
