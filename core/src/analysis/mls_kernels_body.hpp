// No header of its own: mls_kernels.cpp includes it once for each instruction set, in a namespace
// of its own. Four neighbours at a time.

using Double4 = double __attribute__((vector_size(32)));
using Long4 = std::int64_t __attribute__((vector_size(32)));

constexpr std::size_t kLanes = MlsColumns::kLanes;

[[gnu::always_inline]] inline Double4 load(const double* from) noexcept {
    Double4 v;
    __builtin_memcpy(&v, from, sizeof v);
    return v;
}
[[gnu::always_inline]] inline void store(double* to, Double4 v) noexcept {
    __builtin_memcpy(to, &v, sizeof v);
}
[[gnu::always_inline]] inline double sum(Double4 v) noexcept {
    const Double4 pairs = v + __builtin_shufflevector(v, v, 2, 3, 0, 1);
    return pairs[0] + pairs[1];
}

/// exp(-u) for u >= 0, to 1e-8 of it, 0 above 700.
[[gnu::always_inline]] inline Double4 gaussian(Double4 u) noexcept {
    constexpr double kShift = 0x1.8p52;  // brings the integer part to the end of the mantissa
    constexpr double kLog2E = 1.4426950408889634, kLn2 = 0.6931471805599453;
    const Double4 most = Double4{} + 700.0;
    const Double4 v = u < most ? u : most;
    const Double4 shifted = kShift - v * kLog2E;
    const Double4 f = -v - (shifted - kShift) * kLn2;  // |f| <= ln 2 / 2
    const Double4 series =
        1.0 +
        f * (1.0 + f * (1.0 / 2 +
                        f * (1.0 / 6 + f * (1.0 / 24 + f * (1.0 / 120 +
                                                            f * (1.0 / 720 + f * (1.0 / 5040)))))));
    const Double4 scaled = reinterpret_cast<Double4>(reinterpret_cast<Long4>(series) +
                                                     (reinterpret_cast<Long4>(shifted) << 52));
    return u < most ? scaled : Double4{};
}

void weigh(const MlsColumns& around, const double* c, double h, double* weight) noexcept {
    const double by = 1.0 / (h * h);
    const Double4 infinite = Double4{} + __builtin_inf();
    Double4 nearest = infinite;
    for (std::size_t i = 0; i < around.size; i += kLanes) {
        const Double4 x = load(around.x + i) - c[0], y = load(around.y + i) - c[1],
                      z = load(around.z + i) - c[2];
        Double4 u = (x * x + y * y + z * z) * by;
        const Long4 filled_up = Long4{0, 1, 2, 3} >= static_cast<std::int64_t>(around.size - i);
        u = filled_up ? infinite : u;
        nearest = u < nearest ? u : nearest;
        store(weight + i, u);
    }
    double least = nearest[0];
    for (std::size_t lane = 1; lane < kLanes; ++lane)
        least = nearest[lane] < least ? nearest[lane] : least;
    for (std::size_t i = 0; i < around.size; i += kLanes)
        store(weight + i, gaussian(load(weight + i) - least));
}

MlsMoments moments(const MlsColumns& around, const double* reference) noexcept {
    Double4 s = {}, sx = {}, sy = {}, sz = {}, xx = {}, xy = {}, xz = {}, yy = {}, yz = {}, zz = {};
    for (std::size_t i = 0; i < around.size; i += kLanes) {
        const Double4 w = load(around.weight + i);
        const Double4 x = load(around.x + i) - reference[0], y = load(around.y + i) - reference[1],
                      z = load(around.z + i) - reference[2];
        const Double4 wx = w * x, wy = w * y, wz = w * z;
        s += w;
        sx += wx;
        sy += wy;
        sz += wz;
        xx += wx * x;
        xy += wx * y;
        xz += wx * z;
        yy += wy * y;
        yz += wy * z;
        zz += wz * z;
    }
    return {sum(s),  sum(sx), sum(sy), sum(sz), sum(xx),
            sum(xy), sum(xz), sum(yy), sum(yz), sum(zz)};
}

/// Along a direction.
[[gnu::always_inline]] inline Double4 along(const double* direction, Double4 x, Double4 y,
                                            Double4 z) noexcept {
    return direction[0] * x + direction[1] * y + direction[2] * z;
}

