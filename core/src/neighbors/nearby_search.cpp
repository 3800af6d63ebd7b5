#include "neighbors/nearby_search.hpp"

#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace stipple {

namespace {

constexpr double kExact = 0.99999;  // a radius less the rounding of squared distances
constexpr double kFilled = 0.75;    // of the room by the next answer, if all goes well

}  // namespace

NearbySearch::NearbySearch(const PointTree& tree, std::size_t least, std::size_t most)
    : tree_(tree),
      least_(std::min(least, tree.size())),
      most_(std::min(most, tree.size())),
      room_(most_) {}

std::span<Neighbor> NearbySearch::find_near(const Vec3f& q) {
    within_.clear();
    if (!(radius_ > 0)) return {};
    if (!find_few_within(tree_, q, static_cast<float>(radius_ * radius_), within_))
        return find_so_many(q, least_);  // it got crowded
    if (within_.size() < least_) return {};
    reach_ = radius_ * kExact;
    // On a surface the number of points grows as the square of the radius.
    radius_ *=
        std::sqrt(kFilled * static_cast<double>(most_) / static_cast<double>(within_.size()));
    const std::span<Neighbor> found = within_;
    if (found.size() == tree_.size()) reach_ = std::numeric_limits<double>::infinity();
    if (found.size() <= most_) return found;
    const auto last = found.begin() + static_cast<std::ptrdiff_t>(most_ - 1);
    std::nth_element(found.begin(), last, found.end());
    reach_ = std::sqrt(static_cast<double>(last->distance_sq)) * kExact;
    return found.first(most_);
}

std::span<Neighbor> NearbySearch::find_nearest_few(const Vec3f& q) {
    const std::span<Neighbor> found = find(q);
    const auto last = found.begin() + static_cast<std::ptrdiff_t>(least_ - 1);
    std::nth_element(found.begin(), last, found.end());
    return found.first(least_);
}

std::span<Neighbor> NearbySearch::find_wider(const Vec3f& q) {
    constexpr unsigned kTries = 3;
    constexpr double kAtMost = 2;
    const double before = radius_;
    for (unsigned i = 0; i < kTries; ++i) {
        const std::span<Neighbor> found = find_near(q);
        if (!found.empty() || within_.empty()) return found;
        radius_ *= std::min(kAtMost, std::sqrt(kFilled * static_cast<double>(most_) /
                                               static_cast<double>(within_.size())));
    }
    radius_ = before;
    return {};
}

std::span<Neighbor> NearbySearch::find(const Vec3f& q) {
    if (const std::span<Neighbor> found = find_wider(q); !found.empty()) return found;
    return find_so_many(q, most_);
}

std::span<Neighbor> NearbySearch::find_so_many(const Vec3f& q, std::size_t count) {
    const std::span<Neighbor> found = find_nearest(tree_, q, std::span(room_).first(count));
    const double farthest = std::sqrt(static_cast<double>(found.back().distance_sq));
    reach_ =
        found.size() == tree_.size() ? std::numeric_limits<double>::infinity() : farthest * kExact;
    // From afar the radius says nothing of the spacing.
    if (4.0F * found.front().distance_sq <= found.back().distance_sq)
        radius_ = std::sqrt(kFilled) * farthest;
    return found;
}

}  // namespace stipple
