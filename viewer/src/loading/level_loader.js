import { BufferAttribute, BufferGeometry, Vector3 } from 'three';

import { getBytes, persist, readBytes } from '../api/api.js';
import { plyOf } from '../decoding/ply_cloud.js';
import { ProgressiveDecoder } from '../decoding/progressive_cloud.js';
import { middleOf, sourceOf, withSurface } from './level_files.js';
import { isByTiles, kMostPoints, withStream } from './level_plan.js';
import { TileStream } from './tile_stream.js';

/** Attributes of results with `splats: ellipse`. */
const kHalfAxes = ['major', 'minor'];

/** Of attributes, as in openapi.yaml. */
const kTypesOfStream = ['int8', 'uint8', 'int16', 'uint16', 'int32', 'uint32', 'float32', 'float64'];

const kHeaderPiece = 256;

/** A stream is decoded piece by piece, so that the page can be drawn between: bytes, milliseconds. */
const kPieceOfStream = 2_048;
const kBetweenFrames = 20;

/** The first batches of a stream are too few points to look at. */
const kFirstOfStream = 1_000;

/**
 * Brings the levels of one pyramid in, coarsest first. While one is decoded the next one is under way. `update` may be called
 * again whenever the manifest has grown. Where there is a progressive stream, its batches stand for the levels that have not come
 * before it: they are shown as the bytes come. While the server cannot be reached, it is asked again: `onLost` is told.
 *
 * What has no file that can be drawn is not among the `levels`. One that is there is its entry of the manifest with its `source` and `file` (see level_files.js), `attributes` (each can `read` its
 * values), `state` (`listed`, `loading`, `ready`, `large`, `failed`), `arrived` (the bytes of it that are there, while it loads) and, once ready, `geometry`: position, surface (see
 * surface_estimate.js) and perhaps color. Where it has no file to be saved, `ply` gives one.
 * A level with many points has `tiles` (a TileStream) instead, `drawn`, the `points` and the `error` of what is seen of it now, and `whole`, the
 * finest level without, whose geometry stands in until the tiles are there.
 */
export class LevelLoader {
    constructor({ id, onReady, onChange, onBytes, onTiles, onLost, onError, signal }) {
        this.id = id;
        this.levels = [];
        this.loadedBytes = 0;
        this.onReady = onReady;
        this.onChange = onChange;
        this.onBytes = onBytes;
        this.onError = onError;
        this.onTiles = onTiles;
        this.patience = { signal, onLost };
        this.signal = signal;
        this.known = 0;
        this.fetching = Promise.resolve();
        this.decoding = Promise.resolve();
    }

    update(manifest) {
        const first = this.known;
        const entries = manifest.levels.slice(first);
        this.known += entries.length;
        const entry = withStream(entries, this.levels.length === 0);
        if (entry) {
            this.stream = { file: entry.files.find(({ format }) => format === 'stpc'), entry, bounds: manifest.source.bounds, before: [...this.levels], levels: [] };
            this.follow(this.stream);
        } else {
            entries.forEach((_, i) => this.list(manifest, first + i));
        }
        if (manifest.complete) {
            this.streamTiles(manifest);
        }
        if (entries.length > 0) {
            this.onChange();
        }
    }

    list(manifest, number) {
        const source = sourceOf(manifest, number);
        if (!source) {
            return;  // figures alone, or files for other programs
        }
        const entry = manifest.levels[number];
        const hasEllipses = manifest.request.splats === 'ellipse';
        const isAnalysis = manifest.request.type === 'analyze';
        const { file, attributes } = source;
        const ply = file ? null : () => getBytes(`v1/pyramids/${this.id}/slice?points=${entry.points}`);
        const bytes = source.files.reduce((sum, part) => sum + part.bytes, 0);
        const level = { ...entry, source, file, bytes, attributes, ply, hasEllipses, isAnalysis, state: 'listed' };
        this.levels.push(level);
        if (isByTiles(level)) {
            level.isTiled = true;
        } else if (level.points > kMostPoints) {
            level.state = 'large';
        } else {
            this.load(level);
        }
    }

