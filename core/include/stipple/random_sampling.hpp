#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>

namespace stipple {

struct RandomSamplingOptions {
    std::uint64_t target_size =
        0;  ///< exactly so many points, >= 1; all of them when there are fewer
    std::uint64_t seed = 0;
};

/// Every subset of that size with equal probability; a baseline. Points keep their order.
PointCloud random_sampling(const PointCloud& cloud, const RandomSamplingOptions& options,
                           const RunContext& context = {});

}  // namespace stipple
