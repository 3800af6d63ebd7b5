#pragma once

#include "clustering/representatives.hpp"
#include "contraction/contraction_options.hpp"
#include "contraction/quadric.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

/// Samples that stand for clusters, and what moving each of them costs: a quadric relative to its
/// own position, of which only the upper triangle of A is not zero.
class QuadricSamples {
public:
    /// The quadrics of §3.2: planes through each edge e_i to the k nearest samples and b_i = e_i x
    /// n, n being the normal of all points in the clusters of those samples; where they lie on one
    /// side, a plane that holds the border; and a little of the squared distance to the sample,
    /// more where the surface is rough, which makes every minimum one point. Weighted by area, in
    /// units of the bounding box, so that clouds of any size do.
    ///
    /// Where points have features, those of a sample are the means of its cluster, and their
    /// gradients join its quadric.
    ///
    /// A sample lies where the surface is over the centroid of its cluster, as far as the curvature
    /// of its surroundings tells; that of a single point where the point is, or very near.
    ///
    /// Quickest for clusters in the order of a tree, as `ClusterTree` has them. Expected O(N + M k)
    /// for N points in M clusters, parallel; 36 bytes a cluster, and about 70 more while it runs.
    QuadricSamples(std::span<const Vec3f> points, const MemberLists& clusters, unsigned k,
                   const Features& features, const RunContext& context);

    std::size_t size() const noexcept { return positions_.size(); }
    std::span<const Vec3f> positions() const noexcept { return positions_; }
    Vec3d position(Index i) const noexcept { return positions_[i].cast<double>(); }
    Quadric quadric(Index i) const noexcept;

private:
    struct Matrix {
        float xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
        Matrix() = default;
        explicit Matrix(const Quadric& q) noexcept;
    };
    std::vector<Vec3f> positions_;
    std::vector<Matrix> matrices_;
};

}  // namespace stipple
