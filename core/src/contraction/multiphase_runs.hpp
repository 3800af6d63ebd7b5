#pragma once

#include "clustering/cluster_tree.hpp"
#include "stipple/multiphase.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <map>
#include <span>
#include <vector>

namespace stipple {

/// `multiphase` to several sizes: the first phase of all of them is one tree, of which each size
/// has its own cut; the second is run when it is asked for.
class MultiphaseRuns {
public:
    /// @param sizes  that will be asked for, in any order.
    /// @throws Error(InvalidArgument) as `multiphase`.
    /// The cloud must stay and not change. The tree is gone afterwards; 4 bytes a point and 12 for
    /// each sample stay.
    MultiphaseRuns(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                   const MultiphaseOptions& options, const RunContext& context);

    PointCloud run(std::uint64_t size, const RunContext& context) const;

private:
    const PointCloud& cloud_;
    MultiphaseOptions options_;
    std::vector<Index> members_;         ///< of the tree
    std::map<std::uint64_t, Cut> cuts_;  ///< samples, by the size that they are for
};

}  // namespace stipple
