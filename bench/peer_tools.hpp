#pragma once

#include "peers.hpp"

// What each tool's source brings; peers.cpp calls those that were compiled.
namespace stipple::bench {

namespace cgal {
std::vector<Peer> simplifiers(const Model& model, std::size_t target);
std::vector<Peer> analyzers(const Model& model, unsigned k);
std::vector<Peer> orienters(const Model& model, const std::vector<Vec3f>& normals, unsigned k);
std::vector<Peer> readers(const std::filesystem::path& file);
std::function<double(const Vec3d&)> distance_to(const TriangleMesh& mesh);
}  // namespace cgal

namespace pcl_peer {
std::vector<Peer> simplifiers(const Model& model, std::size_t target);
std::vector<Peer> analyzers(const Model& model, unsigned k);
}  // namespace pcl_peer

namespace open3d_peer {
std::vector<Peer> simplifiers(const Model& model, std::size_t target);
std::vector<Peer> analyzers(const Model& model, unsigned k);
}  // namespace open3d_peer

namespace meshopt_peer {
std::vector<Peer> simplifiers(const Model& model, std::size_t target);
}  // namespace meshopt_peer

}  // namespace stipple::bench
