#pragma once

#include <concepts>
#include <limits>

namespace stipple {

/// What components of normals of a type are to be multiplied by: those of small integers stand for
/// -1..1, as in glTF and Draco.
inline constexpr auto normal_scale = []<typename T>() -> float {
    if constexpr (std::signed_integral<T> && sizeof(T) <= 2)
        return 1.0F / static_cast<float>(std::numeric_limits<T>::max());
    return 1;
};

}  // namespace stipple
