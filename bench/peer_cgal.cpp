// CGAL, called as its manual shows: double-precision points, Eigen for the eigenvectors.

#include "peer_tools.hpp"

#include <tbb/global_control.h>

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/IO/read_ply_points.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/grid_simplify_point_set.h>
#include <CGAL/hierarchy_simplify_point_set.h>
#include <CGAL/mst_orient_normals.h>
#include <CGAL/pca_estimate_normals.h>
#include <CGAL/property_map.h>
#include <CGAL/random_simplify_point_set.h>
#include <CGAL/wlop_simplify_and_regularize_point_set.h>
#include <cmath>
#include <iterator>
#include <memory>
#include <stdexcept>
#include <utility>

namespace stipple::bench::cgal {

namespace {

using Kernel = CGAL::Simple_cartesian<double>;
using Point = Kernel::Point_3;
using Points = std::vector<Point>;
using PointWithNormal = std::pair<Point, Kernel::Vector_3>;
using PointsWithNormals = std::vector<PointWithNormal>;

Points points_of(const PointCloud& cloud) {
    Points points;
    points.reserve(cloud.size());
    for (const Vec3f& p : cloud.positions) points.emplace_back(p.x(), p.y(), p.z());
    return points;
}

PointCloud cloud_of(const Points& points, std::size_t count) {
    PointCloud cloud;
    for (std::size_t i = 0; i < count; ++i)
        cloud.positions.push_back(Vec3d(points[i].x(), points[i].y(), points[i].z()).cast<float>());
    return cloud;
}

std::size_t kept(const Points& points, Points::iterator first_to_remove) {
    return static_cast<std::size_t>(
        std::distance(points.begin(), Points::const_iterator(first_to_remove)));
}

std::size_t hierarchy(Points& points, unsigned size) {
    return kept(points, CGAL::hierarchy_simplify_point_set(points, CGAL::parameters::size(size)));
}

std::size_t grid(Points& points, double cell) {
    return kept(points, CGAL::grid_simplify_point_set(points, cell));
}

double percent(std::size_t part, std::size_t whole) {
    return 100.0 * static_cast<double>(part) / static_cast<double>(whole);
}

/// A function that reorders points in place and says how many of the first it keeps.
Peer in_place(
    std::string name, const Model& model, std::function<std::size_t(Points& points)> simplify,
    std::function<void()> tune = [] {}) {
    return {.name = std::move(name),
            .load = [&model, tune = std::move(tune)]() -> std::any {
                tune();
                return points_of(model.cloud);
            },
            .run = [simplify = std::move(simplify)](std::any& points, unsigned) -> std::any {
                return simplify(std::any_cast<Points&>(points));
            },
            .points =
                [](const std::any& points, const std::any& count) {
                    return cloud_of(std::any_cast<const Points&>(points),
                                    std::any_cast<std::size_t>(count));
                }};
}

/// The same, of a parameter that has to be found.
Peer tuned_in_place(std::string name, const Model& model, std::size_t target, double guess,
                    bool whole, std::size_t (*simplify)(Points&, double)) {
    const auto parameter = std::make_shared<double>(0);
    return in_place(
        std::move(name), model, [=](Points& points) { return simplify(points, *parameter); },
        [=, &model] {
            if (*parameter != 0) return;
            *parameter = tuned(
                [&](double value) {
                    Points points = points_of(model.cloud);
                    return simplify(points, value);
                },
                target, guess, whole);
        });
}

template <typename Concurrency>
Points wlop(Points& points, std::size_t target) {
    Points result;
    CGAL::wlop_simplify_and_regularize_point_set<Concurrency>(
        points, std::back_inserter(result),
        CGAL::parameters::select_percentage(percent(target, points.size())));
    return result;
}

Peer wlop_peer(const Model& model, std::size_t target) {
    return {.name = "CGAL WLOP",
            .load = [&model]() -> std::any { return points_of(model.cloud); },
            .run = [target](std::any& any, unsigned threads) -> std::any {
                auto& points = std::any_cast<Points&>(any);
                const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                                threads);
                return threads == 1 ? wlop<CGAL::Sequential_tag>(points, target)
                                    : wlop<CGAL::Parallel_tag>(points, target);
            },
            .points =
                [](const std::any&, const std::any& value) {
                    const auto& points = std::any_cast<const Points&>(value);
                    return cloud_of(points, points.size());
                }};
}

auto with_normals() {
    return CGAL::parameters::point_map(CGAL::First_of_pair_property_map<PointWithNormal>())
        .normal_map(CGAL::Second_of_pair_property_map<PointWithNormal>());
}

PointsWithNormals points_with_normals(const PointCloud& cloud, const std::vector<Vec3f>& normals) {
    PointsWithNormals points(cloud.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
        const Vec3f& p = cloud.positions[i];
        points[i].first = Point(p.x(), p.y(), p.z());
        if (normals.empty()) continue;
        points[i].second = Kernel::Vector_3(normals[i].x(), normals[i].y(), normals[i].z());
    }
    return points;
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

std::vector<Peer> simplifiers(const Model& model, std::size_t target) {
    const double ratio =
        static_cast<double>(model.cloud.size()) / static_cast<double>(std::max(target, 1UL));
    const double diagonal = bounds(model.cloud).diagonal();
    return {tuned_in_place(
                "CGAL hierarchy", model, target, 1.35 * ratio, true,
                [](Points& p, double size) { return hierarchy(p, static_cast<unsigned>(size)); }),
            wlop_peer(model, target),
            tuned_in_place("CGAL grid", model, target,
                           diagonal / std::sqrt(static_cast<double>(target)), false, grid),
            in_place("CGAL random", model, [target](Points& points) {
                return kept(points, CGAL::random_simplify_point_set(
                                        points, 100.0 - percent(target, points.size())));
            })};
}

std::vector<Peer> analyzers(const Model& model, unsigned k) {
    return {{.name = "CGAL pca_estimate_normals",
             .load = [&model]() -> std::any { return points_with_normals(model.cloud, {}); },
             .run = [k](std::any& any, unsigned threads) -> std::any {
                 auto& points = std::any_cast<PointsWithNormals&>(any);
                 const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                                 threads);
                 if (threads == 1)
                     CGAL::pca_estimate_normals<CGAL::Sequential_tag>(points, k, with_normals());
                 else
                     CGAL::pca_estimate_normals<CGAL::Parallel_tag>(points, k, with_normals());
                 return {};
             }}};
}

std::vector<Peer> orienters(const Model& model, const std::vector<Vec3f>& normals, unsigned k) {
    return {{.name = "CGAL mst_orient_normals",
             .load = [&model, normals]() -> std::any {
                 return points_with_normals(model.cloud, normals);
             },
             .run = [k](std::any& points, unsigned) -> std::any {
                 CGAL::mst_orient_normals(std::any_cast<PointsWithNormals&>(points), k,
                                          with_normals());
                 return {};
             }}};
}

std::vector<Peer> readers(const std::filesystem::path& file) {
    return {{.name = "CGAL read_PLY",
             .load = []() -> std::any { return {}; },
             .run = [file](std::any&, unsigned) -> std::any {
                 Points points;
                 if (!CGAL::IO::read_PLY(file.string(), std::back_inserter(points)))
                     throw std::runtime_error("CGAL cannot read " + file.string());
                 return points;
             }}};
}

std::function<double(const Vec3d&)> distance_to(const TriangleMesh& mesh) {
    const auto tree = std::make_shared<const TriangleTree>(mesh);
    return [tree](const Vec3d& q) {
        return std::sqrt(tree->tree.squared_distance(Point(q.x(), q.y(), q.z())));
    };
}

}  // namespace stipple::bench::cgal
