#include "lone_points.hpp"

#include "gaps.hpp"
#include "tree_search.hpp"

#include <algorithm>
#include <array>

namespace stipple {

namespace {

constexpr std::size_t kThird = 3, kAround = 8;

}  // namespace

bool lies_alone(std::span<const Neighbor> nearest, std::span<const Vec3f> points) noexcept {
    constexpr float kMuchNearer = 4;
    if (nearest.size() <= kThird) return false;
    const Neighbor& third = nearest[kThird];
    const auto is_beside = [&](const Neighbor& other) {
        const float distance_sq = (points[other.index] - points[third.index]).squaredNorm();
        return kMuchNearer * kMuchNearer * distance_sq < third.distance_sq;
    };
    return std::ranges::count_if(nearest, is_beside) > std::ptrdiff_t{kThird};  // it is one of them
}

LonePoints::LonePoints(std::span<const Vec3f> points, const PointTree& tree)
    : points_(points), tree_(tree) {
    constexpr double kFar = 8;
    usual_ = static_cast<float>(kFar * median_gap(tree));
}

bool LonePoints::holds(const Vec3f& place, float reach) const {
    if (reach <= usual_) return false;
    std::array<Neighbor, kAround + 1> room;
    return lies_alone(find_nearest(tree_, place, room), points_);
}

}  // namespace stipple
