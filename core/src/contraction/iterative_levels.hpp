#pragma once

#include "stipple/iterative_simplification.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <functional>
#include <span>

namespace stipple {

/// As `iterative_snapshots`, but that a level is contracted from a finer one where there is one
/// with enough points (`levels_of_base`), and not from the cloud: from its points where they were
/// before they were fitted, to which it is fitted itself, with the quadrics that they have of the
/// cloud. It stands for the cloud's points all the same, and has its attributes and the bound on
/// displacements from them. About as near to the surface. What levels by quarters cost beside the
/// finest alone, and how near they come, is in bench/README.md, "Levels by method".
void iterative_levels(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                      const IterativeSimplificationOptions& options,
                      const std::function<void(PointCloud&&)>& on_cloud, const RunContext& context);

}  // namespace stipple
