#pragma once

#include "analysis/lone_points.hpp"
#include "error/foot_finder.hpp"
#include "neighbors/point_tree.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace stipple {

/// Samples that tell the mean and its like. A cloud of at least so many points is measured at
/// points of it, one of fewer at places of its surface.
inline constexpr std::uint64_t kEnoughSamples = 40'000;

/// The cloud Q of §4: places on a surface, each standing for a part of it. In an order in which
/// neighbours follow each other.
struct ErrorSamples {
    std::vector<Vec3f> positions;
    std::vector<float> areas;          ///< of the part, in any unit; none negative, not all zero
    std::vector<std::size_t> numbers;  ///< of `take_points_by_area`: of the points in the tree (8 l
                                       ///< + j for point j of leaf l); else empty
    std::vector<float> doubtful_sq;    ///< of their feet, as of `distance_of`; empty: not known

    std::size_t size() const noexcept { return positions.size(); }
    void resize(std::size_t n, const RunContext& context);
    void append(const ErrorSamples& more);
};

/// `count` of the points, evenly drawn, each with the area around it by its eight neighbours (§2);
/// all of them when there are no more. Of all 0.4 us a point, else 0.7 us; parallel.
ErrorSamples take_points(const LonePoints& points, std::uint64_t count, std::uint64_t seed,
                         const RunContext& context);

/// How far from a point places are drawn, over the distance to its third neighbour: more leads
/// beyond borders, where planes through neighbours go on but the surface does not.
inline constexpr float kPlaceReach = 0.6F;

struct PointAreas {
    std::vector<float> areas;
    std::vector<float> doubtful_sq;  ///< of feet from there, as of `distance_of`
};

/// The area around each of some points, up to a common factor; not zero for all. By the mean of the
/// squared distances to eight neighbours, nearer to the areas of a scan's triangles than by any
/// single one of them; a point that lies alone stands for as much as most do.
PointAreas areas_around(const LonePoints& points, std::span<const Vec3f> which,
                        const RunContext& context);

/// `count` points with their numbers, about as often as their areas are large, and the areas by
/// which they were drawn: by what lies beside them on the curve, none zero.
ErrorSamples draw_points_by_area(const LonePoints& points, std::uint64_t count, std::uint64_t seed,
                                 const RunContext& context);

/// `count` of the points as well, with less left to chance: large areas, of which a few points
/// would decide, are drawn more often. The area of a point, by its eight neighbours, is divided by
/// that by which it was drawn: the same by the eight nearest in its leaf and beside it on the
/// curve. Some may come twice; all come once, as `take_points` has them, when there are no more.
/// Where there are many more leaves than samples, eight times as many are looked at, drawn by the
/// sizes of their boxes. O(count) but for those boxes, 2 ns each; parallel.
ErrorSamples take_points_by_area(const LonePoints& points, std::uint64_t count, std::uint64_t seed,
                                 const RunContext& context);

struct SurfacePlaces {
    std::vector<Vec3f> positions;
    std::vector<float> doubtful_sq;  ///< of their feet, as of `distance_of`
};

/// Random places of the surface beside points of it: those moved in their tangent planes by up to
/// about half a spacing, and projected; the point where there is no surface, and where it lies
/// alone.
///
/// @param bases  of each place the point; the same follow each other.
SurfacePlaces random_places(const LonePoints& points, const FootFinder& surface,
                            std::span<const Vec3f> bases, std::uint64_t seed,
                            const RunContext& context);

/// The same in half the time, each by itself: in the plane of the eight points nearest to the base.
///
std::vector<Vec3f> places_beside(const LonePoints& points, const FootFinder& surface,
                                 std::span<const Vec3f> bases, std::uint64_t seed,
                                 const RunContext& context);

/// `count` points, drawn by the area around them; the same follow each other. 0.4 us for each point
/// of the tree; parallel.
std::vector<Vec3f> draw_points(const LonePoints& points, std::uint64_t count, std::uint64_t seed,
                               const RunContext& context);

/// `count` random places of the surface, evenly over its area: beside points that are drawn by the
/// area around them.
ErrorSamples take_surface(const LonePoints& points, const FootFinder& surface, std::uint64_t count,
                          std::uint64_t seed, const RunContext& context);

/// `count` random places of the surface beside points of `take_points_by_area`, each for the area
/// of its point over that by which it was drawn: where there are many more points than places,
/// whose areas need not be known.
ErrorSamples take_surface_by_area(const LonePoints& points, const FootFinder& surface,
                                  std::uint64_t count, std::uint64_t seed,
                                  const RunContext& context);

/// `count` particles at rest on the surface of the points (§3.3), each for the same area. One that
/// has come to where the surface is not to be found is at the nearest point instead, and so is one
/// beside a point that lies alone.
ErrorSamples take_particles(const LonePoints& points, const FootFinder& surface,
                            std::uint64_t count, std::uint64_t seed, const RunContext& context);

}  // namespace stipple
