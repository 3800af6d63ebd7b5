#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>

namespace stipple {

/// As `subset(cloud, indices)`, and stops when asked to.
PointCloud subset(const PointCloud& cloud, std::span<const Index> indices,
                  const RunContext& context);

/// The same cloud again, unless asked to stop meanwhile.
PointCloud copy_of(const PointCloud& cloud, const RunContext& context);

}  // namespace stipple
