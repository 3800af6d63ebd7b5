#pragma once

#include "samples.hpp"
#include "stipple/clusters.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "symmetric_eigen.hpp"

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace stipple {

/// Where some samples are and how they spread.
struct SampleMoments {
    Vec3d centroid = Vec3d::Zero();
    Symmetric3 scatter;                   ///< sum of (p - centroid)(p - centroid)^T, Eq. 1
    std::array<double, 3> eigenvalues{};  ///< of the scatter, ascending

    /// Surface variation (Eq. 5).
    double variation() const noexcept {
        const double total = scatter.trace();
        return total > 0 ? std::max(0.0, eigenvalues[0]) / total : 0.0;
    }
};

/// The moments of at least one sample. Differences to the first are taken in float, so large
/// coordinates cost no accuracy.
SampleMoments moments_of(const SampleSpan& samples);

/// A node of the binary space partition: samples `begin..end` of the tree.
struct ClusterNode {
    Index begin = 0, end = 0;
    Index left = 0,
          right = 0;      ///< children; both 0 when not split yet (a root is nobody's child)
    double priority = 0;  ///< the larger is split first; never above the parent's
    SampleMoments moments;

    Index size() const noexcept { return end - begin; }
    bool is_split() const noexcept { return right != 0; }
    bool can_split() const noexcept { return size() > 1; }
};

/// A cut through the tree: cluster i is the samples `offsets[i] .. offsets[i + 1]`.
struct Cut {
    std::vector<Index> offsets;
    std::vector<SampleMoments> moments;
};

/// The binary space partition of a cloud, or of each of its clusters (§3.1), grown as far as asked.
///
/// Every node is a range of the samples, and its points stand there in the order of the cloud. 32
/// bytes a point.
class ClusterTree {
public:
    /// One root with all points: finite, no two alike, at least one.
    ClusterTree(std::span<const Vec3f> points, const RunContext& context);

    /// A root for each cluster, with its points in the order given there.
    ClusterTree(std::span<const Vec3f> points, const Clusters& clusters, const RunContext& context);

    /// Splits every leaf for which `wanted` says so, and its children, and so on. Parallel.
    void grow(const std::function<bool(const ClusterNode&)>& wanted, const RunContext& context);

    /// The clusters that a priority queue holds when there are `size` of them; grows the tree where
    /// it must. Number of roots <= size <= number of points.
    Cut cut(std::uint64_t size, const RunContext& context);

    /// The leaves.
    Cut leaves() const;

    /// The points, cluster by cluster, left before right.
    SampleSpan samples() const noexcept { return storage_.all().part(0, size_); }

private:
    void split_leaves(std::vector<Index> leaves, const RunContext& context);
    Cut cut_where(const std::function<bool(Index)>& descends) const;

    std::size_t size_;
    Index roots_ = 1;  ///< the first of `nodes_`
    Samples storage_;  ///< the samples, and as many places again for the half that moves
    std::vector<ClusterNode> nodes_;
};

}  // namespace stipple
