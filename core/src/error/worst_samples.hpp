#pragma once

#include "error/foot_finder.hpp"
#include "neighbors/point_tree.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

/// How far places are from a surface, each no farther than another place around it (up to h / 5),
/// or than the nearest sample, and the way to that: a distance to a surface changes by no more than
/// the way that one goes. So a foot counts that is not found from the place itself, where two
/// sheets fold into a knot without a normal or an iteration ends on the wrong one. A sample in a
/// knot stands for the surface, and a foot in one for a place whose own is in one, too.
std::vector<double> confirmed_distances(const FootFinder& surface, std::span<const Vec3f> places,
                                        const RunContext& context);

/// Looks again at the largest distances, since a maximum is worth as much as its worst sample: they
/// become their `confirmed_distances`. And a place that was found on a surface by projection is one
/// of it only if others around it (h / 100) are projected to beside it: in front of folds an
/// iteration comes to rest where there is nothing. Such a place moves to the foot of the nearest
/// point of the cloud, or to that point where its foot is no better.
///
/// @param places  a 500th of them is looked at, at most 32, then twice as many and so on until the
///                largest distance was, but no more than a 20th, and none of fewer than 2,048:
///                those that are moved are changed, with their distances.
/// @param drawn_on  the points of the surface that the places were projected to; null for places
///                  that are points themselves.
void confirm_worst(std::span<Vec3f> places, std::span<double> distances, const FootFinder& surface,
                   const FootFinder* drawn_on, std::span<const Vec3f> points, const PointTree& tree,
                   const RunContext& context);

}  // namespace stipple
