#pragma once

#include "stipple/clusters.hpp"
#include "stipple/codec.hpp"
#include "stipple/iterative_simplification.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/surface_attributes.hpp"

#include <string_view>

// What values of options are called in requests and on the command line. Each name is that of one
// value, and `..._from_name` @throws Error(InvalidArgument) naming those there are.

namespace stipple::proto {

std::string_view to_string(Reduction reduction) noexcept;
std::string_view to_string(Representative representative) noexcept;
std::string_view to_string(Placement placement) noexcept;
std::string_view to_string(SplatAttributes splats) noexcept;
std::string_view to_string(NormalSigns signs) noexcept;
std::string_view to_string(DracoCoding coding) noexcept;

Reduction reduction_from_name(std::string_view name);
Representative representative_from_name(std::string_view name);
Placement placement_from_name(std::string_view name);
SplatAttributes splats_from_name(std::string_view name);
NormalSigns normal_signs_from_name(std::string_view name);
DracoCoding draco_coding_from_name(std::string_view name);

}  // namespace stipple::proto
