#pragma once

#include <string_view>

namespace stipple {

/// Whether an attribute of this name is what is `known` by another: as programs write the fields of
/// LAS, in any case, with or without underscores, and some with a word before (`scalar_GpsTime` is
/// known as `gps_time`).
bool is_known_as(std::string_view name, std::string_view known);

}  // namespace stipple
