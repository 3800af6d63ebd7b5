// Open3D's C++ library: double-precision points, OpenMP inside.

#include "peer_tools.hpp"

#include <omp.h>
#include <open3d/geometry/KDTreeSearchParam.h>
#include <open3d/geometry/PointCloud.h>
#include <open3d/geometry/TriangleMesh.h>
#include <cmath>
#include <memory>

namespace stipple::bench::open3d_peer {

namespace {

using Cloud = open3d::geometry::PointCloud;
using CloudPointer = std::shared_ptr<Cloud>;
using Simplify = std::function<CloudPointer(const Cloud& cloud)>;

Cloud from_stipple(const PointCloud& cloud) {
    Cloud points;
    points.points_.reserve(cloud.size());
    for (const Vec3f& p : cloud.positions) points.points_.push_back(p.cast<double>());
    return points;
}

PointCloud to_stipple(const Cloud& points) {
    PointCloud cloud;
    for (const Vec3d& p : points.points_) cloud.positions.push_back(p.cast<float>());
    return cloud;
}

Peer simplifier(
    std::string name, const Model& model, Simplify simplify,
    std::function<void(const Cloud&)> tune = [](const Cloud&) {}) {
    return {.name = std::move(name),
            .load = [&model, tune = std::move(tune)]() -> std::any {
                Cloud cloud = from_stipple(model.cloud);
                tune(cloud);
                return cloud;
            },
            .run = [simplify = std::move(simplify)](std::any& cloud, unsigned) -> std::any {
                return simplify(std::any_cast<Cloud&>(cloud));
            },
            .points =
                [](const std::any&, const std::any& result) {
                    return to_stipple(*std::any_cast<const CloudPointer&>(result));
                }};
}

Peer voxel(const Model& model, std::size_t target) {
    const double guess = bounds(model.cloud).diagonal() / std::sqrt(static_cast<double>(target));
    const auto size = std::make_shared<double>(0);
    return simplifier(
        "Open3D VoxelDownSample", model,
        [=](const Cloud& cloud) { return cloud.VoxelDownSample(*size); },
        [=](const Cloud& cloud) {
            if (*size != 0) return;
            *size =
                tuned([&](double value) { return cloud.VoxelDownSample(value)->points_.size(); },
                      target, guess);
        });
}

/// Sample elimination (Yuksel 2015) of five times as many random points of the true mesh, which is
/// more than the others know; of a cloud's own points it takes minutes.
Peer poisson(const Model& model, std::size_t target) {
    const auto mesh = std::make_shared<open3d::geometry::TriangleMesh>();
    mesh->vertices_ = model.mesh.vertices;
    for (const auto& [a, b, c] : model.mesh.triangles)
        mesh->triangles_.emplace_back(static_cast<int>(a), static_cast<int>(b),
                                      static_cast<int>(c));
    return simplifier("Open3D SamplePointsPoissonDisk, on the mesh", model,
                      [=](const Cloud&) { return mesh->SamplePointsPoissonDisk(target); });
}

}  // namespace

std::vector<Peer> simplifiers(const Model& model, std::size_t target) {
    std::vector<Peer> all = {
        voxel(model, target),
        simplifier("Open3D FarthestPointDownSample", model,
                   [=](const Cloud& cloud) { return cloud.FarthestPointDownSample(target); })};
    if (!model.mesh.empty()) all.push_back(poisson(model, target));
    return all;
}

std::vector<Peer> analyzers(const Model& model, unsigned k) {
    return {{.name = "Open3D EstimateNormals",
             .load = [&model]() -> std::any { return from_stipple(model.cloud); },
             .run = [k](std::any& cloud, unsigned threads) -> std::any {
                 omp_set_num_threads(static_cast<int>(threads));
                 std::any_cast<Cloud&>(cloud).EstimateNormals(
                     open3d::geometry::KDTreeSearchParamKNN(static_cast<int>(k)));
                 return {};
             }}};
}

}  // namespace stipple::bench::open3d_peer
