#include "neighbors/leaf_query.hpp"

#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <array>
#include <limits>

namespace stipple {

namespace {

constexpr std::uint32_t kWidth = PointTree::kWidth;

/// Leaves that a point may have to choose from; where there are more, each point is searched for
/// by itself.
std::uint32_t capacity_for(unsigned k) {
    return 96 + 4 * (k / kWidth);
}

std::size_t floats_for(std::uint32_t capacity) {
    return std::size_t{kWidth} * capacity + 3 * kWidth;  // kernels may write so far behind the last
}

}  // namespace

LeafQuery::LeafQuery(const PointTree& tree, std::span<const Vec3f> points, unsigned k)
    : tree_(tree),
      points_(points),
      k_(k),
      slack_(slack_for(k)),
      kernels_(nearest_kernels()),
      memory_(10 * floats_for(capacity_for(k)) * sizeof(float)),
      found_(std::size_t{k} + 1) {
    auto* const floats = static_cast<float*>(memory_.data());
    const std::size_t each = floats_for(capacity_for(k));
    const auto array = [&](std::size_t number) { return floats + number * each; };
    const auto index = [&](std::size_t number) { return reinterpret_cast<Index*>(array(number)); };
    candidates_ = {array(0), array(1), array(2), index(3), array(4), index(5), capacity_for(k)};
    chosen_ = {array(6), index(7), index(8), index(9)};
}

void LeafQuery::gather(std::size_t leaf, float limit_sq) {
    gathered_ = false;
    if (!(limit_sq > 0 && limit_sq <= std::numeric_limits<float>::max())) return;
    std::array<float, 3> low, high;
    const PointTree::Node& node = tree_.node(0, leaf / kWidth);
    for (std::size_t axis = 0; axis < 3; ++axis) {
        low[axis] = node.low[axis][leaf % kWidth];
        high[axis] = node.high[axis][leaf % kWidth];
    }
    gathered_ = kernels_.gather(tree_.view(), low.data(), high.data(), limit_sq, candidates_);
    if (!gathered_) return;
    const std::uint32_t* const end = candidates_.leaf + candidates_.leaves;
    const std::uint32_t* const home =
        std::find<const std::uint32_t*>(candidates_.leaf, end, static_cast<std::uint32_t>(leaf));
    home_ = kWidth * static_cast<std::uint32_t>(home - candidates_.leaf);
}

void LeafQuery::start(std::size_t leaf) {
    constexpr float kMargin = 1.25F;  // what a leaf may be sparser than the one before
    gather(leaf,
           kMargin * (largest_radius_sq_ > 0 ? largest_radius_sq_
                                             : guess_radius_sq(tree_.node(0, leaf / kWidth), k_)));
    largest_radius_sq_ = 0;
    tries_ = 0;
}

void LeafQuery::look_farther(std::size_t leaf) {
    constexpr unsigned kTries = 3;
    constexpr float kFarther = 2.0F;
    gather(leaf, ++tries_ < kTries ? kFarther * candidates_.limit_sq : 0.0F);
}

bool LeafQuery::ask(std::size_t leaf, std::uint32_t lane) {
    if (gathered_) {
        const Vec3f q = tree_.leaf(leaf).position(lane);
        kernels_.choose(candidates_, q.data(), home_ + lane, k_, slack_, guess_sq_, chosen_);
        if (chosen_.count == 0) return false;
        kernels_.rank(candidates_, chosen_);
    } else {
        search(leaf, lane);
    }
    guess_sq_ = chosen_.radius_sq;
    largest_radius_sq_ = std::max(largest_radius_sq_, chosen_.radius_sq);
    return true;
}

void LeafQuery::search(std::size_t leaf, std::uint32_t lane) {
    const Index own = tree_.leaf(leaf).index[lane];
    const std::span<Neighbor> all = find_nearest(tree_, tree_.leaf(leaf).position(lane), found_);
    // Among many equal points its own number may not be found; then the last is one too many.
    const auto self = std::ranges::find(all, own, &Neighbor::index);
    std::shift_left(self, all.end(), 1);
    for (std::uint32_t i = 0; i < k_; ++i) {
        const Vec3f& p = points_[all[i].index];
        candidates_.x[i] = p.x();
        candidates_.y[i] = p.y();
        candidates_.z[i] = p.z();
        candidates_.index[i] = all[i].index;
        chosen_.distance_sq[i] = all[i].distance_sq;
        chosen_.slot[i] = chosen_.rank[i] = i;
    }
    chosen_.count = k_;
    chosen_.radius_sq = all[k_ - 1].distance_sq;
}

}  // namespace stipple
