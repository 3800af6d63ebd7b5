#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <optional>

namespace stipple {

/// The positions of a cloud without those that are not needed to say where its surface is for one
/// with fewer points. Of the points in each of many cells a third stays, but all up to 16, and 16
/// more for each point of the other there: so a sparse part keeps its points, however dense
/// another is. In the order of the cloud. Nothing where all should stay: there are no more than
/// 100,000, or about half of them would. Positions are finite.
///
/// O(N) on one thread, about 5 ns a point; 4 bytes a point.
std::optional<PointCloud> thinned_for(const PointCloud& other, const PointCloud& cloud,
                                      const RunContext& context);

}  // namespace stipple
