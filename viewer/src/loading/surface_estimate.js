// Normals by the plane through the nearest neighbours (Pauly, Gross, Kobbelt 2002, §2), splat sizes by the cell that a point has
// among them in its tangent plane (as the Voronoi cells of Dyer, Zhang, Möller 2009): where three cells meet, three discs have to.
// Where the neighbours of the same sheet do not lie about a plane, as in leaves, a splat is a round one that faces the viewer: its
// normal is shorter.

const kLargest = 6;             // radius, spacings of the part that the point is in
const kLargestInTiles = 3;      // for beyond the border of a tile lie points of another
const kSparser = 4;             // spacings of parts are told apart by powers of this,
const kSparsest = 16;           // up to this many times the spacing of all
const kGrid = 2.5;              // cells of a grid, spacings
const kFewSparse = 0.002;       // of the points: so few are no part of the surface, but strays
const kLargestSparse = 1.5;     // spacings: of points with hardly a neighbour, unless they are of a sparser part
const kSmallestRadius = 0.5;
const kNeighbors = 16;
const kSpacingNeighbor = 5;     // the sixth nearest: a hexagonal ring
const kOverlap = 1.25;          // of discs beyond where cells meet: what overlaps blends
const kByDistance = 0.95;       // and no smaller than this by the sixth nearest: scans have gaps where their strips meet
const kOpenByReach = 0.6;       // where a cell is open, by the farthest neighbour: where points stand in bunches, or end
// Where points lie evenly, as those of coarse levels do, it takes less, and less reaches beyond edges and silhouettes:
const kClosedByDistanceIfEven = 0.75;
const kBorderByDistanceIfEven = 0.5;
const kBlobByDistanceIfEven = 0.4;
const kLargestBlobIfEven = 1.2;
const kAskedForEvenness = 255;
const kUneven = 0.42, kEven = 0.54;  // the nearest by the sixth nearest, in the mean: by chance 0.37, in a square grid 0.71
const kWide = 0.5;              // how wide a neighbourhood is by its length, as moments, where points lie alike to all sides
const kOneSided = 0.35;         // how far its middle is off, by its distances: 0.6 at a border
const kLine = 0.15;             // how wide a horn or a wire is by its length, as moments, which is open, too; the corner of a sheet: 0.22
const kWindow = 0.56;           // of the farthest neighbour: corners of a cell farther off than half may be those of points unseen
const kInWindow = 0.9;          // between an octagon's inner and outer circle
const kBlobByDistance = 0.5;    // of a splat that faces the viewer
const kLargestBlob = 2.5;       // spacings: what stands alone is no surface
const kSteepest = 3;            // slope at which a neighbour belongs to another sheet
const kWeightReach = 1.2;       // of neighbours in a plane: where their weight would be 0, by the farthest's squared distance
const kLeastCosine = 0.5;       // between two normals of a sheet, of either sign
const kLeastHeightSq = 0.09;    // of the far side of a wall, whose normals look the other way, by squared distance
const kLeastOfSheet = 3;        // neighbours that tell whether a normal is true
const kFlat = 0.22;             // roughness (height above the plane, by distance) up to which a normal is true
const kRough = 0.5;             // and from which it tells nothing; of points all around it is 0.58
const kLeastNormal = 0.12;      // the length that says so: its direction still lights a little
const kFull = 32767;
const kCorners = 8;             // of a cell that no neighbour bounds
const kCornersX = Float64Array.from({ length: kCorners }, (_, k) => Math.cos(2 * Math.PI * k / kCorners));
const kCornersY = Float64Array.from({ length: kCorners }, (_, k) => Math.sin(2 * Math.PI * k / kCorners));
const kMostMet = 1024;          // points looked at for one: of more in one place, those that come first are enough
const kAskedForGap = 31;        // points that tell a spacing
const kFarOff = 4;              // median gaps: a longer spacing is that of a few points far off

/** A splat's radius is stored as a fraction of this many spacings. */
export const kLargestRadius = kLargest * kSparsest;

/**
 * A spacing that a few points far off do not stretch: a mean of theirs would put all others into one cell.
 * @returns {number} `spacing`, or the middle one of some points' distances to the nearest in another place, where that is far less or nothing was
 * told; 0 of one place alone
 */
