// CGAL, called as its manual shows: double-precision points, Eigen for the eigenvectors.

#include "peers.hpp"

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/IO/read_ply_points.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/hierarchy_simplify_point_set.h>
#include <CGAL/random_simplify_point_set.h>
#include <cmath>
#include <iterator>
#include <memory>
#include <stdexcept>
#include <vector>

namespace stipple::bench {

namespace {

using Kernel = CGAL::Simple_cartesian<double>;
using Point = Kernel::Point_3;
using Points = std::vector<Point>;

Points& points_of(std::any& points) {
    return std::any_cast<Points&>(points);
}

std::size_t kept(const Points& points, Points::iterator first_to_remove) {
    return static_cast<std::size_t>(
        std::distance(points.begin(), Points::const_iterator(first_to_remove)));
}

/// Triangles and the tree that points into them.
struct TriangleTree {
    using Triangles = std::vector<Kernel::Triangle_3>;
    using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>;
    using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

    Triangles triangles;
    Tree tree;

    explicit TriangleTree(const TriangleMesh& mesh) {
        const auto point = [&](Index i) {
            const Vec3d& v = mesh.vertices[i];
            return Point(v.x(), v.y(), v.z());
        };
        for (const auto& [a, b, c] : mesh.triangles) {
            const Kernel::Triangle_3 triangle(point(a), point(b), point(c));
            if (!triangle.is_degenerate()) triangles.push_back(triangle);
        }
        tree.rebuild(triangles.begin(), triangles.end());
        tree.accelerate_distance_queries();
    }
};

}  // namespace

bool have_cgal() noexcept {
    return true;
}

std::any cgal_points(const PointCloud& cloud) {
    Points points;
    points.reserve(cloud.size());
    for (const Vec3f& p : cloud.positions) points.emplace_back(p.x(), p.y(), p.z());
    return points;
}

std::size_t cgal_hierarchy(std::any& any, unsigned cluster_size) {
    Points& points = points_of(any);
    return kept(points,
                CGAL::hierarchy_simplify_point_set(points, CGAL::parameters::size(cluster_size)));
}

std::size_t cgal_random(std::any& any, std::size_t target) {
    Points& points = points_of(any);
    const double removed =
        100.0 * (1.0 - static_cast<double>(target) / static_cast<double>(points.size()));
    return kept(points, CGAL::random_simplify_point_set(points, removed));
}

PointCloud from_cgal(const std::any& any, std::size_t count) {
    const auto& points = std::any_cast<const Points&>(any);
    PointCloud cloud;
    for (std::size_t i = 0; i < count; ++i)
        cloud.positions.push_back(Vec3d(points[i].x(), points[i].y(), points[i].z()).cast<float>());
    return cloud;
}

std::any cgal_read_ply(const std::filesystem::path& file) {
    Points points;
    if (!CGAL::IO::read_PLY(file.string(), std::back_inserter(points)))
        throw std::runtime_error("CGAL cannot read " + file.string());
    return points;
}

std::function<double(const Vec3d&)> cgal_distance_to(const TriangleMesh& mesh) {
    const auto tree = std::make_shared<const TriangleTree>(mesh);
    return [tree](const Vec3d& q) {
        return std::sqrt(tree->tree.squared_distance(Point(q.x(), q.y(), q.z())));
    };
}

}  // namespace stipple::bench
