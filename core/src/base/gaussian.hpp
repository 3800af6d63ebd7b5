#pragma once

#include <bit>
#include <cstdint>

namespace stipple {

/// exp(-u) for u >= 0, to 1e-8 of it, 0 above 700. Plain arithmetic: the same bits on every
/// machine, and the compiler makes vector code of a loop around it.
inline double gaussian(double u) noexcept {
    constexpr double kShift = 0x1.8p52;  // brings the integer part to the end of the mantissa
    constexpr double kLog2E = 1.4426950408889634, kLn2 = 0.6931471805599453;
    const double shifted = kShift - (u < 700.0 ? u : 700.0) * kLog2E;
    const double whole = shifted - kShift;
    const double f = -(u < 700.0 ? u : 700.0) - whole * kLn2;  // |f| <= ln 2 / 2
    const double series =
        1.0 + f * (1.0 + f * (1.0 / 2 +
                              f * (1.0 / 6 +
                                   f * (1.0 / 24 + f * (1.0 / 120 + f * (1.0 / 720 + f / 5040))))));
    const std::uint64_t power = std::bit_cast<std::uint64_t>(shifted) << 52U;
    const double scaled = std::bit_cast<double>(std::bit_cast<std::uint64_t>(series) + power);
    return u < 700.0 ? scaled : 0.0;
}

}  // namespace stipple