export function robustSpacing(positions, spacing) {
    const count = positions.length / 3;
    const gaps = [];
    for (let asked = 0; asked < kAskedForGap; asked += 1) {
        const at = 3 * Math.floor((asked + 0.5) * count / kAskedForGap);
        const x = positions[at], y = positions[at + 1], z = positions[at + 2];
        let least = Infinity;
        for (let i = 0; i < positions.length; i += 3) {
            const dx = positions[i] - x, dy = positions[i + 1] - y, dz = positions[i + 2] - z;
            const distanceSq = dx * dx + dy * dy + dz * dz;
            if (distanceSq > 0 && distanceSq < least) {
                least = distanceSq;
            }
        }
        gaps.push(Math.sqrt(least));
    }
    const median = gaps.sort((a, b) => a - b)[kAskedForGap >> 1];
    return spacing > 0 && spacing <= kFarOff * median ? spacing : Number.isFinite(median) ? median : 0;
}

/**
 * @param {Float32Array} positions  x y z of each point
 * @param {?Float32Array} normals  kept as they are; those without a direction, or null: estimated, of either sign
 * @param {number} spacing  mean distance to the nearest other point
 * @param {boolean} isTile  whether beyond the border lie points of other tiles
 * @returns {Int16Array} of each point: normal (0 0 0 where it has none, shorter where it is in doubt) and radius, as fractions of 32767
 */
export function estimateSurface(positions, normals, spacing, isTile = false) {
    const count = positions.length / 3;
    const surface = new Int16Array(4 * count);
    if (normals) {
        for (let i = 0; i < count; i += 1) {
            storeUnit(surface, i, normals[3 * i], normals[3 * i + 1], normals[3 * i + 2]);
        }
    }
    if (!(spacing > 0)) {
        for (let i = 0; i < count; i += 1) {
            surface[4 * i + 3] = kFull / kLargestRadius;
        }
        return surface;
    }
    const largest = (isTile ? kLargestInTiles : kLargest) * spacing;
    const grid = new PointGrid(positions, kGrid * spacing);
    const nearest = new Nearest(kNeighbors);
    const cloud = { normals, spacing, nearest, cell: new TangentCell(), sizes: splatSizes(evenness(grid, nearest)) };
    const isSparse = new Uint8Array(count);
    for (let at = 0; at < count; at += 1) {
        const i = grid.members[at];
        grid.nearestTo(at, nearest);
        if (!hasNormal(surface, i) && nearest.count >= 3) {
            storePlaneNormal(surface, i, grid.positions, at, nearest);
        }
        isSparse[i] = nearest.count <= kSpacingNeighbor ? 1 : 0;
        const most = isSparse[i] ? kLargestSparse * spacing : largest;
        const radius = splatRadius(surface, i, grid, at, cloud);
        storeRadius(surface, i, Math.min(most, Math.max(kSmallestRadius * spacing, radius ?? spacing)), spacing);
    }
    closeSparseParts(surface, isSparse, positions, cloud);
    return surface;
}

/** How evenly points lie, 0..1, by some of them. */
function evenness(grid, nearest) {
    const count = grid.members.length;
    let asked = 0, sum = 0;
    for (let k = 0; k < kAskedForEvenness; k += 1) {
        grid.nearestTo(Math.floor((k + 0.5) * count / kAskedForEvenness), nearest);
        if (nearest.count > kSpacingNeighbor && nearest.distanceSq[kSpacingNeighbor] > 0) {
            asked += 1;
            sum += Math.sqrt(nearest.distanceSq[0] / nearest.distanceSq[kSpacingNeighbor]);
        }
    }
    return asked > 0 ? Math.min(1, Math.max(0, (sum / asked - kUneven) / (kEven - kUneven))) : 0;
}

/** Those that depend on how evenly points lie. */
function splatSizes(even) {
    const between = (uneven, ifEven) => uneven + even * (ifEven - uneven);
    return {
        closedByDistance: between(kByDistance, kClosedByDistanceIfEven),
        borderByDistance: between(kByDistance, kBorderByDistanceIfEven),
        borderByReach: between(kOpenByReach, 0),
        blobByDistance: between(kBlobByDistance, kBlobByDistanceIfEven),
        largestBlob: between(kLargestBlob, kLargestBlobIfEven),
    };
}

