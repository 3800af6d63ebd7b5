#pragma once

#include <cstdint>

namespace stipple {

/// The `i`-th of a sequence of random numbers, each by itself, so that any thread may ask for any
/// (Steele, Lea, Flood 2014: the finaliser of splitmix64).
inline std::uint64_t random_bits(std::uint64_t seed, std::uint64_t i) noexcept {
    const auto mix = [](std::uint64_t x) {
        x = (x ^ x >> 30U) * 0xbf58476d1ce4e5b9ULL;
        x = (x ^ x >> 27U) * 0x94d049bb133111ebULL;
        return x ^ x >> 31U;
    };
    constexpr std::uint64_t kGolden = 0x9e3779b97f4a7c15ULL;
    return mix(mix(seed + kGolden) + (i + 1) * kGolden);
}

__extension__ using UInt128 = unsigned __int128;

/// The high 64 bits of a product of 128.
inline std::uint64_t high_product(std::uint64_t a, std::uint64_t b) noexcept {
    return static_cast<std::uint64_t>(static_cast<UInt128>(a) * b >> 64U);
}

/// The i-th random number of a seed, in [0, 1).
inline double random_unit(std::uint64_t seed, std::uint64_t i) noexcept {
    return static_cast<double>(random_bits(seed, i) >> 11U) * 0x1p-53;
}

/// 0..n-1 from random bits; uniform but for a part n / 2^64.
inline std::uint64_t below(std::uint64_t bits, std::uint64_t n) noexcept {
    return high_product(bits, n);
}

}  // namespace stipple
