#pragma once

#include "foot_finder.hpp"
#include "point_tree.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>

namespace stipple {

/// Looks again at the largest distances, since a maximum is worth as much as its worst sample.
///
/// A distance to a surface changes by no more than the way that one goes: from eight places close
/// by (h / 20) it can be no larger than theirs and the way to them. So a foot counts that was not
/// found from the sample, where the neighbourhood is a knot without a normal. And a place that was
/// found on a surface by projection is one of it only if its eight neighbours (h / 100) are
/// projected to beside it: in front of folds an iteration comes to rest where there is nothing.
/// Such a place moves to the nearest point of the cloud.
///
/// @param places  a 500th of them is looked at, at most 32, and again as many until the largest
///                distance was: those that are moved are changed, with their distances.
/// @param drawn_on  the points of the surface that the places were projected to; null for places
///                  that are points themselves.
void confirm_worst(std::span<Vec3f> places, std::span<double> distances, const FootFinder& surface,
                   const FootFinder* drawn_on, std::span<const Vec3f> points, const PointTree& tree,
                   const RunContext& context);

}  // namespace stipple
