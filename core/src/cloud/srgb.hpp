#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace stipple {

/// sRGB (IEC 61966-2-1) to linear light, for each of the 256 codes.
inline const std::array<float, 256>& linear_from_srgb() {
    static const std::array<float, 256> table = [] {
        std::array<float, 256> t{};
        for (std::size_t i = 0; i < t.size(); ++i) {
            const double v = static_cast<double>(i) / 255.0;
            t[i] =
                static_cast<float>(v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4));
        }
        return t;
    }();
    return table;
}

/// The sRGB code nearest to a linear value in [0, 1]. Undoes `linear_from_srgb` exactly.
inline std::uint8_t srgb_from_linear(double v) {
    const double encoded = v <= 0.0031308 ? v * 12.92 : 1.055 * std::pow(v, 1.0 / 2.4) - 0.055;
    return static_cast<std::uint8_t>(std::clamp(std::lround(encoded * 255.0), 0L, 255L));
}

}  // namespace stipple