    /** Shows a stream batch by batch, as far as a browser's memory goes. What has been shown before it stays until there is more. */
    async follow({ file, entry, bounds, before, levels }) {
        const decoder = new ProgressiveDecoder();
        const diagonal = Math.hypot(...bounds.max.map((high, axis) => high - bounds.min[axis]));
        let looked = performance.now();
        const pause = async () => {
            if (performance.now() - looked > kBetweenFrames) {
                await new Promise((resolve) => setTimeout(resolve)); // the page goes on meanwhile
                looked = performance.now();
            }
        };
        const take = async (piece) => {
            this.loadedBytes += piece.length;
            for (let rest = piece; rest.length > 0;) {
                // Not beyond the end of a batch, where all points are equally exact; the header comes first.
                const next = decoder.batches.find(({ bytes }) => bytes > decoder.taken);
                const end = next?.bytes ?? decoder.taken + kHeaderPiece;
                const part = rest.subarray(0, Math.min(end - decoder.taken, kPieceOfStream));
                decoder.feed(part);
                rest = rest.subarray(part.length);
                await pause();
                if (levels.length === 0 && decoder.total > 0) {
                    levels.push(...levelsOf(decoder, entry, diagonal, before));
                    this.levels.push(...levels);
                }
                levels.forEach((level) => { level.arrived = Math.min(decoder.taken, level.bytes); });
                this.onBytes();
                const level = levels.find(({ bytes, state }) => bytes === decoder.taken && state !== 'ready');
                if (level) {
                    level.decoder = decoder;
                    await this.show(level, await withSurface(await geometryOf(decoder, pause), level, this.signal));
                }
            }
            return decoder.taken >= levels.at(-1)?.bytes;
        };
        this.isFollowing = true;
        await this.decoding;  // of what is on its way, which is less
        try {
            await persist(() => readBytes(file.href, decoder.taken, take, this.signal), this.patience);
        } catch (error) {
            const [next = entry, ...others] = levels.filter(({ state }) => state === 'loading');
            others.forEach((level) => { level.state = 'failed'; });  // for the same reason
            this.fail(next, error);
        }
        this.isFollowing = false;
        this.onChange();
    }

    async show(level, { geometry, spacing }) {
        Object.assign(level, { geometry, spacing });
        if (level.hasEllipses) {
            await this.readEllipses(level);
        }
        level.isColored = level.geometry.hasAttribute('color');
        level.state = 'ready';
        if (this.signal.aborted) {
            level.geometry.dispose();
        } else {
            this.onReady(level);
        }
    }

    /** What the splats of a result reach, where it was measured. */
    async readEllipses({ geometry, attributes }) {
        for (const { name, read } of attributes.filter(({ name }) => kHalfAxes.includes(name))) {
            geometry.setAttribute(name, new BufferAttribute(await read(this.signal), 3));
        }
    }

    /** Loads what waits until it is asked for, and once more what failed. */
    ask(level) {
        if (level.state !== 'large' && level.state !== 'failed') {
            return;
        }
        if (level.decoder) {
            this.stream.levels.filter(({ state }) => state === 'failed').forEach((failed) => { failed.state = 'loading'; });
            this.follow(this.stream);
        } else {
            this.load(level);
        }
    }

    load(level) {
        level.state = 'loading';
        level.arrived = 0;
        const bytes = this.fetching.then(() => Promise.all(level.source.files.map((file) =>
            persist(() => this.receive(level, file), this.patience))));
        const before = this.decoding;
        this.fetching = bytes.catch(() => {});
        this.decoding = bytes
            .then(async (buffers) => {
                await before;
                const loaded = await persist(() => level.source.load(buffers, level, this.signal), this.patience);  // the decoder comes from there, too
                level.points = loaded.geometry.getAttribute('position').count;
                await this.show(level, loaded);
            })
            .catch((error) => this.fail(level, error));
    }

    /** A file of a level. What came of one that did not come whole counts for the line, not for the level. */
    async receive(level, { href }) {
        let came = 0;
        try {
            return await getBytes(href, this.signal, (bytes, onLine) => {
                came += bytes;
                level.arrived += bytes;
                this.loadedBytes += onLine;
                this.onBytes();
            });
        } catch (error) {
            level.arrived -= came;
            throw error;
        }
    }

