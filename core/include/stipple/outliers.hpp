#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

struct OutlierOptions {
    double deviations = 2.5;  ///< S, 1..100: fewer points are outliers the larger it is
};

/// @throws Error(InvalidArgument) for an option out of range.
void validate(const OutlierOptions& options);

/// The points that lie off the surfaces and lines of a cloud, ascending. After the statistical
/// outlier removal of Rusu et al. 2008, which looks at the mean distance d of each point from its
/// 12 nearest neighbours; here a point is an outlier if d is more than 1 + S/2 times
///
/// - the median d of those neighbours, or
/// - the geometric mean of d of all points and S standard deviations of log d above it, unless the
///   neighbourhood is flat or thin (λ0 <= λ1 / 10), and at most half of it outliers: sparse parts
///   of a scan are no outliers.
///
/// The second can be true of at most 1 in 1 + S² points. Groups of more than 12 points as dense as
/// what is around them stay. A cloud of 12 points or fewer has no outliers.
///
/// @param points  finite, distinct (`clean`), input units.
/// @throws Error(InvalidArgument) for an option out of range.
///
/// O(N log N), parallel, the same points for any number of threads; about 0.2 us per point on one
/// core (`stipple-bench --filter outliers/`), and 60 bytes per point.
std::vector<Index> find_outliers(std::span<const Vec3f> points, const OutlierOptions& options = {},
                                 const RunContext& context = {});

/// Removes them; the other points keep their order and their attributes. If stopped, the cloud is
/// left in an unspecified state.
///
/// @return how many there were.
std::size_t remove_outliers(PointCloud& cloud, const OutlierOptions& options = {},
                            const RunContext& context = {});

}  // namespace stipple