/** Parts of the surface whose points have hardly a neighbour at the spacing of all: by those that are farther off. */
function closeSparseParts(surface, isSparse, positions, cloud) {
    const { normals, spacing, nearest, cell } = cloud;
    const count = isSparse.length;
    let left = isSparse.reduce((sum, is) => sum + is, 0);
    const found = new Int16Array(4);  // as the surface has them, of one point
    for (let local = kSparser * spacing; local <= kSparsest * spacing && left > kFewSparse * count; local *= kSparser) {
        const grid = new PointGrid(positions, kGrid * local);
        for (let at = 0; at < count; at += 1) {
            const i = grid.members[at];
            if (!isSparse[i]) {
                continue;
            }
            grid.nearestTo(at, nearest);
            if (nearest.count <= kSpacingNeighbor) {
                continue;
            }
            isSparse[i] = 0;
            left -= 1;
            found.fill(0);
            if (normals) {
                storeUnit(found, 0, normals[3 * i], normals[3 * i + 1], normals[3 * i + 2]);
            }
            if (!hasNormal(found, 0)) {
                storePlaneNormal(found, 0, grid.positions, at, nearest);
            }
            const radius = splatRadius(found, 0, grid, at, cloud);
            // What stands alone, as leaves or birds do, is no surface; at its border points lie on one side.
            if (cell.roughness <= kFlat) {
                const beside = cell.isOpen ? kByDistance * Math.sqrt(nearest.distanceSq[1]) : Infinity;
                storeRadius(found, 0, Math.min(radius, beside, kLargest * local), spacing);
                surface.set(found, 4 * i);
            }
        }
    }
}

const hasNormal = (surface, i) => surface[4 * i] !== 0 || surface[4 * i + 1] !== 0 || surface[4 * i + 2] !== 0;

function storeRadius(surface, i, radius, spacing) {
    surface[4 * i + 3] = kFull * radius / (kLargestRadius * spacing);
}

/** Null of a point without neighbours. The normal of a point is made shorter where it is in doubt. */
function splatRadius(surface, i, grid, at, { normals, spacing, nearest, cell, sizes }) {
    if (nearest.count === 0) {
        return null;
    }
    const last = nearest.count - 1;
    const distance = Math.sqrt(nearest.distanceSq[Math.min(kSpacingNeighbor, last)]);
    const farthest = Math.sqrt(nearest.distanceSq[last]);
    const x = surface[4 * i] / kFull, y = surface[4 * i + 1] / kFull, z = surface[4 * i + 2] / kFull;
    if (x === 0 && y === 0 && z === 0) {
        return kOpenByReach * farthest;
    }
    cell.measure(x, y, z, grid, at, nearest, normals);
    let byDistance = kByDistance, byReach = 0;
    if (cell.isOpen && cell.offCenter > kOneSided) {
        byDistance = sizes.borderByDistance;
        byReach = sizes.borderByReach;
    } else if (cell.isOpen) {
        byReach = kOpenByReach;
    } else if (cell.width > kWide) {
        byDistance = sizes.closedByDistance;
    }
    if (cell.width <= kLine) {
        byReach = 0;
    }
    const radius = Math.max(kOverlap * cell.reach, byDistance * distance, byReach * farthest);
    const doubt = Math.min(1, Math.max(0, (cell.roughness - kFlat) / (kRough - kFlat)));
    const length = 1 - doubt * (1 - kLeastNormal);
    for (let k = 0; k < 3; k += 1) {
        surface[4 * i + k] *= length;
    }
    return radius + doubt * (Math.min(radius, sizes.blobByDistance * distance, sizes.largestBlob * spacing) - radius);
}

/** The Voronoi cell of a point among its neighbours, laid into its tangent plane. */
class TangentCell {
    constructor() {
        const most = kCorners + kNeighbors;
        this.x = new Float64Array(most);
        this.y = new Float64Array(most);
        this.count = 0;
        this.clippedX = new Float64Array(most);
        this.clippedY = new Float64Array(most);
        // What was measured last:
        this.reach = 0;       // how far its farthest corner lies
        this.isOpen = false;  // whether neighbours on some side are missing
        this.roughness = 0;   // of the neighbours of the same sheet: their heights by their distances
        this.width = 1;       // of those in the plane, by their length: second moments around the point
        this.offCenter = 0;   // from the point to the middle of those, by their distances
    }

