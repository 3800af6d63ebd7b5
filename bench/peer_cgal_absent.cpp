// Stands in for peer_cgal.cpp where CGAL was not found.

#include "peers.hpp"

#include <stdexcept>

namespace stipple::bench {

namespace {
[[noreturn]] void refuse() {
    throw std::logic_error("stipple-bench was built without CGAL");
}
}  // namespace

bool have_cgal() noexcept {
    return false;
}
std::any cgal_points(const PointCloud&) {
    refuse();
}
std::size_t cgal_hierarchy(std::any&, unsigned) {
    refuse();
}
std::size_t cgal_random(std::any&, std::size_t) {
    refuse();
}
PointCloud from_cgal(const std::any&, std::size_t) {
    refuse();
}
std::any cgal_read_ply(const std::filesystem::path&) {
    refuse();
}
std::function<double(const Vec3d&)> cgal_distance_to(const TriangleMesh&) {
    return {};
}

}  // namespace stipple::bench
