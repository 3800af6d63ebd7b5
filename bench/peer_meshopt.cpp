// meshoptimizer: points by themselves, and the triangles that the point methods do not see.

#include "peer_tools.hpp"

#include <meshoptimizer.h>
#include <algorithm>
#include <array>
#include <memory>
#include <utility>

namespace stipple::bench::meshopt_peer {

namespace {

using Indices = std::vector<Index>;

struct Mesh {
    std::vector<Vec3f> vertices;
    Indices corners;
};

using Triangle = std::array<Index, 3>;

bool runs_along(const Triangle& t, Index from, Index to) {
    for (unsigned i = 0; i < 3; ++i)
        if (t[i] == from && t[(i + 1) % 3] == to) return true;
    return false;
}

/// Turns triangles so that those across an edge agree. Scans are passed on with faces turned at
/// random, and the simplifier takes every edge of such a mesh for a seam.
void agree_on_sides(std::vector<Triangle>& triangles) {
    struct Edge {
        Index low, high, triangle;
        auto operator<=>(const Edge&) const = default;
    };
    std::vector<Edge> edges;
    for (Index t = 0; t < triangles.size(); ++t)
        for (unsigned i = 0; i < 3; ++i) {
            const auto [low, high] = std::minmax({triangles[t][i], triangles[t][(i + 1) % 3]});
            edges.push_back({low, high, t});
        }
    std::ranges::sort(edges);
    std::vector<char> settled(triangles.size(), 0);
    for (Index first = 0; first < triangles.size(); ++first) {
        if (std::exchange(settled[first], 1)) continue;
        for (std::vector<Index> front = {first}; !front.empty();) {
            const Triangle here = triangles[front.back()];
            front.pop_back();
            for (unsigned i = 0; i < 3; ++i) {
                const Index from = here[i], to = here[(i + 1) % 3];
                const auto [low, high] = std::minmax({from, to});
                for (auto edge = std::ranges::lower_bound(edges, Edge{low, high, 0});
                     edge != edges.end() && edge->low == low && edge->high == high; ++edge) {
                    if (settled[edge->triangle]) continue;
                    settled[edge->triangle] = 1;
                    Triangle& other = triangles[edge->triangle];
                    if (runs_along(other, from, to)) std::swap(other[0], other[1]);
                    front.push_back(edge->triangle);
                }
            }
        }
    }
}

Mesh mesh_of(TriangleMesh triangles) {
    agree_on_sides(triangles.triangles);
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
