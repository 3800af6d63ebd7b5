#pragma once

#include "cloud/samples.hpp"

#include <array>
#include <cmath>
#include <cstdint>

#if defined(__SSSE3__)
#include <tmmintrin.h>
#elif defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace stipple {

// Four lanes, as every machine has them; results do not depend on wider ones being there.
using Float4 = float __attribute__((vector_size(16)));
using Int4 = std::int32_t __attribute__((vector_size(16)));

inline Float4 load(const float* from) noexcept {
    Float4 v;
    __builtin_memcpy(&v, from, sizeof v);
    return v;
}

inline Float4 splat(float value) noexcept {
    return Float4{value, value, value, value};
}

inline void store(float* to, Float4 v) noexcept {
    __builtin_memcpy(to, &v, sizeof v);
}

inline Float4 square_root(Float4 v) noexcept {
#if defined(__SSE2__)
    return _mm_sqrt_ps(v);
#else
    return {std::sqrt(v[0]), std::sqrt(v[1]), std::sqrt(v[2]), std::sqrt(v[3])};
#endif
}

/// The larger of two in each lane; the second where they are equal.
inline Float4 larger(Float4 a, Float4 b) noexcept {
#if defined(__SSE2__)
    return _mm_max_ps(a, b);  // which the compiler does not make of the choice
#else
    return a > b ? a : b;
#endif
}

/// The smaller of two in each lane; the second where they are equal.
inline Float4 smaller(Float4 a, Float4 b) noexcept {
#if defined(__SSE2__)
    return _mm_min_ps(a, b);
#else
    return a < b ? a : b;
#endif
}

/// The four lanes of a comparison as bits, the first lowest.
inline unsigned lane_bits(Int4 mask) noexcept {
#if defined(__SSE2__)
    return static_cast<unsigned>(_mm_movemask_ps(reinterpret_cast<__m128>(mask)));
#else
    return (mask[0] & 1U) | (mask[1] & 2U) | (mask[2] & 4U) | (mask[3] & 8U);
#endif
}

/// Writes the lanes chosen by the four bits of `mask` to `out`, packed, in order; what is left
/// of the four places there becomes anything.
template <typename T>
inline void store_packed(T* out, const T* lanes, unsigned mask) noexcept {
    static_assert(sizeof(T) == 4);
#if defined(__SSSE3__)
    static constexpr auto kShuffles = [] {
        std::array<std::array<std::uint8_t, 16>, 16> table{};
        for (unsigned m = 0; m < 16; ++m) {
            std::uint8_t to = 0;
            for (std::uint8_t lane = 0; lane < 4; ++lane) {
                if ((m >> lane & 1U) == 0) continue;
                for (std::uint8_t byte = 0; byte < 4; ++byte)
                    table[m][to++] = static_cast<std::uint8_t>(4 * lane + byte);
            }
        }
        return table;
    }();
    const __m128i v = _mm_loadu_si128(reinterpret_cast<const __m128i*>(lanes));
    const __m128i shuffle =
        _mm_loadu_si128(reinterpret_cast<const __m128i*>(kShuffles[mask].data()));
    _mm_storeu_si128(reinterpret_cast<__m128i*>(out), _mm_shuffle_epi8(v, shuffle));
#else
    for (unsigned lane = 0; lane < 4; ++lane) {
        if ((mask >> lane & 1U) != 0) *out++ = lanes[lane];
    }
#endif
}

inline double sum(Float4 v) noexcept {
    const Float4 pairs = v + __builtin_shufflevector(v, v, 2, 3, 0, 1);
    return static_cast<double>(pairs[0]) + static_cast<double>(pairs[1]);
}

/// Four points relative to a reference; what is missing at the end stands at the reference, where
/// it adds nothing.
struct Group {
    Float4 x, y, z;

    Group(const SampleSpan& s, std::size_t i, const Vec3f& reference) noexcept
        : x(load(s.x + i) - reference.x()),
          y(load(s.y + i) - reference.y()),
          z(load(s.z + i) - reference.z()) {}
    static Group tail(const SampleSpan& s, std::size_t i, const Vec3f& reference) noexcept {
        std::array<float, 12> padded;
        for (std::size_t j = 0; j < 4; ++j) {
            const Vec3f p = i + j < s.size ? s.position(i + j) : reference;
            for (std::size_t axis = 0; axis < 3; ++axis)
                padded[4 * axis + j] = p[static_cast<Eigen::Index>(axis)];
        }
        return {SampleSpan{padded.data(), padded.data() + 4, padded.data() + 8, nullptr, 4}, 0,
                reference};
    }
};

}  // namespace stipple
