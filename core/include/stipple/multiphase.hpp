#pragma once

#include "stipple/iterative_simplification.hpp"

namespace stipple {

struct MultiphaseOptions {
    double oversampling = 4;  ///< m >= 1: the first phase makes m * N clusters
    IterativeSimplificationOptions
        contraction;  ///< of the second phase; its `target_size` is the N of both
};

/// Multiphase simplification: hierarchical clustering to m * N samples that carry the quadrics of
/// their clusters, then point-pair contraction to N (Garland and Shaffer 2002, on points).
PointCloud multiphase(const PointCloud& cloud, const MultiphaseOptions& options,
                      const RunContext& context = {});

}  // namespace stipple
