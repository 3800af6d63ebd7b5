#pragma once

#include "stipple/known_attributes.hpp"
#include "stipple/point_cloud.hpp"

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

namespace stipple {

inline constexpr std::string_view kAttributeNameRule =
    "1 to 255 printable ASCII characters without spaces";

/// Whether `Attribute::name` may be so.
inline bool is_attribute_name(std::string_view name) noexcept {
    return !name.empty() && name.size() <= 255 &&
           std::ranges::all_of(name, [](char c) { return c > ' ' && c < '\x7f'; });
}

/// A name that an attribute may have, as close to a foreign one as can be: an underscore stands for
/// what is no printable ASCII. Empty where nothing is left of it.
std::string attribute_name_of(std::string_view foreign);

/// `default_reduction` of what is read under a name. A time is that of a point, since between two
/// flights over a place there was none; and so are whole numbers, also where they are kept as
/// floats: they may be labels.
Reduction reduction_of(std::string_view name, const AttributeValues& values);

/// Gives each attribute a name that is allowed, no other has, and no PLY file of the cloud needs
/// for its coordinates, normals or colours: `red_2`.
/// @return  what was changed, in words: `name red → red_2`.
std::vector<std::string> settle_names(PointCloud& cloud);

/// For a report, where integers were rounded to doubles.
inline std::string digits_lost_of(std::string_view name) {
    return "digits of " + std::string(name) + " beyond 2^53";
}

}  // namespace stipple