    /** @param normals  of the cloud, or null */
    measure(nx, ny, nz, { positions, members }, at, nearest, normals) {
        // Two axes across a unit normal (Duff and others 2017).
        const sign = nz < 0 ? -1 : 1;
        const a = -1 / (sign + nz), b = nx * ny * a;
        const ux = 1 + sign * nx * nx * a, uy = sign * b, uz = -sign * nx;
        const vx = b, vy = sign + ny * ny * a, vz = -ny;
        const window = kWindow * Math.sqrt(nearest.distanceSq[nearest.count - 1]);
        this.start(window);
        let farthest = window;
        let ofSheet = 0, heights = 0, distances = 0;
        let sumU = 0, sumV = 0, uu = 0, uv = 0, vv = 0;
        for (let n = 0; n < nearest.count; n += 1) {
            const from = 3 * nearest.index[n];
            const dx = positions[from] - positions[3 * at];
            const dy = positions[from + 1] - positions[3 * at + 1];
            const dz = positions[from + 2] - positions[3 * at + 2];
            const height = nx * dx + ny * dy + nz * dz;
            if (isOfSheet(normals, members[nearest.index[n]], nx, ny, nz, height * height / nearest.distanceSq[n])) {
                ofSheet += 1;
                heights += height * height;
                distances += nearest.distanceSq[n];
            }
            const u = ux * dx + uy * dy + uz * dz, v = vx * dx + vy * dy + vz * dz;
            const across = Math.sqrt(u * u + v * v);
            sumU += u;
            sumV += v;
            uu += u * u;
            uv += u * v;
            vv += v * v;
            const half = 0.5 * Math.sqrt(nearest.distanceSq[n]);  // along the surface, which may fall away
            if (half < farthest && Math.abs(height) < kSteepest * across) {
                this.clip(u / across, v / across, half);
                farthest = this.farthest();
            }
        }
        this.roughness = ofSheet < Math.min(kLeastOfSheet, nearest.count) ? kRough : distances > 0 ? Math.sqrt(heights / distances) : 0;
        this.offCenter = uu + vv > 0 ? Math.sqrt((sumU * sumU + sumV * sumV) / (nearest.count * (uu + vv))) : 0;
        const spread = Math.hypot(uu - vv, 2 * uv);
        this.width = uu + vv > 0 ? (uu + vv - spread) / (uu + vv + spread) : 1;
        this.isOpen = farthest > kInWindow * window;
        this.reach = this.isOpen ? this.farthest(kInWindow * window) : farthest;
    }

    start(radius) {
        this.count = kCorners;
        for (let k = 0; k < kCorners; k += 1) {
            this.x[k] = radius * kCornersX[k];
            this.y[k] = radius * kCornersY[k];
        }
    }

    /** Keeps what lies up to `limit` along a direction. */
    clip(u, v, limit) {
        const { x, y, clippedX, clippedY, count } = this;
        let kept = 0;
        let before = u * x[count - 1] + v * y[count - 1] - limit;
        for (let k = 0, last = count - 1; k < count; last = k, k += 1) {
            const beyond = u * x[k] + v * y[k] - limit;
            if ((beyond > 0) !== (before > 0)) {
                const t = before / (before - beyond);
                clippedX[kept] = x[last] + t * (x[k] - x[last]);
                clippedY[kept] = y[last] + t * (y[k] - y[last]);
                kept += 1;
            }
            if (beyond <= 0) {
                clippedX[kept] = x[k];
                clippedY[kept] = y[k];
                kept += 1;
            }
            before = beyond;
        }
        this.x = clippedX;
        this.y = clippedY;
        this.clippedX = x;
        this.clippedY = y;
        this.count = kept;
    }

    /** Of the corners within a distance. */
    farthest(within = Infinity) {
        let mostSq = 0;
        for (let k = 0; k < this.count; k += 1) {
            const distanceSq = this.x[k] * this.x[k] + this.y[k] * this.y[k];
            if (distanceSq > mostSq && distanceSq < within * within) {
                mostSq = distanceSq;
            }
        }
        return Math.sqrt(mostSq);
    }
}

