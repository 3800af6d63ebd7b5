#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>

namespace stipple {

struct RandomSamplingOptions {
    std::uint64_t target_size = 0;  ///< exactly this many points, >= 1; all if there are fewer
    std::uint64_t seed = 0;
};

/// A random subset of a cloud: every subset of that size is equally likely. A baseline for the
/// methods of the paper, which explains why it is not one of them (§3.2: true subsampling aliases,
/// and spreads its points unevenly).
///
/// Points keep their order and all their attributes. The choice depends only on the number of
/// points, the target and the seed. Positions need not be finite.
///
/// @throws Error(InvalidArgument) for an empty cloud or a target of 0.
///
/// O(N); 4 bytes per kept point.
PointCloud random_sampling(const PointCloud& cloud, const RandomSamplingOptions& options,
                           const RunContext& context = {});

}  // namespace stipple
