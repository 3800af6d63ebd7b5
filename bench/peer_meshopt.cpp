// meshoptimizer: points by themselves, and the triangles that the point methods do not see.

#include "peer_tools.hpp"

#include <meshoptimizer.h>
#include <algorithm>
#include <memory>

namespace stipple::bench::meshopt_peer {

namespace {

using Indices = std::vector<Index>;

struct Mesh {
    std::vector<Vec3f> vertices;
    Indices corners;
};

Mesh mesh_of(const TriangleMesh& triangles) {
    Mesh mesh;
    for (const Vec3d& v : triangles.vertices) mesh.vertices.push_back(v.cast<float>());
    for (const auto& triangle : triangles.triangles)
        mesh.corners.insert(mesh.corners.end(), triangle.begin(), triangle.end());
    return mesh;
}

Indices simplify_points(const std::vector<Vec3f>& points, std::size_t target) {
    Indices kept(target);
    kept.resize(meshopt_simplifyPoints(kept.data(), points.front().data(), points.size(),
                                       sizeof(Vec3f), target));
    return kept;
}

Indices simplify_mesh(const Mesh& mesh, std::size_t corners) {
    Indices kept(mesh.corners.size());
    constexpr float kAnyError = 1e9F;
    kept.resize(meshopt_simplify(kept.data(), mesh.corners.data(), mesh.corners.size(),
                                 mesh.vertices.front().data(), mesh.vertices.size(), sizeof(Vec3f),
                                 corners, kAnyError, 0, nullptr));
    return kept;
}

/// The vertices that corners are at, each once.
Indices used(Indices corners) {
    std::ranges::sort(corners);
    corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
    return corners;
}

PointCloud cloud_of(const std::vector<Vec3f>& vertices, const Indices& indices) {
    PointCloud cloud;
    for (const Index i : indices) cloud.positions.push_back(vertices[i]);
    return cloud;
}

Peer mesh_peer(const Model& model, std::size_t target) {
    const auto vertices_a_triangle = std::make_shared<double>(0);
    const auto corners = [=] {
        return 3 * static_cast<std::size_t>(static_cast<double>(target) / *vertices_a_triangle);
    };
    return {.name = "meshoptimizer simplify, on the mesh",
            .load = [=, &model]() -> std::any {
                Mesh mesh = mesh_of(model.mesh);
                if (*vertices_a_triangle == 0)
                    *vertices_a_triangle = tuned(
                        [&](double inverse) {
                            *vertices_a_triangle = inverse;
                            return used(simplify_mesh(mesh, corners())).size();
                        },
                        target, 0.5);
                return mesh;
            },
            .run = [=](std::any& mesh, unsigned) -> std::any {
                return simplify_mesh(std::any_cast<const Mesh&>(mesh), corners());
            },
            .points =
                [](const std::any& mesh, const std::any& kept) {
                    return cloud_of(std::any_cast<const Mesh&>(mesh).vertices,
                                    used(std::any_cast<Indices>(kept)));
                }};
}

}  // namespace

std::vector<Peer> simplifiers(const Model& model, std::size_t target) {
    std::vector<Peer> all = {{.name = "meshoptimizer simplifyPoints",
                              .load = []() -> std::any { return {}; },
                              .run = [&model, target](std::any&, unsigned) -> std::any {
                                  return simplify_points(model.cloud.positions, target);
                              },
                              .points =
                                  [&model](const std::any&, const std::any& kept) {
                                      return cloud_of(model.cloud.positions,
                                                      std::any_cast<const Indices&>(kept));
                                  }}};
    if (!model.synthetic()) all.push_back(mesh_peer(model, target));
    return all;
}

}  // namespace stipple::bench::meshopt_peer
