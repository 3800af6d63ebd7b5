#pragma once

#include <array>
#include <string_view>

namespace stipple {

// Properties of a vertex as this library writes them.
inline constexpr std::array<std::string_view, 3> kPlyAxes = {"x", "y", "z"};
inline constexpr std::array<std::string_view, 3> kPlyNormals = {"nx", "ny", "nz"};
inline constexpr std::array<std::string_view, 4> kPlyColors = {"red", "green", "blue", "alpha"};

}  // namespace stipple
