#include "neighbors/tree_search.hpp"

#include "cloud/float4.hpp"
#include "neighbors/nearest_kernels.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <numbers>

// Follows: Roussopoulos, Kelley and Vincent 1995 (branch and bound over boxes, the nearest first)
// where the quicker way fails: to guess a radius, gather what lies within and check that it is
// enough.

namespace stipple {

namespace {

using Eight = std::array<Float4, 2>;

/// Squared distances of eight points to q.
Eight distances_sq(const PointTree::Leaf& leaf, const Vec3f& q) noexcept {
    Eight d;
    for (std::size_t half = 0; half < 2; ++half) {
        const Float4 dx = load(&leaf.x[4 * half]) - q.x();
        const Float4 dy = load(&leaf.y[4 * half]) - q.y();
        const Float4 dz = load(&leaf.z[4 * half]) - q.z();
        d[half] = dx * dx + dy * dy + dz * dz;
    }
    return d;
}

/// Squared distances of eight boxes to q, 0 inside. Never above that of a point in the box: each
/// difference is no larger, and rounding keeps order.
Eight distances_sq(const PointTree::Node& node, const Vec3f& q) noexcept {
    Eight d;
    for (std::size_t half = 0; half < 2; ++half) {
        std::array<Float4, 3> gap;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const float at = q[static_cast<Eigen::Index>(axis)];
            const Float4 below = load(&node.low[axis][4 * half]) - at;
            const Float4 above = at - load(&node.high[axis][4 * half]);
            const Float4 outside = below > above ? below : above;
            gap[axis] = outside > 0.0F ? outside : Float4{};
        }
        d[half] = gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2];
    }
    return d;
}

unsigned lanes_within(const Eight& d, float limit_sq) noexcept {
    return lane_bits(d[0] <= limit_sq) | lane_bits(d[1] <= limit_sq) << 4U;
}

/// A node or leaf still to be looked into.
struct Branch {
    float distance_sq;
    std::uint32_t number;
    std::uint32_t level;  ///< 0: a leaf; else of the node, plus one
};

/// Depth first, the nearest child first. Calls visit(leaf) for every leaf whose box is
/// at most `limit()` away, which may shrink on the way.
template <typename Limit, typename Visit>
void search(const PointTree& tree, const Vec3f& q, Limit&& limit, Visit&& visit) {
    if (tree.size() == 0) return;
    constexpr std::size_t kDepth = 12;  // 8^12 is above the number of points there can be
    std::array<Branch, PointTree::kWidth * kDepth> stack;
    std::size_t height = 0;
    stack[height++] = {0.0F, 0, static_cast<std::uint32_t>(tree.level_count())};
    while (height > 0) {
        const Branch branch = stack[--height];
        if (branch.distance_sq > limit()) continue;
        if (branch.level == 0) {
            visit(tree.leaf(branch.number));
            continue;
        }
        const Eight d = distances_sq(tree.node(branch.level - 1, branch.number), q);
        const std::size_t first = height;
        for (unsigned lanes = lanes_within(d, limit()); lanes != 0; lanes &= lanes - 1) {
            const auto lane = static_cast<unsigned>(std::countr_zero(lanes));
            const Branch child = {d[lane / 4][lane % 4],
                                  branch.number * std::uint32_t{PointTree::kWidth} + lane,
                                  branch.level - 1};
            if (child.number >= tree.child_count(child.level)) break;
            std::size_t at = height++;
            for (; at > first && stack[at - 1].distance_sq < child.distance_sq; --at)
                stack[at] = stack[at - 1];
            stack[at] = child;
        }
    }
}

/// The search that always succeeds, into room for as many as there are or fewer.
void search_one_by_one(const PointTree& tree, const Vec3f& q, std::span<Neighbor> found) noexcept {
    std::size_t count = 0;  // then the farthest stands in front: a heap
    const auto limit = [&] {
        return count < found.size() ? std::numeric_limits<float>::infinity()
                                    : found.front().distance_sq;
    };
    search(tree, q, limit, [&](const PointTree::Leaf& leaf) {
        const Eight d = distances_sq(leaf, q);
        for (unsigned lanes = lanes_within(d, limit()); lanes != 0; lanes &= lanes - 1) {
            const auto lane = static_cast<std::size_t>(std::countr_zero(lanes));
            const Neighbor neighbor = {d[lane / 4][lane % 4], leaf.index[lane]};
            if (neighbor.index == PointTree::kNone) continue;
            if (count == found.size()) {
                if (neighbor > found.front()) continue;
                std::ranges::pop_heap(found);
                found.back() = neighbor;
            } else {
                found[count++] = neighbor;
            }
            std::ranges::push_heap(found.first(count));
        }
    });
    std::ranges::sort_heap(found);
}