MlsDerivatives derivatives(const MlsColumns& around, const MlsTrial& plane) noexcept {
    const double g = 1.0 / (plane.h * plane.h), t = plane.t;
    Double4 f_a = {}, f_b = {}, f_t = {}, f_aa = {}, f_ab = {}, f_bb = {}, f_at = {}, f_bt = {},
            f_tt = {}, along_n = {};
    for (std::size_t i = 0; i < around.size; i += kLanes) {
        const Double4 x = load(around.x + i), y = load(around.y + i), z = load(around.z + i),
                      w = load(around.weight + i);
        const Double4 a = along(plane.e1, x, y, z), b = along(plane.e2, x, y, z),
                      m = along(plane.n, x, y, z);
        const Double4 s = m - t, ss = s * s * g, st = s * (t * g);
        const Double4 ws = w * s;
        const Double4 by_m = ws * (1.0 + st);
        const Double4 by_t = ws * (ss - 1.0);
        const Double4 by_mm = w * (1.0 + st * (4.0 + 2.0 * st));
        const Double4 by_mt = w * (3.0 * ss - 1.0 + 2.0 * st * (ss - 1.0));
        const Double4 by_tt = w * (1.0 + ss * (2.0 * ss - 5.0));
        const Double4 by_am = by_mm * a;
        f_a += by_m * a;
        f_b += by_m * b;
        f_t += by_t;
        f_aa += by_am * a;
        f_ab += by_am * b;
        f_bb += by_mm * b * b;
        f_at += by_mt * a;
        f_bt += by_mt * b;
        f_tt += by_tt;
        along_n += by_m * m;
    }
    return {sum(f_a),  sum(f_b),  sum(f_t),  sum(f_aa), sum(f_ab),
            sum(f_bb), sum(f_at), sum(f_bt), sum(f_tt), sum(along_n)};
}

/// Four neighbours: the terms of a polynomial 1 u v u^2 uv v^2 u^3 ... and their height.
struct FourTerms {
    Double4 term[MlsKernels::kMaxTerms];
    Double4 weight, height;
};

[[gnu::always_inline]] inline void fill(FourTerms& four, Double4 u, Double4 v,
                                        unsigned degree) noexcept {
    four.term[0] = Double4{} + 1.0;
    std::size_t at = 1;
    for (unsigned d = 1; d <= degree; ++d) {
        const std::size_t before = at - d;
        for (unsigned j = 0; j < d; ++j, ++at) four.term[at] = u * four.term[before + j];
        four.term[at] = v * four.term[before + d - 1];
        ++at;
    }
}

double normal_equations(const MlsColumns& around, const MlsTrial& plane, unsigned degree,
                        double* matrix, double* right) noexcept {
    constexpr std::size_t kGroups = 4;  // at a time
    const double by = 1.0 / plane.h;
    const std::size_t count = (degree + std::size_t{1}) * (degree + 2) / 2;
    for (std::size_t j = 0; j < count; ++j) {
        right[j] = 0;
        for (std::size_t k = 0; k <= j; ++k) matrix[j * MlsKernels::kMaxTerms + k] = 0;
    }
    Double4 highest = {};
    FourTerms fours[kGroups];
    for (std::size_t begin = 0; begin < around.size; begin += kGroups * kLanes) {
        std::size_t groups = 0;
        for (std::size_t i = begin; i < around.size && groups < kGroups; i += kLanes, ++groups) {
            FourTerms& four = fours[groups];
            const Double4 x = load(around.x + i) - plane.t * plane.n[0],
                          y = load(around.y + i) - plane.t * plane.n[1],
                          z = load(around.z + i) - plane.t * plane.n[2];
            fill(four, along(plane.e1, x, y, z) * by, along(plane.e2, x, y, z) * by, degree);
            four.weight = load(around.weight + i);
            four.height = along(plane.n, x, y, z);
            const Double4 size = four.height < 0.0 ? -four.height : four.height;
            const Long4 filled_up = Long4{0, 1, 2, 3} >= static_cast<std::int64_t>(around.size - i);
            highest = ~filled_up & (size > highest) ? size : highest;
        }
        for (std::size_t j = 0; j < count; ++j) {
            Double4 weighted[kGroups], total = {};
            for (std::size_t g = 0; g < groups; ++g) {
                weighted[g] = fours[g].weight * fours[g].term[j];
                total += weighted[g] * fours[g].height;
            }
            right[j] += sum(total);
            for (std::size_t k = 0; k <= j; ++k) {
                Double4 product = {};
                for (std::size_t g = 0; g < groups; ++g) product += weighted[g] * fours[g].term[k];
                matrix[j * MlsKernels::kMaxTerms + k] += sum(product);
            }
        }
    }
    double most = highest[0];
    for (std::size_t lane = 1; lane < kLanes; ++lane)
        most = highest[lane] > most ? highest[lane] : most;
    return most;
}
