// No header of its own: plane_kernels.cpp includes it once for each instruction set, in a namespace
// of its own. Each lane's candidates are looked at eight at a time, then eight lanes' sums; lanes
// never mix, and the width of the machine's vectors changes nothing.

#include "base/float_lanes_body.hpp"

/// (Of `?:` compilers make a comparison and a choice, since they must mind numbers that are none.)
[[gnu::always_inline]] inline Float8 min(Float8 a, Float8 b) noexcept {
#if defined(STIPPLE_KERNELS_AVX2)
    return reinterpret_cast<Float8>(
        _mm256_min_ps(reinterpret_cast<__m256>(a), reinterpret_cast<__m256>(b)));
#else
    return a < b ? a : b;
#endif
}
[[gnu::always_inline]] inline Float8 max(Float8 a, Float8 b) noexcept {
#if defined(STIPPLE_KERNELS_AVX2)
    return reinterpret_cast<Float8>(
        _mm256_max_ps(reinterpret_cast<__m256>(a), reinterpret_cast<__m256>(b)));
#else
    return a > b ? a : b;
#endif
}

inline float least_of(Float8 v) noexcept {
    v = min(v, __builtin_shufflevector(v, v, 4, 5, 6, 7, 0, 1, 2, 3));
    v = min(v, __builtin_shufflevector(v, v, 2, 3, 0, 1, 6, 7, 4, 5));
    v = min(v, __builtin_shufflevector(v, v, 1, 0, 3, 2, 5, 4, 7, 6));
    return v[0];
}
inline float largest_of(Float8 v) noexcept {
    return -least_of(-v);
}
/// How many lanes are set, given minus one for each.
inline std::int32_t count_of(Int8 minus) noexcept {
    minus += __builtin_shufflevector(minus, minus, 4, 5, 6, 7, 0, 1, 2, 3);
    minus += __builtin_shufflevector(minus, minus, 2, 3, 0, 1, 6, 7, 4, 5);
    return -(minus[0] + minus[1]);
}

/// Distances in groups of eight.
struct Distances {
    const float* sq;
    std::uint32_t groups;

    std::int32_t count_within(float t) const noexcept {
        Int8 minus{};
        for (std::uint32_t g = 0; g < groups; ++g) minus += load(sq + g * kLanes) <= t;
        return count_of(minus);
    }
    float largest_within(float t) const noexcept {
        Float8 below{};
        for (std::uint32_t g = 0; g < groups; ++g) {
            const Float8 d = load(sq + g * kLanes);
            below = max(below, d <= t ? d : Float8{});
        }
        return largest_of(below);
    }
    float least_beyond(float t) const noexcept {
        const Float8 infinite = Float8{} + __builtin_inff();
        Float8 above = infinite;
        for (std::uint32_t g = 0; g < groups; ++g) {
            const Float8 d = load(sq + g * kLanes);
            above = min(above, d <= t ? infinite : d);
        }
        return least_of(above);
    }
};

/// The k-th smallest distance.
///
/// Counts how many are at most t, and moves t between what is too low and too high: the number
/// within a radius grows about as its square on a surface, so that a straight line through the last
/// counts soon meets it. Where it does not, as where many are equal, both become distances that
/// occur, of which one moves every time: there are as many tries as that takes, so that numbers
/// that are none end it, too.
inline float kth_smallest(const Distances& distances, std::int32_t k, float t) noexcept {
    constexpr int kQuick = 8;  // tries
    const float infinity = __builtin_inff();
    float low = 0, high = infinity;
    std::int32_t count_low = 0, count_high = 2 * k;
    const int tries = kQuick + static_cast<int>(distances.groups * kLanes);
    for (int i = 0; i < tries; ++i) {
        const std::int32_t count = distances.count_within(t);
        if (count == k) return distances.largest_within(t);
        if (count == k - 1) return distances.least_beyond(t);
        if (count < k) {
            low = i < kQuick ? t : distances.least_beyond(t);
            count_low = count;
        } else {
            high = i < kQuick ? t : distances.largest_within(t);
            count_high = count;
        }
        if (low == high && i >= kQuick) return low;
        const float part =
            (static_cast<float>(k - count_low) - 0.5F) / static_cast<float>(count_high - count_low);
        const float between = low + (high - low) * part;
        t = high == infinity ? (low > 0 ? low + low : distances.least_beyond(0))
            : between < high ? between
                             : low;
    }
    return low;
}

