// How far a level is from the input, as the manifest tells it of what is loaded.
import * as format from '../page/format.js';

/** Relative to the size of the cloud, in the form that is loaded; not a number where it was not measured. */
export const meanErrorOf = (level) =>
    (level.tiles && level.decoded && level.error ? level.decoded.error.mean / level.error.diagonal : wholeErrorOf(level)?.mean) ?? NaN;

/**
 * Of a level loaded as a whole, with what its files round; `error.diagonal` is 0 where all points coincide. Of a file it `isBound`: that of the
 * level and the largest rounding.
 */
export function wholeErrorOf({ file, source, decoded, error }) {
    const rounded = file ? file.error : source && decoded?.error;
    return rounded && error?.diagonal > 0
        ? { mean: rounded.mean / error.diagonal, max: rounded.max / error.diagonal, isBound: Boolean(file) }
        : error?.relative;
}

/** `≤ 0.003 %` of a bound. */
export const errorText = ({ mean, isBound }) => `${isBound && mean > 0 ? '\u2264\u00a0' : ''}${format.percent(mean)}`;

/** Half width of the 95 % confidence interval of a level's mean, relative to the size of the cloud; nothing where it is not known. */
export const confidenceOf = ({ error }) => error?.forward?.relative?.mean_confidence;

/** `mean` and `max` of what is seen of a level, relative to the size of the cloud; nothing where it was not measured. */
export const drawnErrorOf = (level) => (level.drawn ? level.drawn.error : wholeErrorOf(level));
