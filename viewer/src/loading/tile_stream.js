import { Box3, Frustum, Matrix4 } from 'three';

import { getBytes, getJson, persist } from '../api/api.js';
import { wholeErrorOf } from './level_error.js';
import { geometryOf } from './level_files.js';
import { readFilesInWorker } from './surface.js';
import { errorOfTiles, select, treeOf } from './tile_tree.js';

const kPixels = 2;              // of error
const kAtOnce = 6;              // requests on their way
const kMostPoints = 8_000_000;  // kept, drawn or not

/** The tiles of a pyramid: those are loaded that the camera asks for. */
export class TileStream {
    /**
     * @param url  of the tileset; @param withAttributes  whether its tiles have the attributes of the cloud
     * @param patience  with a server that cannot be reached, see `persist`
     * @param onLoaded  called when there is more to draw, with the bytes that came; @param onDrawn  when something else is drawn
     */
    constructor(url, { withAttributes, patience, onLoaded, onDrawn, onError }) {
        Object.assign(this, { url, withAttributes, patience, onLoaded, onDrawn, onError });
        this.signal = patience.signal;
        this.center = null;  // where the middle of the source is, which the tiles' coordinates are relative to
        this.root = null;
        this.ready = new Set();
        this.points = 0;    // of those
        this.loading = 0;
        this.isComplete = false;  // whether what was selected last lacks nothing
        this.now = 0;
        persist(() => getJson(url, this.signal), patience).then(({ root }) => {
            this.root = treeOf(root);
            onLoaded(0);
        }).catch((error) => this.fail(error));
    }

    /**
     * What to draw of a level for a camera: tiles with their `cloud` (geometry) and `spacing`, nowhere coarser than its `whole`. With
     * a `bound` of the level, relative to the cloud's size, the tiles are as fine as that asks, on every level.
     * @param offset  from the tiles' coordinates to those of the camera; @param height  of the picture, pixels
     */
    select(camera, level, { offset, height }) {
        if (!this.root) {
            return [];
        }
        this.now += 1;
        const { bound } = level;
        const { drawn, wanted } = select(this.root, {
            ...viewOf(camera, offset, height), pixels: kPixels, coarsestLevel: level.whole.level, now: this.now,
            ...(bound === null ? { finestLevel: level.level } : { finestLevel: Infinity, bound: bound * level.error.diagonal }),
        });
        const isWanting = wanted.length > 0 && this.makeRoom();
        if (isWanting) {
            wanted.slice(0, kAtOnce - this.loading).forEach((tile) => this.load(tile));
        }
        const isComplete = !isWanting && this.loading === 0;
        if (isComplete !== this.isComplete) {
            this.isComplete = isComplete;
            queueMicrotask(this.onDrawn);
        }
        return drawn;
    }

    /** What is drawn of a level: tiles, or, null, the coarser level that stands in for them. */
    note(level, tiles) {
        const points = tiles ? tiles.reduce((sum, tile) => sum + tile.points, 0) : level.whole.points;
        const error = tiles && level.error ? errorOfTiles(tiles, level.error.diagonal) : wholeErrorOf(level.whole);
        if (points !== level.drawn.points || error?.mean !== level.drawn.error?.mean) {
            level.drawn = { points, error };
            queueMicrotask(this.onDrawn);
        }
    }

    async load(tile) {
        tile.state = 'loading';
        this.loading += 1;
        let bytes = 0;
        try {
            const address = new URL(tile.uri, new URL(this.url, location.href)).href;
            if (tile.uri.endsWith('.json')) {
                // A part of the tree that has a file of its own; its root is this tile.
                const { root } = await persist(() => getJson(address, this.signal), this.patience);
                Object.assign(tile, treeOf(root, tile.level));
            } else {
                const glb = await persist(() => getBytes(address, this.signal, (_, onLine) => { bytes += onLine; }), this.patience);
                const what = { files: [glb], kind: 'glb', offset: [0, 0, 0], isTile: true };
                const read = await readFilesInWorker(what, { spacing: tile.spacing, points: tile.count }, this.signal);
                tile.spacing = read.spacing;
                tile.cloud = geometryOf(read);
                tile.attributes = read.attributes;
                tile.points = tile.cloud.getAttribute('position').count;
                tile.state = 'ready';
                this.ready.add(tile);
                this.points += tile.points;
            }
        } catch (error) {
            tile.state = 'failed';
            this.fail(error);
        }
        this.loading -= 1;
        if (!this.signal.aborted) {
            this.onLoaded(bytes);
        }
    }

    /** Gives up what was not seen for longest, by either of two panes, where too much is kept; whether there is room for more. */
    makeRoom() {
        const unseen = this.points > kMostPoints
            ? [...this.ready].filter(({ usedAt }) => usedAt < this.now - 1).sort((a, b) => a.usedAt - b.usedAt) : [];
        for (const old of unseen) {
            if (this.points > kMostPoints) {
                this.points -= old.points;
                this.ready.delete(old);
                old.cloud.dispose();
                old.cloud = old.attributes = null;
                old.state = 'listed';
            }
        }
        return this.points <= kMostPoints;
    }

    fail(error) {
        if (!this.signal.aborted) {
            this.onError(error);
        }
    }

    dispose() {
        this.ready.forEach(({ cloud }) => cloud.dispose());
    }
}

function viewOf(camera, offset, height) {
    const move = new Matrix4().makeTranslation(offset);
    const frustum = new Frustum().setFromProjectionMatrix(
        camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).multiply(move));
    const eye = camera.position.clone().sub(offset);
    const pixelsPerUnit = 0.5 * height / Math.tan(camera.fov * Math.PI / 360);
    const box = new Box3();
    const boxOf = ({ center, half }) => {
        box.min.set(...center.map((x, k) => x - half[k]));
        box.max.set(...center.map((x, k) => x + half[k]));
        return box;
    };
    return {
        sees: (tile) => frustum.intersectsBox(boxOf(tile)),
        errorOf: (tile) => tile.error * pixelsPerUnit / Math.max(boxOf(tile).distanceToPoint(eye), 1e-9 * tile.error),
    };
}
