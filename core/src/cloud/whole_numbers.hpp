#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
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

}  // namespace stipple
