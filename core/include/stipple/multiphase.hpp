#pragma once

#include "stipple/iterative_simplification.hpp"

#include <cstdint>
#include <functional>
#include <span>

namespace stipple {

struct MultiphaseOptions {
    double oversampling = 3;  ///< m in [1, 1000]: the first phase makes m * N clusters; more of
                              ///< them cost time and reduce the error little
    IterativeSimplificationOptions
        contraction{};  ///< for the second phase; its `target_size` is the N of both
};

/// Multiphase simplification: hierarchical clustering (§3.1) to m * N samples that carry the
/// quadrics of the points they represent (§3.2), then contraction to exactly N (Garland and Shaffer
/// 2002, on points). The default method.
///
/// Its points finally move as those of `iterative_simplification` do, and so lie slightly outside
/// of curved parts, which lowers the error of the surface through them;
/// `contraction.max_displacement` bounds this. They are fitted to the samples, which are means of
/// points, so that little of a scan's noise remains, as long as the noise is below the spacing of
/// the samples. If a fiftieth of the points or fewer is left, this is done twice, the second time
/// from the new places, which takes little of the time.
///
/// Opposite sides of a wall, a sheet or a leaf are kept apart, and so are their colours: clusters
/// of both are split between them, as those of `hierarchical_clustering`, and points that lie in
/// two layers stay amid their samples. Not so where the sides bend by as much as the gap between
/// the new points, or where noise is above a tenth of it.
///
/// Samples are contracted along the tree of the clustering: among pairs of halves of a cluster,
/// each already one point, the pair with the least quadric error times distance becomes the point
/// that minimises the sum of their quadrics. To limit the maximum error, no point represents more
/// than twice its share of the samples, as far as the tree permits. So a point represents a cluster
/// of the tree, and its attributes are reduced from those of the cluster's points. With
/// `Placement::EndPoint` it is the input point of the cluster nearest to that place, with all its
/// attributes. Weights of attributes and `max_displacement` work as in `iterative_simplification`.
///
/// The cloud must hold finite, distinct positions (`clean`). A target of all points, or more,
/// returns the cloud unchanged. Points on a line or a plane stay on it, except for rounding.
///
/// @throws Error(InvalidArgument) for an empty cloud or an option out of range, like
/// `iterative_simplification`.
///
/// Expected O(P log N), parallel. Beyond the cloud 8 bytes per point, or 4 per point, 250 for each
/// of the m * N samples and up to 2,200 for each of the N, but for at most 12,000 of them per
/// thread: whichever is more.
PointCloud multiphase(const PointCloud& cloud, const MultiphaseOptions& options,
                      const RunContext& context = {});

/// The clouds of many sizes from one run, with the m * N samples of the largest: a much smaller one
/// has about a tenth more error than from a run of its own.
///
/// @param sizes  each at least 1; `contraction.target_size` is ignored.
/// @param on_cloud  called for each size, in their order, on the calling thread.
void multiphase_snapshots(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                          const MultiphaseOptions& options,
                          const std::function<void(PointCloud&&)>& on_cloud,
                          const RunContext& context = {});

}  // namespace stipple