    /** Once all levels are there, and those that are loaded whole are shown. */
    streamTiles({ source, request }) {
        const tiled = this.levels.filter(({ isTiled, tiles }) => isTiled && !tiles);
        if (tiled.length === 0) {
            return;
        }
        const tiles = new TileStream(`v1/pyramids/${this.id}/tileset.json`, {
            withAttributes: request.tiles?.attributes === true,
            patience: this.patience,
            onLoaded: (bytes) => {
                this.loadedBytes += bytes;
                this.onTiles({ isNew: true });
            },
            onDrawn: () => this.onTiles({ isNew: false }),
            onError: (error) => this.onError(tiled[0], error),
        });
        for (const level of tiled) {
            level.tiles = tiles;
            level.state = 'loading';
        }
        this.decoding = this.decoding.then(() => {
            const whole = this.levels.findLast(({ state }) => state === 'ready');
            if (!whole) {
                tiled.forEach((level) => { level.state = 'failed'; });  // as those before them
                return;
            }
            // Draco's coordinates may have an origin of their own, the manifest's are those of the file.
            tiles.center = whole.geometry.boundingBox.getCenter(new Vector3()).add(middleOf(source)).sub(middleOf(whole));
            for (const level of tiled) {
                Object.assign(level, {
                    whole, geometry: whole.geometry, spacing: whole.spacing, drawn: { points: whole.points }, bound: null, isColored: whole.isColored, state: 'ready',
                });
                this.onReady(level);
            }
        });
    }

    fail(level, error) {
        level.state = 'failed';
        if (!this.signal.aborted) {
            this.onError(level, error);
        }
    }

    dispose() {
        this.levels.forEach((level) => {
            level.geometry?.dispose();
            level.tiles?.dispose();
        });
    }
}

/**
 * A level for each batch of a stream that is worth a look, with the `decoder` that has its points: another one where it was asked for again.
 * @param before  the levels that have come before it
 */
function levelsOf(decoder, entry, diagonal, before) {
    const least = Math.max(Math.min(kFirstOfStream, decoder.total), ...before.map(({ points }) => points + 1));
    return decoder.batches.filter(({ points }) => points >= least && points <= kMostPoints).map((batch, number) => {
        const level = {
            ...entry,
            level: before.length + number,
            points: batch.points,
            bytes: batch.bytes,
            files: batch.points === entry.points ? entry.files : [],
            error: { relative: { mean: batch.meanError / diagonal } },
            spacing: entry.spacing * Math.sqrt(entry.points / batch.points),
            state: 'loading',
            decoder,
        };
        level.attributes = decoder.layout.attributes.map(({ name, components }, attribute) => ({
            name, components, read: async () => level.decoder.attribute(attribute, level.points),
        }));
        level.ply = async () => plyOfStream(level);
        return level;
    });
}

/** What is shown of a stream as a file: its places are those of then, what else points have does not change. */
function plyOfStream({ decoder, geometry, points }) {
    const { origin, alpha, attributes } = decoder.layout;
    return plyOf({
        count: points,
        origin,
        positions: geometry.getAttribute('position').array,
        normals: decoder.pointNormals(),
        colors: decoder.colors(),
        colorComponents: alpha ? 4 : 3,
        attributes: attributes.map(({ name, type, components }, number) => ({
            name, components, type: kTypesOfStream[type], values: decoder.attribute(number, points),
        })),
    });
}

/** The points of a stream so far. */
async function geometryOf(decoder, pause) {
    const work = decoder.findPositions();
    let step = work.next();
    while (!step.done) {
        await pause();
        step = work.next();
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(step.value, 3));
    const normals = decoder.pointNormals();
    if (normals) {
        geometry.setAttribute('normal', new BufferAttribute(normals, 3));
    }
    const colors = decoder.colors();
    if (colors) {
        geometry.setAttribute('color', new BufferAttribute(colors, decoder.layout.alpha ? 4 : 3, true));
    }
    return geometry;
}