/// The sums over neighbourhoods that their planes are made of.
template <typename T>
struct Moments {
    T w{}, x{}, y{}, z{}, xx{}, xy{}, xz{}, yy{}, yz{}, zz{};
};

/// Of one lane, given the squared distances of its candidates.
inline void add_moments(const PlaneLanes::Candidates& c, const float* distances_sq, float radius_sq,
                        std::size_t lane, Moments<Floats>& to) noexcept {
    Moments<Float8> m;
    const float scale = 9.0F / (radius_sq > 1e-30F ? radius_sq : 1e-30F);  // 1 / h^2
    for (std::uint32_t g = 0; g < c.groups; ++g) {
        const Float8 d = load(distances_sq + g * kLanes);
        const Int8 inside = d <= radius_sq;
        const Float8 w = inside ? gaussian(d * scale) : Float8{};
        const Float8 x = load(c.x + g * kLanes), y = load(c.y + g * kLanes),
                     z = load(c.z + g * kLanes);
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
    const auto first = sums_of(m.w, m.x, m.y, m.z), second = sums_of(m.xx, m.xy, m.xz, m.yy),
               third = sums_of(m.yz, m.zz, m.yz, m.zz);
    to.w[lane] = first[0];
    to.x[lane] = first[1];
    to.y[lane] = first[2];
    to.z[lane] = first[3];
    to.xx[lane] = second[0];
    to.xy[lane] = second[1];
    to.xz[lane] = second[2];
    to.yy[lane] = second[3];
    to.yz[lane] = third[0];
    to.zz[lane] = third[1];
}

/// Finds the neighbourhood of the place of one lane, and its sums.
inline void find_neighborhood(PlaneLanes& lanes, std::size_t lane, Moments<Floats>& to) noexcept {
    const PlaneLanes::Candidates c = lanes.candidates[lane];
    float* const distances_sq = lanes.scratch.data();
    const float px = lanes.place.x[lane], py = lanes.place.y[lane], pz = lanes.place.z[lane];
    Float8 nearest = Float8{} + __builtin_inff();
    for (std::uint32_t g = 0; g < c.groups; ++g) {
        const Float8 dx = load(c.x + g * kLanes) - px, dy = load(c.y + g * kLanes) - py,
                     dz = load(c.z + g * kLanes) - pz;
        const Float8 d = dx * dx + dy * dy + dz * dz;
        nearest = min(nearest, d);
        __builtin_memcpy(distances_sq + g * kLanes, &d, sizeof d);
    }
    const float radius_sq = kth_smallest(
        {distances_sq, c.groups}, static_cast<std::int32_t>(lanes.k), lanes.radius_guess_sq[lane]);
    lanes.radius_sq[lane] = radius_sq;
    lanes.nearest_sq[lane] = least_of(nearest);
    add_moments(c, distances_sq, radius_sq, lane, to);
}

using Float4 = float __attribute__((vector_size(16)));

/// Four lanes from `first` on. (The compiler takes comparisons of eight doubles apart.)
[[gnu::always_inline]] inline Double4 wide(const Floats& from, std::size_t first) noexcept {
    Float4 v;
    __builtin_memcpy(&v, from.data() + first, sizeof v);
    return __builtin_convertvector(v, Double4);
}
[[gnu::always_inline]] inline void store(Double4 from, Floats& to, std::size_t first) noexcept {
    const Float4 v = __builtin_convertvector(from, Float4);
    __builtin_memcpy(to.data() + first, &v, sizeof v);
}

/// Weighted mean, and the covariance divided by its trace.
struct Spread {
    Double4 x, y, z, xx, xy, xz, yy, yz, zz;
};

inline Spread spread_of(const Moments<Floats>& m, std::size_t first) noexcept {
    const auto of = [first](const Floats& sums) __attribute__((always_inline)) {
        return wide(sums, first);
    };
    const Double4 by = 1.0 / of(m.w);
    Spread s;
    s.x = of(m.x) * by;
    s.y = of(m.y) * by;
    s.z = of(m.z) * by;
    s.xx = of(m.xx) * by - s.x * s.x;
    s.xy = of(m.xy) * by - s.x * s.y;
    s.xz = of(m.xz) * by - s.x * s.z;
    s.yy = of(m.yy) * by - s.y * s.y;
    s.yz = of(m.yz) * by - s.y * s.z;
    s.zz = of(m.zz) * by - s.z * s.z;
    const Double4 trace = s.xx + s.yy + s.zz;
    const Double4 tiny = Double4{} + 1e-60;
    const Double4 norm = 1.0 / (trace > tiny ? trace : tiny);
    s.xx *= norm;
    s.xy *= norm;
    s.xz *= norm;
    s.yy *= norm;
    s.yz *= norm;
    s.zz *= norm;
    return s;
}

struct Vector {
    Double4 x, y, z;

    [[gnu::always_inline]] Double4 length_sq() const noexcept { return x * x + y * y + z * z; }
};

inline Vector cross(const Vector& a, const Vector& b) noexcept {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// The planes of four lanes, given the sums of all, and the ways across them.
inline void find_planes(PlaneLanes& lanes, const Moments<Floats>& moments,
                        std::size_t first) noexcept {
    const Double4 px = wide(lanes.place.x, first), py = wide(lanes.place.y, first),
                  pz = wide(lanes.place.z, first);
    const Spread s = spread_of(moments, first);

    const Double4 minor_x = s.yy * s.zz - s.yz * s.yz, minor_y = s.xx * s.zz - s.xz * s.xz,
                  minor_z = s.xx * s.yy - s.xy * s.xy;
    const Double4 c1 = minor_x + minor_y + minor_z;
    const Double4 c0 =
        s.xx * minor_x - s.xy * (s.xy * s.zz - s.yz * s.xz) + s.xz * (s.xy * s.yz - s.yy * s.xz);
    const Double4 least = smallest_eigenvalue(c1, c0 > 0.0 ? c0 : Double4{});

    const Double4 others = 1.0 - least, product = c1 - least * others;  // λ1 + λ2, λ1 λ2
    const Double4 inside = others * others - 4.0 * product;
    const Double4 middle = 0.5 * (others - square_root(inside > 0.0 ? inside : Double4{}));
    const Double4 roundness = middle > least ? least / middle : Double4{} + 1.0;
    const Double4 breadth = middle / (others - middle);

    // The rows of the matrix less its eigenvalue span what is orthogonal to the eigenvector.
    const Vector a{s.xx - least, s.xy, s.xz}, b{s.xy, s.yy - least, s.yz},
        c{s.xz, s.yz, s.zz - least};
    Vector n = cross(a, b);
    for (const Vector& other : {cross(b, c), cross(c, a)}) {
        const Long4 longer = other.length_sq() > n.length_sq();
        n = {longer ? other.x : n.x, longer ? other.y : n.y, longer ? other.z : n.z};
    }
    constexpr double kParallel = 1e-20;  // of the rows, squared
    constexpr double kLine = 1e-6;       // across it, squared, as part of the whole extent
    const Double4 length_sq = n.length_sq();
    const Long4 flat = (length_sq > kParallel) & (c1 > kLine);
    const Double4 by = 1.0 / square_root(flat ? length_sq : Double4{} + 1.0);
    n = {n.x * by, n.y * by, n.z * by};

    const Double4 qx = wide(lanes.query.x, first), qy = wide(lanes.query.y, first),
                  qz = wide(lanes.query.z, first);
    const Double4 height = n.x * (qx - s.x) + n.y * (qy - s.y) + n.z * (qz - s.z);
    const Double4 fx = qx - height * n.x, fy = qy - height * n.y, fz = qz - height * n.z;
    const Double4 sx = fx - px, sy = fy - py, sz = fz - pz;
    const Double4 ox = s.x - px, oy = s.y - py, oz = s.z - pz;
    store(ox * ox + oy * oy + oz * oz, lanes.offset_sq, first);
    store(fx, lanes.foot.x, first);
    store(fy, lanes.foot.y, first);
    store(fz, lanes.foot.z, first);
    store(n.x, lanes.normal.x, first);
    store(n.y, lanes.normal.y, first);
    store(n.z, lanes.normal.z, first);
    store(roundness, lanes.roundness, first);
    store(breadth, lanes.breadth, first);
    store(height, lanes.height, first);
    store(sx * sx + sy * sy + sz * sz, lanes.step_sq, first);
    for (std::size_t lane = 0; lane < 4; ++lane) lanes.flat[first + lane] = flat[lane] != 0;
}

void run(PlaneLanes& lanes) noexcept {
    Moments<Floats> moments;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
        if (lanes.candidates[lane].groups > 0)
            find_neighborhood(lanes, lane, moments);
        else
            moments.w[lane] = 1;
    }
    for (const std::size_t first : {0, 4}) find_planes(lanes, moments, first);
}
