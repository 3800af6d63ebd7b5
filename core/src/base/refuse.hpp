#pragma once

#include "base/in_words.hpp"
#include "stipple/error.hpp"

#include <cmath>
#include <string_view>

namespace stipple {

/// Throws Error(InvalidArgument); the message is the parts, `in_words`.
template <typename... Parts>
[[noreturn]] void refuse(const Parts&... parts) {
    throw Error(ErrorCode::InvalidArgument, in_words(parts...));
}

/// Refuses a value that does not fit: `k 2: expected 3..32`.
template <typename T>
void require(bool fits, std::string_view name, const T& value, std::string_view expected) {
    if (!fits) refuse(name, ' ', value, ": expected ", expected);
}

inline void require_positive(std::string_view name, double value) {
    require(value > 0 && std::isfinite(value), name, value, "a finite number above 0");
}

inline void require_not_negative(std::string_view name, double value) {
    require(value >= 0 && std::isfinite(value), name, value, "a finite number, at least 0");
}

}  // namespace stipple
