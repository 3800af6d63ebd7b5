// No header of its own: bodies of kernels include it where they begin, so once for each instruction
// set. Eight floats at once, and doubles of as many.

constexpr std::size_t kLanes = 8;
using Floats = std::array<float, kLanes>;
using Float8 = float __attribute__((vector_size(32)));
using Int8 = std::int32_t __attribute__((vector_size(32)));
using Unsigned8 = std::uint32_t __attribute__((vector_size(32)));
using Double8 = double __attribute__((vector_size(64)));
using Long8 = std::int64_t __attribute__((vector_size(64)));
using Double4 = double __attribute__((vector_size(32)));
using Long4 = std::int64_t __attribute__((vector_size(32)));

[[gnu::always_inline]] inline Float8 load(const Floats& from) noexcept {
    Float8 v;
    __builtin_memcpy(&v, from.data(), sizeof v);
    return v;
}
[[gnu::always_inline]] inline Float8 load(const float* from) noexcept {
    Float8 v;
    __builtin_memcpy(&v, from, sizeof v);
    return v;
}
[[gnu::always_inline]] inline void store(Float8 v, Floats& to) noexcept {
    __builtin_memcpy(to.data(), &v, sizeof v);
}
[[gnu::always_inline]] inline Double8 wide(Float8 v) noexcept {
    return __builtin_convertvector(v, Double8);
}
[[gnu::always_inline]] inline Float8 narrow(Double8 v) noexcept {
    return __builtin_convertvector(v, Float8);
}
[[gnu::always_inline]] inline Int8 narrow(Long8 mask) noexcept {
    return __builtin_convertvector(mask, Int8);
}

/// Of each of four the sums of lanes side by side, in pairs, of either half.
[[gnu::always_inline]] inline Float8 pairs_of(Float8 a, Float8 b) noexcept {
    return __builtin_shufflevector(a, b, 0, 2, 8, 10, 4, 6, 12, 14) +
           __builtin_shufflevector(a, b, 1, 3, 9, 11, 5, 7, 13, 15);
}
/// The sums over the lanes of each of four.
inline std::array<float, 4> sums_of(Float8 a, Float8 b, Float8 c, Float8 d) noexcept {
    const Float8 halves = pairs_of(pairs_of(a, b), pairs_of(c, d));
    const Float8 whole = halves + __builtin_shufflevector(halves, halves, 4, 5, 6, 7, 0, 1, 2, 3);
    std::array<float, 4> sums;
    __builtin_memcpy(sums.data(), &whole, sizeof sums);
    return sums;
}

inline Double8 square_root(Double8 v) noexcept {
    Double8 root;
#if defined(STIPPLE_KERNELS_AVX2)
    __m256d half[2];
    __builtin_memcpy(half, &v, sizeof v);
    for (__m256d& h : half) h = _mm256_sqrt_pd(h);
    __builtin_memcpy(&root, half, sizeof v);
#elif defined(__SSE2__)
    __m128d quarter[4];
    __builtin_memcpy(quarter, &v, sizeof v);
    for (__m128d& q : quarter) q = _mm_sqrt_pd(q);
    __builtin_memcpy(&root, quarter, sizeof v);
#else
    for (std::size_t lane = 0; lane < kLanes; ++lane) root[lane] = __builtin_sqrt(v[lane]);
#endif
    return root;
}

[[gnu::always_inline]] inline Double4 square_root(Double4 v) noexcept {
    Double4 root;
#if defined(STIPPLE_KERNELS_AVX2)
    root = reinterpret_cast<Double4>(_mm256_sqrt_pd(reinterpret_cast<__m256d>(v)));
#elif defined(__SSE2__)
    __m128d half[2];
    __builtin_memcpy(half, &v, sizeof v);
    for (__m128d& h : half) h = _mm_sqrt_pd(h);
    __builtin_memcpy(&root, half, sizeof v);
#else
    for (std::size_t lane = 0; lane < 4; ++lane) root[lane] = __builtin_sqrt(v[lane]);
#endif
    return root;
}

/// exp(-u) for 0 <= u < 80, to 1e-6 of it; anything beyond.
[[gnu::always_inline]] inline Float8 gaussian(Float8 u) noexcept {
    constexpr float kShift = 0x1.8p23F;  // brings the integer part to the end of the mantissa
    const Float8 y = u * -1.44269504F;
    const Float8 shifted = y + kShift;
    const Float8 f = y - (shifted - kShift);  // |f| <= 1/2; 2^f by its series
    const Float8 series =
        1.0F +
        f * (0.693147181F +
             f * (0.240226507F + f * (0.0555041087F + f * (0.00961812911F + f * 0.00133335581F))));
    return reinterpret_cast<Float8>(reinterpret_cast<Unsigned8>(series) +
                                    (reinterpret_cast<Unsigned8>(shifted) << 23U));
}

/// The smallest root of the characteristic polynomial -t^3 + t^2 - c1 t + c0 (the trace is 1) by
/// Laguerre's method from 0: all roots are real, so it climbs to the first without passing it.
template <typename V>
[[gnu::always_inline]] inline V smallest_eigenvalue(V c1, V c0) noexcept {
    const V tiny = V{} + 1e-30;
    V t{};
    for (int i = 0; i < 4; ++i) {
        const V p = c0 - t * (c1 - t * (1.0 - t));
        const V slope = c1 - t * (2.0 - 3.0 * t);  // -p'
        const V bend = 2.0 - 6.0 * t;              // p''
        const V inside = 4.0 * slope * slope - 6.0 * p * bend;
        const V down = slope + square_root(inside > 0.0 ? inside : V{});
        const V step = 3.0 * p / (down > tiny ? down : tiny);
        t += step > 0.0 ? step : V{};
    }
    return t;
}
