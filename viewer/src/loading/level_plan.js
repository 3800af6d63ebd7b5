// How a level is brought in: whole, by tiles as the camera asks for them, or as the batches of a progressive stream.

/** Of levels with more points than this only the tiles are loaded that the camera asks for; the address can have another number. */
export const kMostWhole = Number(new URLSearchParams(location.search).get('whole')) || 500_000;

/** Where there are no tiles, finer levels than this wait until they are asked for: a browser's memory is not a server's. */
export const kMostPoints = 8_000_000;

/** Whether a level is large and has tiles, and a coarser one to stand in for them. */
export const isByTiles = ({ level, points, files }) => level > 0 && points > kMostWhole && files.some(({ format }) => format === 'glb');

/**
 * The level whose stream is followed in place of all that are new, or undefined: a stream is whole or nothing, so that it is for clouds
 * that are loaded as a whole. Where coarser levels have been shown, it goes on from there; one too large for that waits like them.
 * @param entries  of the manifest that are new; @param isFirst  whether nothing is shown before
 */
export const withStream = (entries, isFirst) => entries.find((entry) =>
    entry.files.some(({ format }) => format === 'stpc') && !isByTiles(entry) && (isFirst || entry.points <= kMostPoints));
