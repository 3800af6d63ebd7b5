// No header of its own: plane_kernels.cpp includes it once for each instruction set, in a namespace
// of its own. Lanes never mix, so the width of the machine's vectors changes nothing.

#include "float_lanes_body.hpp"

inline Float8 min(Float8 a, Float8 b) noexcept {
    return a < b ? a : b;
}
inline Float8 max(Float8 a, Float8 b) noexcept {
    return a > b ? a : b;
}

inline bool all(Int8 mask) noexcept {
#if defined(STIPPLE_KERNELS_AVX2)
    return _mm256_movemask_epi8(reinterpret_cast<__m256i>(mask)) == -1;
#else
    std::int32_t both = -1;
    for (std::size_t lane = 0; lane < kLanes; ++lane) both &= mask[lane];
    return both == -1;
#endif
}

/// The k-th smallest of the distances in each lane, and the smallest.
///
/// Counts how many are at most t, and moves t: the number within a radius grows about as its square
/// on a surface, so that a straight line through the last counts soon meets it. `low` and `high`
/// are distances that occur and that the answer lies between, and one of them moves every time.
inline Float8 kth_smallest(const PlaneLanes& lanes, Float8 t) noexcept {
    const Float8 infinity = Float8{} + __builtin_inff();
    const Int8 k = Int8{} + static_cast<std::int32_t>(lanes.k);
    Float8 low{}, high = infinity, found{};
    Int8 count_low{}, count_high = k + k, done{};
    for (;;) {
        Int8 count{};
        Float8 below{}, above = infinity;
        for (std::size_t j = 0; j < lanes.rows; ++j) {
            const Float8 d = load(lanes.scratch[j].sq);
            const Int8 inside = d <= t;
            count -= inside;
            below = max(below, inside ? d : Float8{});
            above = min(above, inside ? infinity : d);
        }
        const Int8 few = count < k;
        low = few ? above : low;
        count_low = few ? count : count_low;
        high = few ? high : below;
        count_high = few ? count_high : count;
        const Int8 met = (count == k) | (count == k - 1) | (low == high);
        found = done ? found : few ? low : high;
        done |= met;
        if (all(done)) return found;
        const Float8 part = (__builtin_convertvector(k - count_low, Float8) - 0.5F) /
                            __builtin_convertvector(count_high - count_low, Float8);
        const Float8 between = low + (high - low) * part;
        const Float8 beyond = low + low;
        t = high < infinity ? (between < high ? between : low) : beyond;
    }
}

/// The sums over a neighbourhood that its plane is made of.
struct Moments {
    Float8 w{}, x{}, y{}, z{}, xx{}, xy{}, xz{}, yy{}, yz{}, zz{};
};

inline Moments weighted_moments(const PlaneLanes& lanes, Float8 radius_sq) noexcept {
    Moments m;
    const Float8 tiny = Float8{} + 1e-30F;
    const Float8 scale = 9.0F / max(radius_sq, tiny);  // 1 / h^2
    for (std::size_t j = 0; j < lanes.rows; ++j) {
        const Float8 d = load(lanes.scratch[j].sq);
        const Int8 inside = d <= radius_sq;
        const Float8 w = inside ? gaussian(d * scale) : Float8{};
        const PlaneLanes::Row& row = lanes.candidates[j];
        const Float8 x = load(row.x), y = load(row.y), z = load(row.z);
        const Float8 wx = w * x, wy = w * y, wz = w * z;
        m.w += w;
        m.x += wx;
        m.y += wy;
        m.z += wz;
        m.xx += wx * x;
        m.xy += wx * y;
        m.xz += wx * z;
        m.yy += wy * y;
        m.yz += wy * z;
        m.zz += wz * z;
    }
    return m;
}

/// Weighted mean, and the covariance divided by its trace.
struct Spread {
    Double8 x, y, z, xx, xy, xz, yy, yz, zz;
};

inline Spread spread_of(const Moments& m) noexcept {
    const Double8 by = 1.0 / wide(m.w);
    Spread s;
    s.x = wide(m.x) * by;
    s.y = wide(m.y) * by;
    s.z = wide(m.z) * by;
    s.xx = wide(m.xx) * by - s.x * s.x;
    s.xy = wide(m.xy) * by - s.x * s.y;
    s.xz = wide(m.xz) * by - s.x * s.z;
    s.yy = wide(m.yy) * by - s.y * s.y;
    s.yz = wide(m.yz) * by - s.y * s.z;
    s.zz = wide(m.zz) * by - s.z * s.z;
    const Double8 trace = s.xx + s.yy + s.zz;
    const Double8 tiny = Double8{} + 1e-60;
    const Double8 norm = 1.0 / (trace > tiny ? trace : tiny);
    s.xx *= norm;
    s.xy *= norm;
    s.xz *= norm;
    s.yy *= norm;
    s.yz *= norm;
    s.zz *= norm;
    return s;
}

