#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <span>

namespace stipple {

/// Removes the points whose mark is not 0, with all they have; the others keep their order.
void keep_unmarked(PointCloud& cloud, std::span<const std::uint8_t> marks,
                   const RunContext& context);

}  // namespace stipple
