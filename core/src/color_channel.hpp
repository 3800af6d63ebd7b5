#pragma once

#include "stipple/point_cloud.hpp"

#include <algorithm>
#include <array>
#include <concepts>
#include <cstdint>
#include <type_traits>
#include <vector>

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

/// Red, green, blue and alpha of 16 bits.
using WideColor = std::array<std::uint16_t, 4>;
inline constexpr WideColor kOpaque = {0, 0, 0, 65'535};

/// Colours of 16 bits as 8. Many scans keep 8 bits in them: where no colour of the cloud is above
/// 255, they are taken as they are.
inline void narrow_colors(const std::vector<WideColor>& wide, std::vector<Rgba8>& colors) {
    const bool eight_bits = std::ranges::all_of(wide, [](const WideColor& c) {
        return std::max({c[0], c[1], c[2]}) <= 255;
    });
    const auto narrow = [eight_bits](std::uint16_t v) {
        return eight_bits ? static_cast<std::uint8_t>(v) : to_channel(v);
    };
    for (std::size_t i = 0; i < wide.size(); ++i) {
        const auto& [r, g, b, a] = wide[i];
        colors[i] = {narrow(r), narrow(g), narrow(b),
                     a <= 255 && eight_bits ? static_cast<std::uint8_t>(a) : to_channel(a)};
    }
}

}  // namespace stipple
