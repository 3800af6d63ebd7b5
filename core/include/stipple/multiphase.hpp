#pragma once

#include "stipple/iterative_simplification.hpp"

#include <cstdint>
#include <functional>
#include <span>

namespace stipple {

struct MultiphaseOptions {
    double oversampling = 3;  ///< m in [1, 1000]: the first phase makes m * N clusters; more of
                              ///< them cost time and gain little error
    IterativeSimplificationOptions contraction{};  ///< of the second phase; its `target_size` is
                                                   ///< the N of both
};

/// Multiphase simplification: hierarchical clustering (§3.1) to m * N samples that carry the
/// quadrics of what they stand for (§3.2), then contraction to exactly N (Garland and Shaffer 2002,
/// on points). The default method.
///
/// Its points move at the end as those of `iterative_simplification` do, and so lie slightly
/// outside of curved parts, which is what lowers the error of the surface through them;
/// `contraction.max_displacement` bounds it. They are fitted to the samples, which are means of
/// points, so that little of a scan's noise is left in them, as long as it is less than the
/// distance of the samples. Where a fiftieth of the points is left, or fewer, that is done twice,
/// the second time from where they are then, which takes little of the time.
///
/// Samples are contracted along the tree of the clustering: of two halves of a cluster, each one
/// point already, the pair with the least quadric error times their distance becomes the point
/// where the sum of their quadrics is least. As a guard of the maximum error no point stands for
/// more than twice its share of the samples, as far as the tree lets it be. So a point stands for a
/// cluster of the tree, and its attributes are those of the cluster's points, reduced by their
/// policy. With `Placement::EndPoint` it is the input point of the cluster that is nearest to that
/// place, with all its attributes. Weights of attributes and a bound of displacements count as they
/// do there.
///
/// The cloud must hold finite positions, no two alike (`clean`). A target of all points, or more,
/// returns the cloud as it is. Points on a line or a plane stay on it, but for rounding.
///
/// @throws Error(InvalidArgument) for an empty cloud or an option out of range, as
/// `iterative_simplification`.
/// Expected O(P log N), parallel; beyond the cloud 8 bytes a point, or 4, 250 for each of the m * N
/// samples and up to 2,200 for each of the N, but 12,000 of them a thread at most: whichever is
/// more.
PointCloud multiphase(const PointCloud& cloud, const MultiphaseOptions& options,
                      const RunContext& context = {});

/// The clouds of many sizes from one run, with the m * N samples of the largest: a much
/// smaller one has about a tenth more error than by a run of its own.
///
/// @param sizes  each at least 1; `contraction.target_size` is not read.
/// @param on_cloud  called for each size, in their order, on the calling thread.
void multiphase_snapshots(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                          const MultiphaseOptions& options,
                          const std::function<void(PointCloud&&)>& on_cloud,
                          const RunContext& context = {});

}  // namespace stipple
