// The error of simplification as in Pauly, Gross, Kobbelt 2002, §4, with the adaptive MLS surface
// of §2.2.
//
// What the paper leaves open is settled thus. The surface S' must not depend on the query, so
// neighbours and h = r / 3 are taken anew at each iterate x, and x <- q - (n . (q - a)) n goes on
// to a fixed point. There can be several: the iteration starts from q and from the sample nearest
// to q, and the nearer foot counts. Means over the original are means over its area: random points
// of the mesh where there is one, else the points weighted by 1 / rho = r^2 / k (§2).
//
// A linear MLS surface lies inside curved parts by about h^2 kappa / 2, which is much of Δavg for
// every method. Therefore the quadratic mean and the distances to the mesh stand beside it: a gain
// in Δavg alone is not a gain.

#include "surface_distance.hpp"

#include "peers.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <limits>
#include <nanoflann.hpp>
#include <numbers>
#include <numeric>
#include <optional>
#include <random>
#include <span>
#include <stdexcept>
#include <thread>

namespace stipple::bench {

namespace {

constexpr unsigned kMaxNeighbors = 64;
constexpr unsigned kMaxIterations = 30;
constexpr double kConvergedStep = 1e-4;  // of h
constexpr unsigned kDensityNeighbors =
    6;  // for the area of a point and the spread of dense samples

/// Calls `body(i)` for 0..n on `threads` threads, in chunks taken as they come.
void for_each_index(std::size_t n, unsigned threads, const std::function<void(std::size_t)>& body) {
    constexpr std::size_t kChunk = 256;
    std::atomic<std::size_t> next = 0;
    const auto work = [&] {
        for (std::size_t begin; (begin = next.fetch_add(kChunk)) < n;)
            for (std::size_t i = begin; i < std::min(n, begin + kChunk); ++i) body(i);
    };
    std::vector<std::jthread> others;
    for (unsigned t = 1; t < threads; ++t) others.emplace_back(work);
    work();
}

/// The neighbours of a place, nearest first.
struct Neighborhood {
    unsigned size = 0;
    std::array<Index, kMaxNeighbors> indices;
    std::array<double, kMaxNeighbors> distances_sq;

    double radius() const { return std::sqrt(distances_sq[size - 1]); }
};

class PointTree {
public:
    explicit PointTree(std::vector<Vec3d> points)
        : points_(std::move(points)), tree_(3, *this, {10}) {}
    PointTree(const PointTree&) = delete;
    PointTree& operator=(const PointTree&) = delete;

    const std::vector<Vec3d>& points() const { return points_; }

    Neighborhood nearest(const Vec3d& x, unsigned k) const {
        Neighborhood found;
        found.size = static_cast<unsigned>(
            tree_.knnSearch(x.data(), k, found.indices.data(), found.distances_sq.data()));
        return found;
    }

    // What nanoflann asks for.
    std::size_t kdtree_get_point_count() const { return points_.size(); }
    double kdtree_get_pt(std::size_t i, std::size_t axis) const {
        return points_[i][static_cast<Eigen::Index>(axis)];
    }
    template <typename Box>
    bool kdtree_get_bbox(Box&) const {
        return false;
    }

private:
    using Tree =
        nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, PointTree>,
                                            PointTree, 3, Index>;
    std::vector<Vec3d> points_;
    Tree tree_;
};

/// The reference plane of Eq. 6 at x: through the weighted mean `a`, with normal `n`.
struct Plane {
    Vec3d x = Vec3d::Zero();
    Vec3d a = Vec3d::Zero();
    Vec3d n = Vec3d::UnitZ();
    double h = 0;
    double roundness = 0;  ///< λ0 / λ1: 1 where the normal is any
    Neighborhood neighbors;

    double weight(unsigned i) const { return std::exp(-neighbors.distances_sq[i] / (h * h)); }
};

/// Where a query meets the MLS surface.
struct Foot {
    Vec3d point = Vec3d::Zero();
    double distance = std::numeric_limits<double>::infinity();
    double distance_quadratic = 0;
    double roundness = 0;  ///< of the plane
    bool converged = false;
};

class MlsSurface {
public:
    MlsSurface(std::vector<Vec3d> points, unsigned k)
        : tree_(std::move(points)),
          k_(std::min<unsigned>(k, static_cast<unsigned>(tree_.points().size()))) {}

    const PointTree& tree() const { return tree_; }
    const std::vector<Vec3d>& points() const { return tree_.points(); }