/**
 * Whether a neighbour is of the sheet of a point with normal n: not around a corner, nor of the far side of a wall. Scans turn normals
 * either way; without any, all are.
 * @param heightSq  above the plane of n, by squared distance
 */
function isOfSheet(normals, neighbor, nx, ny, nz, heightSq) {
    if (!normals) {
        return true;
    }
    const x = normals[3 * neighbor], y = normals[3 * neighbor + 1], z = normals[3 * neighbor + 2];
    const along = nx * x + ny * y + nz * z;
    if (along * along < kLeastCosine * kLeastCosine * (x * x + y * y + z * z)) {
        return false;
    }
    return along >= 0 || heightSq < kLeastHeightSq;
}

/** The k points nearest to another so far, by their place in the grid, in ascending order of distance. */
class Nearest {
    constructor(k) {
        this.index = new Uint32Array(k);
        this.distanceSq = new Float64Array(k);
        this.count = 0;
    }

    offer(index, distanceSq) {
        const k = this.index.length;
        if (this.count === k && distanceSq >= this.distanceSq[k - 1]) {
            return;
        }
        let at = this.count < k ? this.count++ : k - 1;
        for (; at > 0 && this.distanceSq[at - 1] > distanceSq; at -= 1) {
            this.distanceSq[at] = this.distanceSq[at - 1];
            this.index[at] = this.index[at - 1];
        }
        this.distanceSq[at] = distanceSq;
        this.index[at] = index;
    }
}

/**
 * Points by the cell they lie in, copied in the order of the cells. A row of cells along x is hashed as a whole: its cells are
 * neighbours in memory too. Points of another row that share a bucket are told apart by `rows`, which are exact.
 */
class PointGrid {
    constructor(positions, cellSize) {
        const count = positions.length / 3;
        const buckets = 2 ** Math.ceil(Math.log2(Math.max(8, 2 * count)));  // no fewer than a search meets of a row
        this.inverseCellSize = 1 / cellSize;
        this.mask = buckets - 1;
        this.starts = new Uint32Array(buckets + 1);
        this.members = new Uint32Array(count);         // the point at each place
        this.positions = new Float32Array(3 * count);
        this.rows = new Float64Array(count);
        const bucketOf = (i) =>
            (rowHash(this.cell(positions[3 * i + 1]), this.cell(positions[3 * i + 2])) + this.cell(positions[3 * i])) & this.mask;
        for (let i = 0; i < count; i += 1) {
            this.starts[bucketOf(i) + 1] += 1;
        }
        for (let b = 0; b < buckets; b += 1) {
            this.starts[b + 1] += this.starts[b];
        }
        const next = this.starts.slice();
        for (let i = 0; i < count; i += 1) {
            const at = next[bucketOf(i)]++;
            this.members[at] = i;
            this.positions.set(positions.subarray(3 * i, 3 * i + 3), 3 * at);
            this.rows[at] = rowOf(this.cell(positions[3 * i + 1]), this.cell(positions[3 * i + 2]));
        }
    }

    cell(coordinate) {
        return Math.floor(coordinate * this.inverseCellSize);
    }

    /** Exact within the cells around a point; the second ring is asked only where the first holds too few. */
    nearestTo(at, nearest) {
        this.search(at, 1, nearest);
        if (nearest.count <= kSpacingNeighbor) {
            this.search(at, 2, nearest);
        }
    }

    search(at, ring, nearest) {
        const { positions, rows, starts, mask } = this;
        const x = positions[3 * at], y = positions[3 * at + 1], z = positions[3 * at + 2];
        const cx = this.cell(x), cy = this.cell(y), cz = this.cell(z);
        nearest.count = 0;
        let left = kMostMet;
        // By offsets: to the cell of a point that is very far off, 1 adds nothing.
        for (let k = -ring; k <= ring; k += 1) {
            for (let j = -ring; j <= ring; j += 1) {
                const row = rowOf(cy + j, cz + k);
                const hash = rowHash(cy + j, cz + k);
                for (let i = -ring; i <= ring; i += 1) {
                    const bucket = (hash + cx + i) & mask;
                    const end = Math.min(starts[bucket + 1], starts[bucket] + left);
                    left -= end - starts[bucket];
                    for (let other = starts[bucket]; other < end; other += 1) {
                        if (rows[other] === row && other !== at) {
                            const dx = positions[3 * other] - x;
                            const dy = positions[3 * other + 1] - y;
                            const dz = positions[3 * other + 2] - z;
                            nearest.offer(other, dx * dx + dy * dy + dz * dz);
                        }
                    }
                }
            }
        }
    }
}

