#pragma once

#include "foot_finder.hpp"
#include "point_tree.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace stipple {

/// The cloud Q of §4: places on a surface, each standing for a part of it. In an order in which
/// neighbours follow each other.
struct ErrorSamples {
    std::vector<Vec3f> positions;
    std::vector<float> areas;  ///< of the part, in any unit; none negative, not all zero

    std::size_t size() const noexcept { return positions.size(); }
    void resize(std::size_t n, const RunContext& context);
    void append(const ErrorSamples& more);
};

/// The area around each point, up to a common factor: the squared distance to the third neighbour,
/// as the median of the sixteen points of two leaves (1 / rho of §2, k = 3). Numbers follow the
/// tree: 8 l + j for point j of leaf l. O(N), parallel.
std::vector<float> point_areas(const PointTree& tree, const RunContext& context);

/// `count` of the points, evenly drawn, each with its area (by its own eighth neighbour: that of a
/// few points has to be right for each); all of them, with `point_areas`, when there are no more.
ErrorSamples take_points(const PointTree& tree, std::uint64_t count, std::uint64_t seed,
                         const RunContext& context);

/// `count` of the points as well, with less left to chance: large areas, of which a few points
/// would decide, are drawn more often. The area of a point, by its sixth neighbour, is divided by
/// that by which it was drawn, about the distance to its third in the leaf. Some may come twice;
/// all come once, with `point_areas`, when there are no more. Of very many points those of four
/// leaves for each sample are drawn from, evenly drawn themselves. O(count), parallel.
ErrorSamples take_points_by_area(const PointTree& tree, std::uint64_t count, std::uint64_t seed,
                                 const RunContext& context);

/// `count` random places of the surface, evenly over its area: points drawn by their area, moved in
/// their tangent planes by up to about half a spacing, and projected.
ErrorSamples take_surface(const PointTree& tree, const FootFinder& surface, std::uint64_t count,
                          std::uint64_t seed, const RunContext& context);

/// `count` particles at rest on the surface of the points (§3.3), each for the same area. One that
/// has come to where the surface is not to be found is at the nearest point instead.
ErrorSamples take_particles(std::span<const Vec3f> points, const PointTree& tree,
                            const FootFinder& surface, std::uint64_t count, std::uint64_t seed,
                            const RunContext& context);

}  // namespace stipple