    /// The nearest of the feet found from q and from the sample nearest to q.
    Foot project(const Vec3d& q) const {
        const Foot direct = project_from(q, q);
        const Foot from_sample = project_from(q, points()[tree_.nearest(q, 1).indices[0]]);
        Foot nearest = from_sample.distance < direct.distance ? from_sample : direct;
        nearest.converged = direct.converged && from_sample.converged;
        return nearest;
    }

    /// The distance to the nearest place x with n(x) . (x - a(x)) = 0 and samples beside it, as far
    /// as it is found: from the neighbours of q, from random places around it, and then around the
    /// best, walks along the normals of the surface, which come to an end where the way across from
    /// q does not.
    double nearest_place(const Vec3d& q, unsigned starts, std::mt19937_64& random) const {
        const Neighborhood around = tree_.nearest(q, k_);
        const double to_sample = std::sqrt(around.distances_sq[0]);
        Vec3d best = points()[around.indices[0]];
        double least = std::numeric_limits<double>::infinity();
        const auto walk_from = [&](const Vec3d& start) {
            const std::optional<Vec3d> place = place_near(start);
            if (!place || (q - *place).norm() >= least) return;
            least = (q - *place).norm();
            best = *place;
        };
        std::normal_distribution<double> normal;
        const auto walk_around = [&](const Vec3d& center, double deviation, unsigned times) {
            for (unsigned i = 0; i < times; ++i) {
                const Vec3d way(normal(random), normal(random), normal(random));
                walk_from(center + deviation * way);
            }
        };
        walk_from(q);
        for (unsigned i = 0; i < around.size; ++i) walk_from(points()[around.indices[i]]);
        walk_around(q, to_sample, starts / 2);
        if (!std::isfinite(least)) return to_sample;
        for (const double closer : {0.5, 0.2, 0.07}) walk_around(best, closer * least, starts / 6);
        return least;
    }

    Plane plane_at(const Vec3d& x) const {
        Plane plane{.x = x, .neighbors = tree_.nearest(x, k_)};
        plane.h = plane.neighbors.radius() / 3.0;
        if (plane.h == 0) plane.h = 1;  // all neighbours lie at x: any width gives equal weights

        double total = 0;
        for (unsigned i = 0; i < plane.neighbors.size; ++i) {
            plane.a += plane.weight(i) * points()[plane.neighbors.indices[i]];
            total += plane.weight(i);
        }
        plane.a /= total;
        Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
        for (unsigned i = 0; i < plane.neighbors.size; ++i) {
            const Vec3d d = points()[plane.neighbors.indices[i]] - plane.a;
            covariance.noalias() += plane.weight(i) * d * d.transpose();
        }
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
        solver.computeDirect(covariance);
        plane.n = solver.eigenvectors().col(0);
        if (solver.eigenvalues()[1] > 0)
            plane.roundness = std::max(0.0, solver.eigenvalues()[0]) / solver.eigenvalues()[1];
        return plane;
    }

private:
    std::optional<Vec3d> place_near(Vec3d x) const {
        for (unsigned i = 0; i < kMaxIterations; ++i) {
            const Plane plane = plane_at(x);
            const double height = plane.n.dot(x - plane.a);
            x -= height * plane.n;
            if (std::abs(height) > kConvergedStep * plane.h) continue;
            const bool beside = plane.neighbors.distances_sq[0] <= 2.25 * plane.h * plane.h;
            return beside ? std::optional(x) : std::nullopt;
        }
        return std::nullopt;
    }

    Foot project_from(const Vec3d& q, const Vec3d& start) const {
        Foot foot;
        Plane best;
        double least_step = std::numeric_limits<double>::infinity();
        Vec3d x = start;
        for (unsigned i = 0; i < kMaxIterations && !foot.converged; ++i) {
            const Plane plane = plane_at(x);
            const Vec3d next = q - plane.n.dot(q - plane.a) * plane.n;
            const double step = (next - x).norm();
            if (step < least_step) {
                least_step = step;
                best = plane;
                foot.point = next;
            }
            foot.converged = step <= kConvergedStep * plane.h;
            x = next;
        }
        foot.distance = (q - foot.point).norm();
        foot.roundness = best.roundness;
        foot.distance_quadratic =
            std::abs(best.n.dot(q - best.a) - quadratic_height(best, foot.point));
        return foot;
    }

