#pragma once

#include "stipple/point_cloud.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>
#include <span>
#include <string_view>
#include <type_traits>
#include <utility>
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

/// A channel of any type as one of `WideColors`: integers are cut off at 65535.
template <typename Channel, typename T>
Channel to_wide_channel(T value) noexcept {
    if constexpr (std::integral<Channel> && std::integral<T>) {
        if (std::cmp_less(value, 0)) return 0;
        return std::cmp_greater(value, 65'535) ? Channel(65'535) : static_cast<Channel>(value);
    } else {
        return static_cast<Channel>(value);
    }
}

/// Colours of a type that most programs fill, but some as if it had 8 bits: which, all of a cloud
/// together tell.
template <typename T>
struct WideColors {
    static_assert(std::is_same_v<T, std::uint16_t> || std::is_floating_point_v<T>);
    static constexpr T kFull = std::is_integral_v<T> ? T(65'535) : T(1);
    using Color = std::array<T, 4>;  ///< red, green, blue, alpha
    /// In words, what is lost of them where something is.
    static constexpr std::string_view kLost = std::is_integral_v<T>
                                                  ? "lower 8 bits of 16-bit colours"
                                                  : "what float colours have beyond 8 bits";

    std::vector<Color> values;

    void resize(std::size_t n) { values.resize(n, {kFull, kFull, kFull, kFull}); }
    /// Integers have 8 bits where none is above 255, and 8 bits in the upper ones of 16, as LAS
    /// prescribes, where all are multiples of 256; floats where one is above 2 and finite, as no
    /// share of a colour is, and 16 where one is above 1023. Alpha alone may still be of the whole
    /// range.
    /// @param keeps_alpha  that of the colours stays, since it was no such channel.
    /// @returns whether nothing of them is lost.
    bool narrow(std::vector<Rgba8>& colors, bool keeps_alpha = false) const {
        const bool eight_bits = has_eight_bits();
        const bool upper_bits = !eight_bits && all_are_multiples_of(256);
        const T divisor = eight_bits && any_above(T(1023)) ? T(257) : T(1);
        const auto narrowed = [&](T v) {
            if constexpr (std::is_integral_v<T>) {
                if (upper_bits) return static_cast<std::uint8_t>(v / 256);
            }
            if (!eight_bits) return to_channel(v);
            constexpr T kRounding = std::is_integral_v<T> ? T(0) : T(0.5);
            return v > 0 ? static_cast<std::uint8_t>(std::min<T>(v / divisor, 255) + kRounding)
                         : std::uint8_t{0};
        };
        for (std::size_t i = 0; i < values.size(); ++i) {
            const auto& [r, g, b, a] = values[i];
            const bool whole_alpha =
                std::is_integral_v<T> ? a > T(255) && !(upper_bits && a != kFull) : a <= T(1);
            const std::uint8_t alpha = whole_alpha ? to_channel(a) : narrowed(a);
            colors[i] = {narrowed(r), narrowed(g), narrowed(b), keeps_alpha ? colors[i].a : alpha};
        }
        if constexpr (!std::is_integral_v<T>)
            return all_are_near_steps(eight_bits ? T(1) / divisor : T(255));
        return eight_bits || upper_bits || all_are_multiples_of(257);
    }

private:
    bool has_eight_bits() const {
        const auto largest = [](const Color& c) { return std::max({c[0], c[1], c[2]}); };
        const auto is_small = [&](const Color& c) { return !(largest(c) > T(255)); };
        return std::is_integral_v<T> ? std::ranges::all_of(values, is_small) : any_above(T(2));
    }
    /// Whether a channel is, and finite.
    bool any_above(T bound) const {
        return std::ranges::any_of(values, [bound](const Color& c) {
            return std::ranges::any_of(std::span(c).template first<3>(), [bound](T v) {
                return v > bound && v <= std::numeric_limits<T>::max();
            });
        });
    }
    /// Whether floats are those of 8 bits, times a factor, but for what rounding leaves.
    bool all_are_near_steps(T factor) const {
        constexpr T kRounding = T(0.01), kMost = T(255);
        return std::ranges::all_of(values, [factor](const Color& c) {
            return std::ranges::all_of(std::span(c).template first<3>(), [factor](T v) {
                const T step = v * factor;
                return !(std::abs(step - std::round(step)) > kRounding || step < -kRounding ||
                         step > kMost + kRounding);
            });
        });
    }
    bool all_are_multiples_of(unsigned factor) const {
        if constexpr (!std::is_integral_v<T>)
            return false;
        else
            return std::ranges::all_of(values, [&](const Color& c) {
                return c[0] % factor == 0 && c[1] % factor == 0 && c[2] % factor == 0;
            });
    }
};

}  // namespace stipple
