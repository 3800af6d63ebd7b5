#pragma once

#include "analysis/lone_points.hpp"
#include "error/foot_finder.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <vector>

namespace stipple {

/// Places of one surface and how far they are from another.
struct MeasuredPlaces {
    std::vector<Vec3f> places;
    std::vector<double> distances;
};

/// How far a point of a tree is from a surface.
struct KnownDistance {
    std::size_t at;  ///< its number in the tree: 8 l + j for point j of leaf l
    float distance;  ///< infinite where it says nothing of other points
};

/// From the foot of a point. It says something of the points around that when it is a fixed point
/// with samples near it, or where the surface has ended.
/// @param distance  of the point: `foot.distance`, unless it lies alone, which says nothing.
KnownDistance known_of(std::size_t at, const Foot& foot, double distance) noexcept;

/// Adds points of a cloud to places of which some are measured, until no other point is farther
/// from the surface than the farthest of them. Distances to a surface are 1-Lipschitz: that of a
/// point is at most that of another and the way between them. So most points are farther than none
/// without being looked at; of those that may be, every eighth is measured, and so on with what is
/// left. The largest distances are confirmed (`confirm_worst`).
///
/// @param known  of some points that are among the places; in the order of the tree, in which
///               points near each other follow each other.
/// O(N), parallel, and 1 to 2 us for each point that is added: a hundredth of a million where
/// 40,000 are known.
void add_farthest_points(const LonePoints& points, const FootFinder& surface,
                         std::vector<KnownDistance> known, MeasuredPlaces& measured,
                         const RunContext& context);

/// Adds random places of a surface beside its points around those places that are farthest from
/// another surface: sixteen for each of up to 256 points, and again as long as that finds one that
/// is more than a fiftieth farther, at most eight times. The largest distances are confirmed.
///
/// @param points  of the surface.
void add_places_around_farthest(const FootFinder& from, const LonePoints& points,
                                const FootFinder& to, MeasuredPlaces& measured,
                                const RunContext& context);

}  // namespace stipple