/** Another number for each row, as long as a float tells its cells apart. */
const rowOf = (y, z) => y * 2 ** 26 + z;

function rowHash(y, z) {
    const hash = Math.imul(y, 0x8da6b343) ^ Math.imul(z, 0xd8163841);
    return Math.imul(hash ^ (hash >>> 15), 0x2c1b3c6d);
}

/** The eigenvector of the smallest eigenvalue of the neighbours' covariance (Eq. 1), those nearby weighing more: coarse levels bend. */
function storePlaneNormal(surface, i, positions, at, nearest) {
    const { index, count, distanceSq } = nearest;
    const reachSq = kWeightReach * distanceSq[count - 1];
    let total = 1;
    let mx = 0, my = 0, mz = 0;  // from the point, which weighs 1
    let xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
    for (let n = 0; n < count; n += 1) {
        const from = 3 * index[n];
        const x = positions[from] - positions[3 * at];
        const y = positions[from + 1] - positions[3 * at + 1];
        const z = positions[from + 2] - positions[3 * at + 2];
        const root = 1 - distanceSq[n] / reachSq;
        const weight = root * root;
        total += weight;
        mx += weight * x; my += weight * y; mz += weight * z;
        xx += weight * x * x; xy += weight * x * y; xz += weight * x * z;
        yy += weight * y * y; yz += weight * y * z; zz += weight * z * z;
    }
    xx -= mx * mx / total; xy -= mx * my / total; xz -= mx * mz / total;
    yy -= my * my / total; yz -= my * mz / total; zz -= mz * mz / total;
    const smallest = smallestEigenvalue(xx, xy, xz, yy, yz, zz);
    xx -= smallest;
    yy -= smallest;
    zz -= smallest;
    // Its eigenvector is normal to every row of A - λI: the longest cross product of two rows is the most exact.
    const ax = xy * yz - xz * yy, ay = xz * xy - xx * yz, az = xx * yy - xy * xy;
    const bx = xy * zz - xz * yz, by = xz * xz - xx * zz, bz = xx * yz - xy * xz;
    const cx = yy * zz - yz * yz, cy = yz * xz - xy * zz, cz = xy * yz - yy * xz;
    const a = ax * ax + ay * ay + az * az, b = bx * bx + by * by + bz * bz, c = cx * cx + cy * cy + cz * cz;
    if (a >= b && a >= c) {
        storeUnit(surface, i, ax, ay, az);
    } else if (b >= c) {
        storeUnit(surface, i, bx, by, bz);
    } else {
        storeUnit(surface, i, cx, cy, cz);
    }
}

/** Of a symmetric 3×3 matrix, in closed form (Smith 1961). */
function smallestEigenvalue(xx, xy, xz, yy, yz, zz) {
    const mean = (xx + yy + zz) / 3;
    const dx = xx - mean, dy = yy - mean, dz = zz - mean;
    const off = xy * xy + xz * xz + yz * yz;
    const p = Math.sqrt((dx * dx + dy * dy + dz * dz + 2 * off) / 6);
    if (p === 0) {
        return mean;
    }
    const determinant = dx * (dy * dz - yz * yz) - xy * (xy * dz - yz * xz) + xz * (xy * yz - dy * xz);
    const r = Math.min(1, Math.max(-1, determinant / (2 * p * p * p)));
    return mean + 2 * p * Math.cos(Math.acos(r) / 3 + 2 * Math.PI / 3);
}

function storeUnit(surface, i, x, y, z) {
    const length = Math.hypot(x, y, z);
    if (length > 0) {
        const scale = kFull / length;
        surface[4 * i] = x * scale;
        surface[4 * i + 1] = y * scale;
        surface[4 * i + 2] = z * scale;
    }
}
