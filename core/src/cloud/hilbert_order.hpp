#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

/// How fine the cells are that a curve goes through.
enum class Curve {
    Fine,    ///< mostly with one point
    Coarse,  ///< some with a few dozen: up to a quarter less time
};

/// The numbers of the points along a Hilbert curve through their box, equal cells in order of
/// number; a cell with many points is ordered by a curve through its own box, so that outliers and
/// dense spots cost nothing. Finite points.
///
/// O(N), parallel, the same for any number of threads; 16 bytes a point while it runs.
std::vector<Index> hilbert_order(std::span<const Vec3f> points, const RunContext& context,
                                 Curve curve = Curve::Fine);

}  // namespace stipple