    /// g(0, 0) of the weighted quadratic polynomial over the plane, its origin at the foot.
    double quadratic_height(const Plane& plane, const Vec3d& origin) const {
        constexpr unsigned kTerms = 6;
        if (plane.neighbors.size < kTerms) return 0;
        using Terms = Eigen::Matrix<double, kTerms, 1>;
        Eigen::Matrix<double, kTerms, kTerms> A = Eigen::Matrix<double, kTerms, kTerms>::Zero();
        Terms b = Terms::Zero();
        const Vec3d u_axis = plane.n.unitOrthogonal();
        const Vec3d v_axis = plane.n.cross(u_axis);
        for (unsigned i = 0; i < plane.neighbors.size; ++i) {
            const Vec3d& p = points()[plane.neighbors.indices[i]];
            const double u = u_axis.dot(p - origin) / plane.h, v = v_axis.dot(p - origin) / plane.h;
            const Terms terms = (Terms() << 1, u, v, u * u, u * v, v * v).finished();
            A.noalias() += plane.weight(i) * terms * terms.transpose();
            b += plane.weight(i) * plane.n.dot(p - plane.a) * terms;
        }
        return A.ldlt().solve(b)[0];
    }

    PointTree tree_;
    unsigned k_;
};

std::vector<Vec3d> absolute_positions(const PointCloud& cloud) {
    std::vector<Vec3d> points;
    points.reserve(cloud.size());
    for (const Vec3f& p : cloud.positions) points.push_back(cloud.origin + p.cast<double>());
    return points;
}

std::vector<Vec3d> random_points(const TriangleMesh& mesh, std::size_t n, std::mt19937_64& random) {
    std::vector<double> area_up_to;
    double area = 0;
    for (const auto& [a, b, c] : mesh.triangles) {
        const auto& v = mesh.vertices;
        area += 0.5 * (v[b] - v[a]).cross(v[c] - v[a]).norm();
        area_up_to.push_back(area);
    }
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    std::vector<Vec3d> points;
    for (std::size_t i = 0; i < n; ++i) {
        const auto it =
            std::upper_bound(area_up_to.begin(), area_up_to.end() - 1, area * unit(random));
        const auto& [a, b, c] = mesh.triangles[static_cast<std::size_t>(it - area_up_to.begin())];
        const double s = std::sqrt(unit(random)), t = unit(random);
        points.push_back((1 - s) * mesh.vertices[a] + s * (1 - t) * mesh.vertices[b] +
                         s * t * mesh.vertices[c]);
    }
    return points;
}

double mean_of(std::span<const double> values) {
    return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double max_of(std::span<const double> values) {
    return *std::max_element(values.begin(), values.end());
}

double weighted_mean(std::span<const double> values, std::span<const double> weights) {
    return std::inner_product(values.begin(), values.end(), weights.begin(), 0.0) /
           std::accumulate(weights.begin(), weights.end(), 0.0);
}

/// The value that the fraction `q` of the weight does not exceed.
double weighted_quantile(std::span<const double> values, std::span<const double> weights,
                         double q) {
    std::vector<std::size_t> order(values.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::sort(order.begin(), order.end(), [&](auto a, auto b) { return values[a] < values[b]; });
    double left = q * std::accumulate(weights.begin(), weights.end(), 0.0);
    for (const std::size_t i : order)
        if ((left -= weights[i]) <= 0) return values[i];
    return values[order.back()];
}

}  // namespace

struct SurfaceMeter::Original {
    SurfaceDistanceOptions options;
    MlsSurface surface;
    double diagonal = 0;
    std::vector<Vec3d> points;          // a random part of P
    std::vector<double> point_weights;  // the area of each
    std::vector<Vec3d> mesh_points;     // random points of the mesh; none without one
    std::function<double(const Vec3d&)> distance_to_mesh;  // null without a mesh or without CGAL

    Original(const PointCloud& cloud, const TriangleMesh& mesh, const SurfaceDistanceOptions& given)
        : options(given), surface(absolute_positions(cloud), given.neighbors) {
        if (options.threads == 0)
            options.threads = std::max(1U, std::thread::hardware_concurrency());
        diagonal = bounds(cloud).diagonal();
        std::mt19937_64 random(options.seed);
        std::sample(surface.points().begin(), surface.points().end(), std::back_inserter(points),
                    options.samples, random);
        point_weights.resize(points.size());
        for_each_index(points.size(), options.threads, [&](std::size_t i) {
            const double r = surface.tree().nearest(points[i], kDensityNeighbors + 1).radius();
            point_weights[i] = r * r;
        });
        if (mesh.empty()) return;
        mesh_points = random_points(mesh, options.samples, random);
        if (!options.foot) {
            distance_to_mesh = distance_to(mesh);
            return;
        }
        for_each_index(mesh_points.size(), options.threads,
                       [&](std::size_t i) { mesh_points[i] = options.foot(mesh_points[i]); });
        distance_to_mesh = [this](const Vec3d& q) { return (q - options.foot(q)).norm(); };
    }

    std::vector<Foot> feet(const MlsSurface& target, std::span<const Vec3d> queries) const {
        std::vector<Foot> result(queries.size());
        for_each_index(queries.size(), options.threads,
                       [&](std::size_t i) { result[i] = target.project(queries[i]); });
        return result;
    }

    std::vector<double> relative(std::span<const Foot> feet, double Foot::*distance) const {
        std::vector<double> values;
        values.reserve(feet.size());
        for (const Foot& foot : feet) values.push_back(foot.*distance / diagonal);
        return values;
    }

    double mean_to_mesh(std::span<const Vec3d> queries) const {
        std::vector<double> distances(queries.size());
        for_each_index(queries.size(), options.threads, [&](std::size_t i) {
            distances[i] = distance_to_mesh(queries[i]) / diagonal;
        });
        return mean_of(distances);
    }

    /// A random place of a disk around a sample in its tangent plane.
    static Vec3d place_beside(const MlsSurface& surface, const Vec3d& sample,
                              std::mt19937_64& random) {
        std::uniform_real_distribution<double> unit(0.0, 1.0);
        const Vec3d n = surface.plane_at(sample).n;
        const Vec3d u = n.unitOrthogonal(), v = n.cross(u);
        const double r = 0.6 * mean_spacing(surface.tree(), sample) * std::sqrt(unit(random));
        const double angle = 2.0 * std::numbers::pi * unit(random);
        return sample + r * (std::cos(angle) * u + std::sin(angle) * v);
    }

    /// The largest of some distances, each no larger than that of a place beside (up to h / 5) and
    /// the way there.
    double max_borne_out(const MlsSurface& target, std::span<const Vec3d> queries,
                         std::span<const double> distances) const {
        std::vector<std::size_t> order(queries.size());
        std::iota(order.begin(), order.end(), std::size_t{0});
        std::ranges::sort(order, std::greater(), [&](std::size_t i) { return distances[i]; });
        double max = 0;
        constexpr std::size_t kMost = 1000;
        for (std::size_t i = 0; i < std::min(kMost, order.size()); ++i) {
            double least = distances[order[i]];
            if (least <= max) break;
            const Vec3d& q = queries[order[i]];
            const double h = target.plane_at(q).h;
            for (const double part : {0.05, 0.1, 0.2})
                for (int way = 0; way < 27; ++way) {
                    if (way == 13) continue;  // the place itself
                    const Vec3d beside(way % 3 - 1, way / 3 % 3 - 1, way / 9 - 1);
                    const double there =
                        target.project(q + part * h * beside.normalized()).distance;
                    least = std::min(least, (there + part * h) / diagonal);
                }
            max = std::max(max, least);
        }
        return max;
    }

    /// Points of S' around every sample: random places of a disk in its tangent plane, projected.
    /// Where the projection finds no fixed point there is none of S'.
    std::vector<Foot> dense_samples(const MlsSurface& simplified) const {
        const auto& samples = simplified.points();
        const std::size_t each = std::max<std::size_t>(1, options.samples / samples.size());
        std::vector<Foot> feet(each * samples.size());
        for_each_index(samples.size(), options.threads, [&](std::size_t i) {
            std::mt19937_64 random(options.seed + i);
            for (std::size_t j = 0; j < each; ++j)
                feet[i * each + j] =
                    simplified.project(place_beside(simplified, samples[i], random));
        });
        std::erase_if(feet, [](const Foot& foot) { return !foot.converged; });
        if (feet.empty())
            for (const Vec3d& p : samples) feet.push_back({.point = p});
        return feet;
    }

    static double mean_spacing(const PointTree& tree, const Vec3d& sample) {
        const Neighborhood around = tree.nearest(sample, kDensityNeighbors + 1);
        double sum = 0;
        for (unsigned j = 1; j < around.size; ++j) sum += std::sqrt(around.distances_sq[j]);
        return around.size > 1 ? sum / (around.size - 1) : 0;
    }

    static void measure_spacing(const PointTree& tree, SurfaceDistance& result) {
        std::vector<double> spacing;
        for (const Vec3d& p : tree.points()) spacing.push_back(tree.nearest(p, 2).radius());
        const double mean = mean_of(spacing);
        if (mean <= 0) return;
        double variance = 0;
        for (const double s : spacing) variance += (s - mean) * (s - mean);
        result.spacing_variation = std::sqrt(variance / static_cast<double>(spacing.size())) / mean;
        result.least_spacing = *std::ranges::min_element(spacing) / mean;
    }
};

SurfaceMeter::SurfaceMeter(const PointCloud& original, const TriangleMesh& mesh,
                           const SurfaceDistanceOptions& options) {
    if (original.empty()) throw std::invalid_argument("no original to measure against");
    if (options.neighbors < 3 || options.neighbors > kMaxNeighbors || options.samples == 0)
        throw std::invalid_argument("neighbors: expected 3..64; samples: expected 1 or more");
    original_ = std::make_unique<const Original>(original, mesh, options);
}

SurfaceMeter::~SurfaceMeter() = default;

SurfaceDistance SurfaceMeter::measure(const PointCloud& simplified) const {
    if (simplified.empty()) throw std::invalid_argument("nothing to measure: 0 points");
    const Original& original = *original_;
    const MlsSurface surface(absolute_positions(simplified), original.options.neighbors);
    SurfaceDistance result;

    const auto from_points = original.feet(surface, original.points);
    const auto point_distances = original.relative(from_points, &Foot::distance);
    result.mean_points = weighted_mean(point_distances, original.point_weights);

    const bool with_mesh = !original.mesh_points.empty();
    const auto from_mesh = original.feet(surface, original.mesh_points);
    const auto& feet = with_mesh ? from_mesh : from_points;
    const auto weights = with_mesh ? std::vector<double>(feet.size(), 1.0) : original.point_weights;
    const auto distances = original.relative(feet, &Foot::distance);
    result.mean = weighted_mean(distances, weights);
    result.p99 = weighted_quantile(distances, weights, 0.99);
    result.mean_quadratic =
        weighted_mean(original.relative(feet, &Foot::distance_quadratic), weights);

    const std::vector<Foot> places = original.dense_samples(surface);
    std::vector<Vec3d> dense;
    for (const Foot& foot : places) dense.push_back(foot.point);
    const auto back = original.relative(original.feet(original.surface, dense), &Foot::distance);
    result.back_max = max_of(back);
    result.back_mean = mean_of(
        original.relative(original.feet(original.surface, surface.points()), &Foot::distance));
    result.max = std::max({max_of(point_distances), max_of(distances), result.back_max});
    std::vector<Vec3d> even;
    std::vector<double> even_distances;
    constexpr double kRound = 0.5;
    for (std::size_t i = 0; i < places.size(); ++i) {
        if (places[i].roundness > kRound) continue;
        even.push_back(dense[i]);
        even_distances.push_back(back[i]);
    }
    result.max_certain =
        std::max({original.max_borne_out(surface, original.points, point_distances),
                  original.max_borne_out(surface, original.mesh_points,
                                         original.relative(from_mesh, &Foot::distance)),
                  original.max_borne_out(original.surface, even, even_distances)});

    if (original.distance_to_mesh) {
        result.surface_to_mesh = original.mean_to_mesh(dense);
        result.points_to_mesh = original.mean_to_mesh(surface.points());
    }
    Original::measure_spacing(surface.tree(), result);
    const auto failed = [](const Foot& foot) { return !foot.converged; };
    result.not_converged = static_cast<std::size_t>(std::ranges::count_if(from_points, failed) +
                                                    std::ranges::count_if(from_mesh, failed));
    return result;
}

PlaceDistances SurfaceMeter::measure_places(const PointCloud& simplified, bool on_surface) const {
    const Original& original = *original_;
    const MlsSurface surface(absolute_positions(simplified), original.options.neighbors);
    PlaceDistances measured{original.points, original.point_weights, {}};
    if (on_surface) {
        std::vector<Vec3d> beside(original.points.size());
        for_each_index(beside.size(), original.options.threads, [&](std::size_t i) {
            std::mt19937_64 random(original.options.seed + i);
            beside[i] = Original::place_beside(original.surface, original.points[i], random);
        });
        const auto feet = original.feet(original.surface, beside);
        for (std::size_t i = 0; i < feet.size(); ++i)
            if (feet[i].converged) measured.places[i] = feet[i].point;
    }
    if (original.options.starts > 0) {
        measured.distances.resize(measured.places.size());
        for_each_index(measured.places.size(), original.options.threads, [&](std::size_t i) {
            std::mt19937_64 random(original.options.seed + i);
            measured.distances[i] =
                surface.nearest_place(measured.places[i], original.options.starts, random);
        });
        return measured;
    }
    for (const Foot& foot : original.feet(surface, measured.places))
        measured.distances.push_back(foot.distance);
    return measured;
}

SurfaceDistance measure(const PointCloud& original, const PointCloud& simplified,
                        unsigned threads) {
    return SurfaceMeter(original, {}, {.threads = threads}).measure(simplified);
}

}  // namespace stipple::bench
