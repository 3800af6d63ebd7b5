// No header of its own: normal_kernels.cpp includes it once for each instruction set, in a
// namespace of its own. The eight points of a leaf each have a lane.

#include "base/float_lanes_body.hpp"

[[gnu::always_inline]] inline Float8 square_root(Float8 v) noexcept {
    Float8 root;
#if defined(STIPPLE_KERNELS_AVX2)
    root = reinterpret_cast<Float8>(_mm256_sqrt_ps(reinterpret_cast<__m256>(v)));
#elif defined(__SSE2__)
    __m128 half[2];
    __builtin_memcpy(half, &v, sizeof v);
    for (__m128& h : half) h = _mm_sqrt_ps(h);
    __builtin_memcpy(&root, half, sizeof v);
#else
    for (std::size_t lane = 0; lane < kLanes; ++lane) root[lane] = __builtin_sqrtf(v[lane]);
#endif
    return root;
}

struct Vector {
    Float8 x, y, z;

    Float8 length_sq() const noexcept { return x * x + y * y + z * z; }
};

[[gnu::always_inline]] inline Vector cross(const Vector& a, const Vector& b) noexcept {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// The symmetric matrix of a neighbourhood, of trace 1.
struct Covariance {
    Float8 xx, xy, xz, yy, yz, zz;
};

/// The smallest root of its characteristic polynomial -t^3 + t^2 - c1 t + c0, as in
/// `smallest_eigenvalue` of doubles: for a direction floats do.
[[gnu::always_inline]] inline Float8 smallest_root(Float8 c1, Float8 c0) noexcept {
    Float8 t{};
    for (int i = 0; i < 3; ++i) {
        const Float8 p = c0 - t * (c1 - t * (1.0F - t));
        const Float8 slope = c1 - t * (2.0F - 3.0F * t);  // -p'
        const Float8 bend = 2.0F - 6.0F * t;              // p''
        const Float8 inside = 4.0F * slope * slope - 6.0F * p * bend;
        const Float8 down = slope + square_root(inside > 0.0F ? inside : Float8{});
        const Float8 step = 3.0F * p / (down > 1e-20F ? down : Float8{} + 1e-20F);
        t += step > 0.0F ? step : Float8{};
    }
    return t;
}

/// A normal, up where it is not to be told.
struct Normal {
    Vector n;
    Int8 is_told;
};

/// The eigenvector of the smallest eigenvalue.
[[gnu::always_inline]] inline Normal normal_of(const Covariance& s) noexcept {
    const Float8 minor_x = s.yy * s.zz - s.yz * s.yz, minor_y = s.xx * s.zz - s.xz * s.xz,
                 minor_z = s.xx * s.yy - s.xy * s.xy;
    const Float8 c1 = minor_x + minor_y + minor_z;
    const Float8 c0 =
        s.xx * minor_x - s.xy * (s.xy * s.zz - s.yz * s.xz) + s.xz * (s.xy * s.yz - s.yy * s.xz);
    const Float8 least = smallest_root(c1, c0 > 0.0F ? c0 : Float8{});
    // The rows of the matrix less its eigenvalue span what is orthogonal to the eigenvector.
    const Vector a{s.xx - least, s.xy, s.xz}, b{s.xy, s.yy - least, s.yz},
        c{s.xz, s.yz, s.zz - least};
    Vector n = cross(a, b);
    for (const Vector& other : {cross(b, c), cross(c, a)}) {
        const Int8 longer = other.length_sq() > n.length_sq();
        n = {longer ? other.x : n.x, longer ? other.y : n.y, longer ? other.z : n.z};
    }
    constexpr float kParallel = 1e-20F;  // of the rows, squared
    constexpr float kLine = 1e-5F;       // across it, squared, as part of the whole extent
    const Float8 length_sq = n.length_sq(), one = Float8{} + 1.0F;
    const Int8 flat = (length_sq > kParallel) & (c1 > kLine);
    const Float8 by = 1.0F / square_root(flat ? length_sq : one);
    return {{flat ? n.x * by : Float8{}, flat ? n.y * by : Float8{}, flat ? n.z * by : one}, flat};
}

void leaf_normals(const PointTree::View& tree, std::uint32_t leaf, float* x, float* y, float* z,
                  float* curvature) noexcept {
    constexpr std::uint32_t kLeaves = 3;
    constexpr float kInfinity = __builtin_inff();
    const std::uint32_t all = tree.child_counts[0];
    const std::uint32_t before = leaf > 0 ? leaf - 1 : 0;
    const std::uint32_t first = before + kLeaves <= all ? before
                                : all > kLeaves         ? all - kLeaves
                                                        : 0;
    const std::uint32_t end = first + kLeaves < all ? first + kLeaves : all;
    const PointTree::Leaf& own = tree.leaves[leaf];
    const Float8 own_x = load(reinterpret_cast<const float*>(&own.x)),
                 own_y = load(reinterpret_cast<const float*>(&own.y)),
                 own_z = load(reinterpret_cast<const float*>(&own.z));
    Float8 distances_sq[kLeaves * kLanes], sum{};
    std::uint32_t count = 0;
    for (std::uint32_t l = first; l < end; ++l) {
        const float* const xs = reinterpret_cast<const float*>(&tree.leaves[l].x);
        const float* const ys = reinterpret_cast<const float*>(&tree.leaves[l].y);
        const float* const zs = reinterpret_cast<const float*>(&tree.leaves[l].z);
        for (std::uint32_t i = 0; i < kLanes && xs[i] < kInfinity; ++i) {
            const Float8 dx = xs[i] - own_x, dy = ys[i] - own_y, dz = zs[i] - own_z;
            const Float8 d = dx * dx + dy * dy + dz * dz;
            distances_sq[count++] = d;
            sum += d;
        }
    }
    // Weights of h = r / 3 as ever. As if the points were spread evenly over a disk, their mean
    // squared distance tells the r of some seven of them, which need not be found: with an r of
    // more, levels rounded by these normals have more error.
    constexpr float kPoints = 7.2F, kMost = 79;
    const Float8 least = Float8{} + 1e-30F;
    const Float8 radius_sq = sum * (2 * kPoints / static_cast<float>(count * count));
    const Float8 scale = 9.0F / (radius_sq > least ? radius_sq : least);
    Float8 w{}, wx{}, wy{}, wz{}, xx{}, xy{}, xz{}, yy{}, yz{}, zz{};
    std::uint32_t j = 0;
    for (std::uint32_t l = first; l < end; ++l) {
        const float* const xs = reinterpret_cast<const float*>(&tree.leaves[l].x);
        const float* const ys = reinterpret_cast<const float*>(&tree.leaves[l].y);
        const float* const zs = reinterpret_cast<const float*>(&tree.leaves[l].z);
        for (std::uint32_t i = 0; i < kLanes && xs[i] < kInfinity; ++i) {
            const Float8 dx = xs[i] - own_x, dy = ys[i] - own_y, dz = zs[i] - own_z;
            const Float8 u = distances_sq[j++] * scale;
            const Float8 weight = gaussian(u < kMost ? u : Float8{} + kMost);
            const Float8 x_by = weight * dx, y_by = weight * dy, z_by = weight * dz;
            w += weight;
            wx += x_by;
            wy += y_by;
            wz += z_by;
            xx += x_by * dx;
            xy += x_by * dy;
            xz += x_by * dz;
            yy += y_by * dy;
            yz += y_by * dz;
            zz += z_by * dz;
        }
    }
    const Float8 by = 1.0F / w;  // the point's own weight is 1
    const Float8 mx = wx * by, my = wy * by, mz = wz * by;
    Covariance s = {xx * by - mx * mx, xy * by - mx * my, xz * by - mx * mz,
                    yy * by - my * my, yz * by - my * mz, zz * by - mz * mz};
    const Float8 trace = s.xx + s.yy + s.zz;
    const Float8 norm = 1.0F / (trace > least ? trace : least);
    for (Float8* const entry : {&s.xx, &s.xy, &s.xz, &s.yy, &s.yz, &s.zz}) *entry *= norm;
    const auto [n, is_told] = normal_of(s);
    // Points around one on a paraboloid are as high over it, on average, as half their mean squared
    // distance times the curvature.
    const Float8 height = n.x * mx + n.y * my + n.z * mz;
    const Float8 mean_sq = trace + mx * mx + my * my + mz * mz;
    const Float8 bend = 2.0F * height / (mean_sq > least ? mean_sq : least);
    const Float8 told_bend = is_told ? bend : Float8{};
    __builtin_memcpy(x, &n.x, sizeof n.x);
    __builtin_memcpy(y, &n.y, sizeof n.y);
    __builtin_memcpy(z, &n.z, sizeof n.z);
    __builtin_memcpy(curvature, &told_bend, sizeof told_bend);
}
