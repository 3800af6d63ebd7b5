#pragma once

#include <algorithm>
#include <concepts>
#include <cstdint>
#include <type_traits>

namespace stipple {

/// A colour channel of any type as 8 bits: floats are 0..1, 16 bits 0..65535, every other integer
/// 0..255. What lies outside is cut off, NaN is 0.
template <typename T>
std::uint8_t to_channel(T value) noexcept {
    if constexpr (std::is_same_v<T, std::uint8_t>) {
        return value;
    } else if constexpr (std::is_same_v<T, std::int8_t>) {
        return static_cast<std::uint8_t>(value);  // `char` written for `uchar`
    } else if constexpr (std::is_same_v<T, std::uint16_t>) {
        return static_cast<std::uint8_t>((value + 128U) / 257U);
    } else if constexpr (std::integral<T>) {
        return static_cast<std::uint8_t>(std::clamp<T>(value, 0, 255));
    } else {
        return value > 0 ? static_cast<std::uint8_t>(std::min<T>(value, 1) * 255 + T(0.5))
                         : std::uint8_t{0};
    }
}

}  // namespace stipple
