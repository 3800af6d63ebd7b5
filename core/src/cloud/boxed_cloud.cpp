#include "cloud/boxed_cloud.hpp"

#include "base/refuse.hpp"
#include "cloud/point_bounds.hpp"

#include <algorithm>
#include <optional>

namespace stipple {

void check_positions(const PointCloud& cloud, const std::string& which) {
    validate(cloud);
    if (cloud.empty()) refuse(which, " 0 points: expected at least 1");
    const auto finite = [](const Vec3f& p) { return p.allFinite(); };
    const auto bad = std::ranges::find_if_not(cloud.positions, finite);
    if (bad != cloud.positions.end() || !cloud.origin.allFinite())
        refuse(which, " point ", bad - cloud.positions.begin(), ": expected finite coordinates");
}

BoxedCloud::BoxedCloud(const PointCloud& cloud_, const std::string& which) : cloud(cloud_) {
    const std::optional<Aabb> found = finite_bounds(cloud);
    if (!found || found->empty()) check_positions(cloud, which);  // which says what is wrong
    validate(cloud);
    box = *found;
}

}  // namespace stipple
