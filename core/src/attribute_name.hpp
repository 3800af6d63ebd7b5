#pragma once

#include <algorithm>
#include <string_view>

namespace stipple {

inline constexpr std::string_view kAttributeNameRule =
    "1 to 255 printable ASCII characters without spaces";

/// Whether `Attribute::name` may be so.
inline bool is_attribute_name(std::string_view name) noexcept {
    return !name.empty() && name.size() <= 255 &&
           std::ranges::all_of(name, [](char c) { return c > ' ' && c < '\x7f'; });
}

}  // namespace stipple
