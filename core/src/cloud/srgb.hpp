#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace stipple {

/// sRGB (IEC 61966-2-1), as a part of 1, to linear light.
inline double linear_from_encoded(double v) {
    return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
}

/// The same for each of the 256 codes.
inline const std::array<float, 256>& linear_from_srgb() {
    static const std::array<float, 256> table = [] {
        std::array<float, 256> t{};
        for (std::size_t i = 0; i < t.size(); ++i)
            t[i] = static_cast<float>(linear_from_encoded(static_cast<double>(i) / 255.0));
        return t;
    }();
    return table;
}

/// The sRGB code nearest to a linear value in [0, 1]. Undoes `linear_from_srgb` exactly.
inline std::uint8_t srgb_from_linear(double v) {
    constexpr std::size_t kParts = 1024;
    struct Steps {
        std::array<double, 255> ends{};                ///< of each code but the last
        std::array<std::uint8_t, kParts + 1> first{};  ///< code of each part of [0, 1]
    };
    static const Steps steps = [] {
        Steps s;
        for (std::size_t i = 0; i < s.ends.size(); ++i)
            s.ends[i] = linear_from_encoded((static_cast<double>(i) + 0.5) / 255.0);
        for (std::size_t i = 0; i < s.first.size(); ++i) {
            const double from = static_cast<double>(i) / kParts;
            s.first[i] =
                static_cast<std::uint8_t>(std::ranges::upper_bound(s.ends, from) - s.ends.begin());
        }
        return s;
    }();
    const double part = v > 0 ? std::min(v, 1.0) : 0.0;
    std::size_t code = steps.first[static_cast<std::size_t>(part * kParts)];
    while (code < steps.ends.size() && v >= steps.ends[code]) ++code;
    return static_cast<std::uint8_t>(code);
}

}  // namespace stipple
