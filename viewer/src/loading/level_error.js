// How far a level is from the input, as the manifest tells it of what is loaded.
import * as format from '../page/format.js';

const kLittle = 0.1;  // as a part of what a file rounds, which is what it moves a point by at most: the mean distance is well within

/** Relative to the size of the cloud, in the form that is loaded; not a number where it was not measured. */
export const meanErrorOf = (level) =>
    (level.tiles && level.decoded && level.error ? level.decoded.error.mean / level.error.diagonal : wholeErrorOf(level)?.mean) ?? NaN;

/**
 * Of a level loaded as a whole, with what its files round; `error.diagonal` is 0 where all points coincide. The mean is one of samples, sure to within
 * its `confidence` (see `confidenceOf`). Of a file it has the largest `rounding` in it.
 */
export function wholeErrorOf({ file, source, decoded, error }) {
    const rounded = file ? file.error : source && decoded?.error;
    if (!rounded || !(error?.diagonal > 0)) {
        return error?.relative && { ...error.relative, confidence: confidenceOf({ error }) };
    }
    const [mean, max] = [rounded.mean, rounded.max].map((distance) => distance / error.diagonal);
    return file ? { mean, max, confidence: confidenceOf({ error }), rounding: Math.max(0, mean - error.mean / error.diagonal) }
        : { mean, max, confidence: intervalOf(rounded, error.diagonal) };
}

/**
 * Half width of the 95 % confidence interval of a level's mean, relative to the size of the cloud: 0 where it was no matter of chance, infinite where
 * it is not known.
 */
const confidenceOf = ({ error: { forward } }) => (forward ? intervalOf({ ...forward, ...forward.relative }, 1) : 0);

const intervalOf = ({ mean_confidence: half = 0, samples }, diagonal) => (samples === 1 ? Infinity : half / diagonal);

/** Of few samples that met an error at all no interval holds. */
const isRough = ({ mean, confidence }) => 2 * confidence > mean;

/** `≤ 0.003 %` of what is a bound, since next to what the file rounds the rest is sure; of an estimate `0.196 % ± 0.03 %`, or, `isShort`, `≈ 0.196 %`. */
export function errorText(error, { isShort = false } = {}) {
    const { mean, confidence = 0, rounding = 0 } = error;
    const text = format.percent(mean);
    if (rounding > 0 && confidence <= kLittle * rounding) {
        return `\u2264\u00a0${text}`;
    }
    return confidence > 0 && (isShort || isRough(error)) ? `\u2248\u00a0${text}` : text + intervalText(error);
}

/** ` ± 0.03 %`, where there is one that holds. */
export const intervalText = ({ mean, confidence = 0 }) =>
    (confidence > 0 && !isRough({ mean, confidence }) ? ` \u00b1\u00a0${format.percent(Number(confidence.toPrecision(2)))}` : '');

/** `mean` and `max` of what is seen of a level, relative to the size of the cloud; nothing where it was not measured. */
export const drawnErrorOf = (level) => (level.drawn ? level.drawn.error : wholeErrorOf(level));
