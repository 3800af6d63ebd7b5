#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <vector>

namespace stipple {

/// Whether a floating value is a whole number, as the labels and counts that some programs write as
/// floats: quantised or blended they would be none any more.
template <std::floating_point T>
bool is_whole(T value) noexcept {
    return std::isfinite(value) && value == std::trunc(value);
}

template <std::floating_point T>
bool are_whole(const std::vector<T>& values) {
    return std::ranges::all_of(values, is_whole<T>);
}

/// Whether a double has all digits of a whole number, as it does of all up to 2^53.
template <std::integral T>
constexpr bool fits_double(T value) noexcept {
    if constexpr (sizeof(T) < 8) return true;
    const auto bits = static_cast<std::uint64_t>(value);
    const std::uint64_t size = value < 0 ? 0 - bits : bits;
    return size >> 53U == 0 || size >> std::countr_zero(size) >> 53U == 0;
}

}  // namespace stipple
