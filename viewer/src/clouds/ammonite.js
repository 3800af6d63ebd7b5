// A cloud to try the page with, where there is none: the shell of core's synthetic scan, by the same equations (D. M. Raup, 1966).
import { plyOf } from '../decoding/ply_cloud.js';

const kPoints = 160_000;
const kTurns = 5;
const kLog2Growth = 1.07;  // a whorl is 2.1 times as wide as the one inside it
const kMouthRadius = 70;   // from the axis to the middle of the tube at the mouth
const kTubeRatio = 0.335;
const kFlatness = 0.8;
const kMouthAngle = 0.08;
const kRibsPerTurn = 36;
const kGolden = 0.6180339887498949;
const kGlaze = [[176, 74, 40], [226, 160, 66], [146, 176, 84], [44, 148, 128], [52, 96, 156]];  // mother-of-pearl, sRGB

const sine = (turns) => Math.sin(2 * Math.PI * turns);
const cosine = (turns) => Math.cos(2 * Math.PI * turns);

/** 0 between the crests, 1 on them. */
const ridge = (x) => (2 * (x - Math.floor(x)) - 1) ** 2;
const rib = (turn, around) => ridge(kRibsPerTurn * turn + 0.8 * cosine(around));

/** The bytes of a PLY file: points spread evenly over the shell, in colours. */
export function ammonite() {
    const positions = new Float32Array(3 * kPoints);
    const colors = new Uint8Array(3 * kPoints);
    for (let i = 0; i < kPoints; i += 1) {
        const turn = turnAt((i + 0.5) / kPoints);
        const around = (i * kGolden) % 1;
        positions.set(shell(turn, around), 3 * i);
        colors.set(glaze(turn, around), 3 * i);
    }
    return plyOf({ count: kPoints, origin: [0, 0, 0], positions, normals: null, colors, colorComponents: 3, attributes: [] });
}

/** Where a share of the shell's area is inside: it grows by the square of the width. */
function turnAt(share) {
    const inmost = 4 ** (-kLog2Growth * kTurns);
    return kTurns + Math.log2(inmost + share * (1 - inmost)) / (2 * kLog2Growth);
}

/** @param around  in turns: 0 at the keel, 0.5 at the whorl inside */
function shell(turn, around) {
    const outer = 0.5 + 0.5 * cosine(around);
    const keel = Math.max(0, 1 - Math.abs(around - Math.floor(around + 0.5)) / 0.035);
    const relief = 1 + (0.02 + 0.06 * outer) * rib(turn, around) + 0.07 * keel + 0.004 * sine(9 * kRibsPerTurn * turn);
    const fromAxis = kMouthRadius * 2 ** (kLog2Growth * (turn - kTurns));
    const tube = kTubeRatio * fromAxis * relief;
    const reach = fromAxis + tube * cosine(around);
    const angle = turn - kTurns + kMouthAngle;
    return [reach * cosine(angle), reach * sine(angle), kFlatness * tube * sine(around)];
}

/** Bands that follow the whorls, lighter on the crests of the ribs. */
function glaze(turn, around) {
    const at = (kGlaze.length - 1) * (0.5 + 0.28 * sine(0.85 * turn + 0.3 * cosine(around)) + 0.2 * sine(2.3 * turn + around));
    const below = Math.min(kGlaze.length - 2, Math.floor(at));
    const light = 0.8 + 0.2 * rib(turn, around);
    return kGlaze[below].map((channel, k) => light * (channel + (at - below) * (kGlaze[below + 1][k] - channel)));
}
