#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

/// A partition {C_i} of the points of a cloud (§3.1), flat: cluster i is `members[offsets[i]] ..
/// members[offsets[i + 1]]`.
struct Clusters {
    std::vector<Index> members;  ///< a permutation of 0..N-1
    std::vector<Index> offsets;  ///< M + 1; no cluster is empty

    std::size_t size() const noexcept { return offsets.empty() ? 0 : offsets.size() - 1; }
    std::span<const Index> of(std::size_t i) const noexcept {
        return {members.data() + offsets[i], members.data() + offsets[i + 1]};
    }
};

/// Which point represents a cluster.
enum class Representative {
    Centroid,  ///< the mean (§3.1); shrinks curved parts, as §5.2 says
    Nearest,   ///< the input point nearest to the centroid; the result is a subset of the input
    Surface,   ///< the centroid moved along the cluster's normal onto a quadratic fitted to its
               ///< points
};

/// The cloud P' of representatives, cluster by cluster. Other attributes are reduced by their
/// policy (`Reduction`): colours averaged in linear light, by alpha if any; normals averaged and
/// renormalised; with `Nearest`, everything is that point's (but for attributes whose policy is
/// named in the options of a method). O(N), parallel over clusters.
PointCloud representatives(const PointCloud& cloud, const Clusters& clusters, Representative kind,
                           const RunContext& context = {});

}  // namespace stipple
