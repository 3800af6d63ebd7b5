#pragma once

#include "stipple/neighbors.hpp"
#include "stipple/point_cloud.hpp"
#include "surface_distance.hpp"

#include <any>
#include <filesystem>
#include <functional>
#include <span>

namespace stipple::bench {

/// The k nearest neighbours of every point by one nanoflann tree, the queries spread over
/// `threads`, written into the same flat lists as stipple's.
NeighborLists nanoflann_nearest_neighbors(std::span<const Vec3f> points, unsigned k,
                                          unsigned threads);

// CGAL is optional: without it `have_cgal` is false and the others must not be called
// (`cgal_distance_to` may).

bool have_cgal() noexcept;

/// Points in CGAL's own type, so that the copy can be made outside the timed part.
std::any cgal_points(const PointCloud& cloud);

/// `CGAL::hierarchy_simplify_point_set` on the points of `cgal_points`, which it reorders. @return
/// how many it keeps: the first ones.
std::size_t cgal_hierarchy(std::any& points, unsigned cluster_size);
/// `CGAL::random_simplify_point_set`, in the same way.
std::size_t cgal_random(std::any& points, std::size_t target);

/// The first `count` points, back in stipple's type.
PointCloud from_cgal(const std::any& points, std::size_t count);

/// `CGAL::IO::read_PLY` for point sets: positions only. @return the points, as `cgal_points`.
std::any cgal_read_ply(const std::filesystem::path& file);

/// The distance of a place to the nearest triangle (CGAL's AABB tree); null without CGAL.
std::function<double(const Vec3d&)> cgal_distance_to(const TriangleMesh& mesh);

}  // namespace stipple::bench