struct Vector {
    Double8 x, y, z;

    Double8 length_sq() const noexcept { return x * x + y * y + z * z; }
};

inline Vector cross(const Vector& a, const Vector& b) noexcept {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

void run(PlaneLanes& lanes) noexcept {
    const Float8 px = load(lanes.place.x), py = load(lanes.place.y), pz = load(lanes.place.z);
    Float8 nearest = Float8{} + __builtin_inff();
    for (std::size_t j = 0; j < lanes.rows; ++j) {
        const PlaneLanes::Row& row = lanes.candidates[j];
        const Float8 dx = load(row.x) - px, dy = load(row.y) - py, dz = load(row.z) - pz;
        const Float8 d = dx * dx + dy * dy + dz * dz;
        nearest = min(nearest, d);
        store(d, lanes.scratch[j].sq);
    }
    const Float8 radius_sq = kth_smallest(lanes, load(lanes.radius_guess_sq));
    const Spread s = spread_of(weighted_moments(lanes, radius_sq));

    const Double8 minor_x = s.yy * s.zz - s.yz * s.yz, minor_y = s.xx * s.zz - s.xz * s.xz,
                  minor_z = s.xx * s.yy - s.xy * s.xy;
    const Double8 c1 = minor_x + minor_y + minor_z;
    const Double8 c0 =
        s.xx * minor_x - s.xy * (s.xy * s.zz - s.yz * s.xz) + s.xz * (s.xy * s.yz - s.yy * s.xz);
    const Double8 least = smallest_eigenvalue(c1, c0 > 0.0 ? c0 : Double8{});

    const Double8 others = 1.0 - least, product = c1 - least * others;  // λ1 + λ2, λ1 λ2
    const Double8 inside = others * others - 4.0 * product;
    const Double8 middle = 0.5 * (others - square_root(inside > 0.0 ? inside : Double8{}));
    const Double8 roundness = middle > least ? least / middle : Double8{} + 1.0;

    // The rows of the matrix less its eigenvalue span what is orthogonal to the eigenvector.
    const Vector a{s.xx - least, s.xy, s.xz}, b{s.xy, s.yy - least, s.yz},
        c{s.xz, s.yz, s.zz - least};
    Vector n = cross(a, b);
    for (const Vector& other : {cross(b, c), cross(c, a)}) {
        const Long8 longer = other.length_sq() > n.length_sq();
        n = {longer ? other.x : n.x, longer ? other.y : n.y, longer ? other.z : n.z};
    }
    constexpr double kParallel = 1e-20;  // of the rows, squared
    constexpr double kLine = 1e-6;       // across it, squared, as part of the whole extent
    const Double8 length_sq = n.length_sq();
    const Long8 flat = (length_sq > kParallel) & (c1 > kLine);
    const Double8 by = 1.0 / square_root(flat ? length_sq : Double8{} + 1.0);
    n = {n.x * by, n.y * by, n.z * by};

    const Double8 qx = wide(load(lanes.query.x)), qy = wide(load(lanes.query.y)),
                  qz = wide(load(lanes.query.z));
    const Double8 height = n.x * (qx - s.x) + n.y * (qy - s.y) + n.z * (qz - s.z);
    const Double8 fx = qx - height * n.x, fy = qy - height * n.y, fz = qz - height * n.z;
    const Double8 sx = fx - wide(px), sy = fy - wide(py), sz = fz - wide(pz);
    store(radius_sq, lanes.radius_sq);
    store(nearest, lanes.nearest_sq);
    const Double8 ox = s.x - wide(px), oy = s.y - wide(py), oz = s.z - wide(pz);
    store(narrow(ox * ox + oy * oy + oz * oz), lanes.offset_sq);
    store(narrow(fx), lanes.foot.x);
    store(narrow(fy), lanes.foot.y);
    store(narrow(fz), lanes.foot.z);
    store(narrow(n.x), lanes.normal.x);
    store(narrow(n.y), lanes.normal.y);
    store(narrow(n.z), lanes.normal.z);
    store(narrow(roundness), lanes.roundness);
    store(narrow(height), lanes.height);
    store(narrow(sx * sx + sy * sy + sz * sz), lanes.step_sq);
    for (std::size_t lane = 0; lane < kLanes; ++lane) lanes.flat[lane] = flat[lane] != 0;
}
