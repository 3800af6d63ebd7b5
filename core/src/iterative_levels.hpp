#pragma once

#include "stipple/iterative_simplification.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <functional>
#include <span>

namespace stipple {

/// As `iterative_snapshots`, but that a level is contracted from a finer one with at least three
/// times its points, and not from the cloud, where there is one. It stands for the cloud's points
/// all the same: it is fitted to them, and has its attributes and the bound on displacements from
/// them. As near to the surface, and of levels each of a quarter of the points of the one before
/// all take 1.3 times as long as the finest.
void iterative_levels(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                      const IterativeSimplificationOptions& options,
                      const std::function<void(PointCloud&&)>& on_cloud, const RunContext& context);

}  // namespace stipple
