#include "models.hpp"
#include "stipple/hierarchical_clustering.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/surface_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <limits>
#include <ostream>
#include <vector>

// The measure of §4, which knows points only, against the triangles that scans came with.

namespace stipple {
namespace {

using bench::TriangleMesh;

double distance_to_segment(const Vec3d& q, const Vec3d& a, const Vec3d& b) {
    const Vec3d d = b - a;
    const double length_sq = d.squaredNorm();
    const double t = length_sq > 0 ? std::clamp((q - a).dot(d) / length_sq, 0.0, 1.0) : 0.0;
    return (q - a - t * d).norm();
}

double distance_to_triangle(const Vec3d& q, const std::array<Vec3d, 3>& t) {
    const Vec3d n = (t[1] - t[0]).cross(t[2] - t[0]);
    bool inside = n.squaredNorm() > 0;
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < 3; ++i) {
        const Vec3d &a = t[i], &b = t[(i + 1) % 3];
        inside = inside && n.cross(b - a).dot(q - a) >= 0;
        nearest = std::min(nearest, distance_to_segment(q, a, b));
    }
    return inside ? std::abs(n.normalized().dot(q - t[0])) : nearest;
}

/// Distances to a mesh whose triangles are about as large as they are far apart: to those at the
/// vertices that are nearest.
class NearbyTriangles {
public:
    explicit NearbyTriangles(const TriangleMesh& mesh)
        : mesh_(mesh), at_(mesh.vertices.size()), search_(vertices(mesh)) {
        for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
            for (const Index v : mesh.triangles[t]) at_[v].push_back(t);
    }

    double distance(const Vec3d& q) const {
        std::array<Neighbor, 24> room;
        double nearest = std::numeric_limits<double>::infinity();
        for (const Neighbor& vertex : search_.nearest(q.cast<float>(), room)) {
            for (const std::size_t t : at_[vertex.index]) {
                const auto& [a, b, c] = mesh_.triangles[t];
                nearest = std::min(
                    nearest, distance_to_triangle(
                                 q, {mesh_.vertices[a], mesh_.vertices[b], mesh_.vertices[c]}));
            }
        }
        return nearest;
    }

private:
    static std::vector<Vec3f> vertices(const TriangleMesh& mesh) {
        std::vector<Vec3f> points;
        for (const Vec3d& v : mesh.vertices) points.push_back(v.cast<float>());
        return points;
    }

    const TriangleMesh& mesh_;
    std::vector<std::vector<std::size_t>> at_;
    NeighborSearch search_;
};

struct Scan {
    const char* name;
    const char* file;
};
void PrintTo(const Scan& scan, std::ostream* out) {
    *out << scan.name;
}

class TrueMesh : public testing::TestWithParam<Scan> {};

/// From samples of a coarse surface to the dense one: to its MLS surface, and to its triangles.
TEST_P(TrueMesh, IsAsFarAsTheSurfaceOfItsPoints) {
    const auto file = test::shared_file(GetParam().file);
    if (!file) GTEST_SKIP() << "the shared test data is not here";
    const TriangleMesh mesh = bench::read_triangles(*file);
    ASSERT_FALSE(mesh.triangles.empty());
    PointCloud scan;
    for (const Vec3d& v : mesh.vertices) scan.positions.push_back(v.cast<float>());
    const PointCloud coarse = hierarchical_clustering(scan, {.target_size = scan.size() / 20});

    const NearbyTriangles triangles(mesh);
    for (const ErrorSurface surface : {ErrorSurface::Linear, ErrorSurface::Quadratic}) {
        const SurfaceError error = measure_error(scan, coarse,
                                                 {.sampling = ErrorSampling::Surface,
                                                  .samples = 3000,
                                                  .surface = surface,
                                                  .keep_samples = true});
        double mean = 0;
        for (const Vec3f& q : error.backward.positions)
            mean += triangles.distance(q.cast<double>()) /
                    static_cast<double>(error.backward.positions.size());
        EXPECT_NEAR(error.backward.mean / mean, 1, 0.1);
    }
}

INSTANTIATE_TEST_SUITE_P(Scans, TrueMesh,
                         testing::Values(Scan{"igea", "models/igea.ply"},
                                         Scan{"bunny", "models/bun_zipper.ply"},
                                         Scan{"armadillo", "models/armadillo_43k.ply"},
                                         Scan{"dragon", "models/dragon_vrip_res2.ply"}),
                         [](const auto& scan) { return std::string(scan.param.name); });

}  // namespace
}  // namespace stipple
