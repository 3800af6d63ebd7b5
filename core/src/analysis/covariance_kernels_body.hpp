// No header of its own: covariance_kernels.cpp includes it once for each instruction set, in a
// namespace of its own. It uses four lanes as the compiler makes them of what the set has; only the
// square root is written for each.

using Double4 = double __attribute__((vector_size(32)));
using Long4 = std::int64_t __attribute__((vector_size(32)));

[[gnu::always_inline]] inline Double4 load(const double* from) noexcept {
    Double4 v;
    __builtin_memcpy(&v, from, sizeof v);
    return v;
}
inline void store(double* to, Double4 v) noexcept {
    __builtin_memcpy(to, &v, sizeof v);
}

[[gnu::always_inline]] inline Double4 root(Double4 v) noexcept {
#if defined(STIPPLE_KERNELS_AVX2)
    return _mm256_sqrt_pd(v);
#else
    for (unsigned lane = 0; lane < 4; ++lane) v[lane] = std::sqrt(v[lane]);
    return v;
#endif
}

[[gnu::always_inline]] inline Double4 magnitude(Double4 v) noexcept {
    return v < 0.0 ? -v : v;
}

void add_moments(const Candidates& c, const std::uint32_t* slots, std::uint32_t count,
                 const float* reference, Moments& moments) noexcept {
    Double4 sum = load(moments.sum), squares = load(moments.squares),
            products = load(moments.products);
    const Double4 from = {reference[0], reference[1], reference[2], 0.0};
    for (std::uint32_t i = 0; i < count; ++i) {
        const std::uint32_t at = slots[i];
        const Double4 d = Double4{c.x[at], c.y[at], c.z[at], 0.0} - from;
        sum += d;
        squares += d * d;
        products += d * __builtin_shufflevector(d, d, 1, 2, 0, 3);
    }
    store(moments.sum, sum);
    store(moments.squares, squares);
    store(moments.products, products);
}

/// One rotation in the plane of two axes that makes their product `ab` zero; `ac` and `bc` are the
/// products with the third axis, `va` and `vb` the vectors found so far.
inline void rotate(Double4& aa, Double4& bb, Double4& ab, Double4& ac, Double4& bc, Double4* va,
                   Double4* vb) noexcept {
    const Double4 difference = bb - aa, twice = ab + ab;
    const Double4 below = magnitude(difference) + root(difference * difference + twice * twice);
    Double4 tangent = below > 0.0 ? twice / below : Double4{};
    tangent = difference < 0.0 ? -tangent : tangent;
    const Double4 cosine = 1.0 / root(tangent * tangent + 1.0), sine = tangent * cosine;
    aa -= tangent * ab;
    bb += tangent * ab;
    ab = Double4{};
    const Double4 old = ac;
    ac = cosine * old - sine * bc;
    bc = sine * old + cosine * bc;
    for (unsigned axis = 0; axis < 3; ++axis) {
        const Double4 a = va[axis];
        va[axis] = cosine * a - sine * vb[axis];
        vb[axis] = sine * a + cosine * vb[axis];
    }
}

/// Exchanges what stands for the larger eigenvalue with what stands for the smaller.
inline void put_in_order(Double4& low, Double4& high, Double4* v_low, Double4* v_high) noexcept {
    const Long4 wrong = high < low;
    const Double4 old = low;
    low = wrong ? high : low;
    high = wrong ? old : high;
    for (unsigned axis = 0; axis < 3; ++axis) {
        const Double4 v = v_low[axis];
        v_low[axis] = wrong ? v_high[axis] : v;
        v_high[axis] = wrong ? v : v_high[axis];
    }
}

inline bool any(Long4 mask) noexcept {
    return (mask[0] | mask[1] | mask[2] | mask[3]) != 0;
}

void solve(EigenProblems& problems) noexcept {
    constexpr unsigned kSweeps = 8;  // 3 to 5 are needed
    constexpr double kDone = 1e-17;  // off the diagonal, of the trace
    for (unsigned half = 0; half < 8; half += 4) {
        Double4 xx = load(problems.xx + half), yy = load(problems.yy + half),
                zz = load(problems.zz + half), xy = load(problems.xy + half),
                yz = load(problems.yz + half), zx = load(problems.zx + half);
        const Double4 zero{}, one = zero + 1.0;
        Double4 vx[3] = {one, zero, zero}, vy[3] = {zero, one, zero}, vz[3] = {zero, zero, one};
        const Double4 small = (xx + yy + zz) * kDone;
        for (unsigned sweep = 0; sweep < kSweeps; ++sweep) {
            if (!any(magnitude(xy) + magnitude(yz) + magnitude(zx) > small)) break;
            rotate(xx, yy, xy, zx, yz, vx, vy);
            rotate(yy, zz, yz, xy, zx, vy, vz);
            rotate(xx, zz, zx, xy, yz, vx, vz);
        }
        put_in_order(xx, yy, vx, vy);
        put_in_order(xx, zz, vx, vz);
        put_in_order(yy, zz, vy, vz);
        store(problems.low + half, xx);
        store(problems.middle + half, yy);
        store(problems.high + half, zz);
        const Double4 length = root(vx[0] * vx[0] + vx[1] * vx[1] + vx[2] * vx[2]);
        store(problems.x + half, vx[0] / length);
        store(problems.y + half, vx[1] / length);
        store(problems.z + half, vx[2] / length);
    }
}
