#include "boxed_cloud.hpp"

#include "stipple/error.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <span>

namespace stipple {

namespace {

/// Without a branch for each number, so that many are looked at at once.
bool are_finite(std::span<const Vec3f> points) noexcept {
    constexpr std::uint32_t kExponent = 0x7f80'0000U;
    std::uint32_t bad = 0;
    for (const Vec3f& p : points)
        for (const float x : {p.x(), p.y(), p.z()})
            bad |= static_cast<std::uint32_t>((std::bit_cast<std::uint32_t>(x) & kExponent) ==
                                              kExponent);
    return bad == 0;
}

}  // namespace

void check_positions(const PointCloud& cloud, const std::string& which) {
    const auto refuse = [](const std::string& what) {
        throw Error(ErrorCode::InvalidArgument, what);
    };
    validate(cloud);
    if (cloud.empty()) refuse(which + " 0 points: expected at least 1");
    if (are_finite(cloud.positions) && cloud.origin.allFinite()) return;
    const auto finite = [](const Vec3f& p) { return p.allFinite(); };
    const auto bad = std::ranges::find_if_not(cloud.positions, finite);
    refuse(which + " point " + std::to_string(bad - cloud.positions.begin()) +
           ": expected finite coordinates");
}

BoxedCloud::BoxedCloud(const PointCloud& cloud_, const std::string& which) : cloud(cloud_) {
    check_positions(cloud, which);
    box = bounds(cloud);
}

}  // namespace stipple