/// False where that is not the quickest way, or there are points infinitely far away.
bool search_few(const PointTree& tree, const Vec3f& q, std::span<Neighbor> found) noexcept {
    constexpr std::size_t kFew = 64, kBefore = 1, kBehind = 3;
    if (found.size() > kFew) return false;
    std::array<std::int64_t, kBefore + kFew + kBehind> room;
    std::int64_t* const keys = room.data() + kBefore;
    if (!nearest_kernels().nearest(tree.view(), q.data(), static_cast<std::uint32_t>(found.size()),
                                   keys))
        return false;
    for (std::size_t i = 0; i < found.size(); ++i) {
        const auto key = static_cast<std::uint64_t>(keys[i]);
        found[i] = {std::bit_cast<float>(static_cast<std::uint32_t>(key >> 32U)),
                    static_cast<Index>(key)};
    }
    return true;
}

}  // namespace

float guess_radius_sq(const PointTree::Node& node, unsigned k) noexcept {
    float diagonal_sq = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const float low = *std::ranges::min_element(node.low[axis]);
        const float high = *std::ranges::max_element(node.high[axis]);
        diagonal_sq += (high - low) * (high - low);
    }
    constexpr float kPerNeighbor = 1.0F / (2 * 64 * std::numbers::pi_v<float>);
    return kPerNeighbor * static_cast<float>(k) * diagonal_sq;
}

std::span<Neighbor> find_nearest(const PointTree& tree, const Vec3f& q,
                                 std::span<Neighbor> room) noexcept {
    const std::span<Neighbor> found = room.first(std::min(room.size(), tree.size()));
    if (found.empty()) return found;
    if (!search_few(tree, q, found)) search_one_by_one(tree, q, found);
    return found;
}

bool any_within(const PointTree& tree, const Vec3f& q, float radius_sq) noexcept {
    bool any = false;
    search(
        tree, q, [&] { return any ? -1.0F : radius_sq; },
        [&](const PointTree::Leaf& leaf) {
            any = lanes_within(distances_sq(leaf, q), radius_sq) != 0;
        });
    return any;
}

bool find_few_within(const PointTree& tree, const Vec3f& q, float radius_sq,
                     std::vector<Neighbor>& found) {
    constexpr std::uint32_t kFew = 512;
    if (tree.size() == 0 || !(radius_sq < std::numeric_limits<float>::infinity())) return false;
    std::array<float, kFew + PointTree::kWidth> distances_sq;
    std::array<Index, kFew + PointTree::kWidth> indices;
    const std::uint32_t count = nearest_kernels().within(tree.view(), q.data(), radius_sq, kFew,
                                                         distances_sq.data(), indices.data());
    if (count > kFew) return false;
    const std::size_t before = found.size();
    found.resize(before + count);
    for (std::size_t i = 0; i < count; ++i) found[before + i] = {distances_sq[i], indices[i]};
    return true;
}

void find_within(const PointTree& tree, const Vec3f& q, float radius_sq,
                 std::vector<Neighbor>& found) {
    if (find_few_within(tree, q, radius_sq, found)) return;
    search(
        tree, q, [radius_sq] { return radius_sq; },
        [&](const PointTree::Leaf& leaf) {
            const Eight d = distances_sq(leaf, q);
            for (unsigned lanes = lanes_within(d, radius_sq); lanes != 0; lanes &= lanes - 1) {
                const auto lane = static_cast<std::size_t>(std::countr_zero(lanes));
                if (leaf.index[lane] != PointTree::kNone)
                    found.push_back({d[lane / 4][lane % 4], leaf.index[lane]});
            }
        });
}

}  // namespace stipple
