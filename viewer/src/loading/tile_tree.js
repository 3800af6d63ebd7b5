// A tileset as our server writes it: an explicit tree whose tiles are replaced by their children, or added to by them.

/**
 * A tile from its JSON, with all below. `center` and `half` of its box are relative to the middle of the source's bounds.
 * Its error is what 99 % of its surface stay below: the geometric error of 3D Tiles is the largest one, that of a few stray
 * points of a noisy scan. `measured` is that of all its points, `surface` about the area that they stand for. `state`: `listed`,
 * `loading`, `ready` or `failed`. `shownSpacing`: between the points that are drawn there. `isLast`: whether somewhere in it no tile adds to it.
 * A tile without content is a `group`: its children stand in its place, and on its level.
 */
export function treeOf({ boundingVolume: { box }, geometricError, refine, content, extras, children = [] }, level = 0) {
    return {
        level,
        adds: refine === 'ADD',
        center: box.slice(0, 3),
        half: [box[3], box[7], box[11]],
        error: extras ? Math.max(extras.error?.p99 ?? 0, extras.spacing) : geometricError,
        count: extras?.points,
        spacing: extras?.spacing,
        shownSpacing: extras?.spacing,
        measured: extras?.error,
        surface: extras ? extras.points * extras.spacing ** 2 : 0,
        uri: content?.uri ?? null,
        children: children.map((child) => treeOf(child, content ? level + 1 : level)),
        isGroup: !content,
        state: content ? 'listed' : 'ready',
        usedAt: 0,
        isLast: true,
    };
}

/**
 * How far what is drawn is from the input, in parts of its diagonal: `mean` over the surface, sure to within its `confidence`, since each tile has samples of
 * its own, and `max`; null for what was not measured. Of tiles that add to others each tells the error of all that is there with it, so that those count to
 * which somewhere nothing is added.
 */
export function errorOfTiles(tiles, diagonal) {
    const last = tiles.filter(({ isLast }) => isLast);
    const surface = last.reduce((sum, tile) => sum + tile.surface, 0);
    if (!(surface > 0) || last.some(({ measured }) => !(measured?.mean >= 0))) {
        return null;
    }
    return {
        mean: last.reduce((sum, tile) => sum + tile.surface * tile.measured.mean, 0) / surface / diagonal,
        confidence: Math.hypot(...last.map((tile) => tile.surface * (tile.measured.meanConfidence ?? 0))) / surface / diagonal,
        max: last.reduce((largest, { measured }) => Math.max(largest, measured.max), 0) / diagonal,
    };
}

/** What is below a tile: of a group its members. */
const partsOf = ({ children }) =>
    (children.some(({ isGroup }) => isGroup) ? children.flatMap((child) => (child.isGroup ? partsOf(child) : [child])) : children);

/**
 * The tiles that show the whole of what is seen with an error of at most `view.pixels`, as far as they are there: where some of the
 * finer ones are not, the coarser one stands in for all of them.
 * @param view  `sees(tile)`, `errorOf(tile)` in pixels, `pixels`, the levels `coarsestLevel` and
 * `finestLevel` to stay between, `now`: a number that grows; `bound`, where there is one, of the mean error of every tile
 * @returns {{drawn: object[], wanted: object[]}} what to draw, and what to load for it, most wanted first
 */
export function select(root, view) {
    const drawn = [];
    const wanted = [];

    /** What adds to a tile is drawn with it, and makes its splats smaller once all of it is there. */
    function addTo(tile, isFine) {
        drawn.push(...(tile.cloud ? [tile] : []));
        tile.shownSpacing = tile.spacing;
        tile.isLast = isFine;
        if (!isFine) {
            const parts = partsOf(tile);
            parts.forEach(visit);
            const seen = parts.filter(view.sees);
            const added = seen.map((child) => (child.cloud ? child.shownSpacing : tile.spacing));
            tile.shownSpacing = Math.min(tile.spacing, Math.max(0, ...added) || tile.spacing);
            tile.isLast = seen.length === 0 || seen.some(({ cloud }) => !cloud);
        }
        return true;
    }

    /** Whether what is seen of the tile is drawn. */
    function visit(tile) {
        if (!view.sees(tile)) {
            return true;
        }
        tile.usedAt = view.now;
        const error = view.errorOf(tile);
        const isFine = tile.children.length === 0 || (!tile.isGroup && (tile.level >= view.finestLevel ||
            (tile.level >= view.coarsestLevel && error <= view.pixels && !(tile.measured?.mean > view.bound))));
        if (tile.adds && tile.state === 'ready') {
            return addTo(tile, isFine);
        }
        if (!isFine && !tile.adds) {
            const before = drawn.length;
            if (partsOf(tile).map(visit).every(Boolean)) {
                return true;
            }
            drawn.length = before;
        }
        if (tile.state === 'ready') {
            if (tile.cloud) {
                drawn.push(tile);
            }
            return Boolean(tile.cloud);
        }
        if (tile.state === 'listed') {
            wanted.push({ tile, error });
        }
        return tile.state === 'failed';
    }

    visit(root);
    wanted.sort((a, b) => a.tile.level - b.tile.level || b.error - a.error);
    return { drawn, wanted: wanted.map(({ tile }) => tile) };
}
