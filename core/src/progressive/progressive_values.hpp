#pragma once

#include "progressive/progressive_layout.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace stipple {

/// Describes the attributes of a cloud as a stream has them: floats on a grid of `bits` where all
/// of them are finite. @throws Error(InvalidArgument) for what a stream cannot hold.
std::vector<ProgressiveAttribute> describe_attributes(const PointCloud& cloud, unsigned bits);

/// The channels of some points, in their order: normals, colours, attributes.
/// @return  as many values for each as `layout.channels()`.
std::vector<std::uint32_t> pack_channels(const PointCloud& cloud, std::span<const Index> points,
                                         const ProgressiveLayout& layout,
                                         const RunContext& context);

/// The inverse, for as many points as `values` has; fills all of the cloud but the positions.
void unpack_channels(std::span<const std::uint32_t> values, const ProgressiveLayout& layout,
                     PointCloud& cloud, const RunContext& context);

}  // namespace stipple
