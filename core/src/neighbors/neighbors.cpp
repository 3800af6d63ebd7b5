#include "stipple/neighbors.hpp"

#include "base/distance_statistics.hpp"
#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "neighbors/leaf_query.hpp"
#include "neighbors/nearest_lists.hpp"
#include "neighbors/point_tree.hpp"
#include "neighbors/tree_search.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>

namespace stipple {

namespace {

constexpr std::size_t kWidth = PointTree::kWidth;
constexpr std::size_t kLeavesPerBlock = 128;

/// Calls take(i, indices, distances_sq) with the first of the `each` nearest of every point, in
/// order of distance.
template <typename Take>
void for_each_nearest(std::span<const Vec3f> points, std::size_t each, const RunContext& context,
                      Take&& take) {
    const PointTree tree(points, PointTree::Leaves::Quick, context);
    parallel_for_blocks(
        tree.leaf_count(), kLeavesPerBlock, context, [&](std::size_t begin, std::size_t end) {
            LeafQuery query(tree, points, static_cast<unsigned>(each));
            std::vector<Index> indices(query.most_chosen());
            std::vector<float> distances_sq(query.most_chosen());
            for (std::size_t l = begin; l < end; ++l) {
                query.run(l, [&](std::size_t lane, const Candidates& near, const Chosen& chosen) {
                    for (std::uint32_t i = 0; i < chosen.count; ++i) {
                        indices[chosen.rank[i]] = near.index[chosen.slot[i]];
                        distances_sq[chosen.rank[i]] = chosen.distance_sq[i];
                    }
                    take(tree.leaf(l).index[lane], indices.begin(), distances_sq.begin());
                });
            }
        });
}

}  // namespace

NeighborSearch::NeighborSearch(std::span<const Vec3f> points, const RunContext& context)
    : tree_(std::make_unique<const PointTree>(points, PointTree::Leaves::Compact, context)) {}
NeighborSearch::~NeighborSearch() = default;
NeighborSearch::NeighborSearch(NeighborSearch&&) noexcept = default;
NeighborSearch& NeighborSearch::operator=(NeighborSearch&&) noexcept = default;

std::size_t NeighborSearch::size() const noexcept {
    return tree_->size();
}

std::span<Neighbor> NeighborSearch::nearest(const Vec3f& q,
                                            std::span<Neighbor> room) const noexcept {
    return find_nearest(*tree_, q, room);
}

void NeighborSearch::within(const Vec3f& q, float radius, std::vector<Neighbor>& found) const {
    found.clear();
    if (radius >= 0) find_within(*tree_, q, radius * radius, found);
}

NeighborLists k_nearest_neighbors(std::span<const Vec3f> points, unsigned k,
                                  const RunContext& context) {
    if (k == 0) refuse("k 0: expected at least 1 neighbour");
    NeighborLists lists;
    const std::size_t n = points.size();
    if (n == 0) {
        lists.offsets = {0};
        return lists;
    }
    const std::size_t each = std::min<std::size_t>(k, n - 1);
    lists.offsets.reserve(n + 1);
    for_blocks_in_order(n + 1, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) lists.offsets.push_back(i * each);
    });
    resize_in_blocks(lists.indices, n * each, context);
    resize_in_blocks(lists.distances_sq, n * each, context);
    if (each == 0) return lists;

    for_each_nearest(points, each, context, [&](Index i, auto indices, auto distances_sq) {
        const auto to = static_cast<std::ptrdiff_t>(lists.offsets[i]);
        std::copy_n(indices, each, lists.indices.begin() + to);
        std::copy_n(distances_sq, each, lists.distances_sq.begin() + to);
    });
    return lists;
}

NearestLists nearest_lists(std::span<const Vec3f> points, unsigned k, const RunContext& context) {
    NearestLists lists;
    if (points.size() < 2) return lists;
    lists.each = std::min<std::size_t>(k, points.size() - 1);
    resize_in_blocks(lists.indices, points.size() * lists.each, context);
    for_each_nearest(points, lists.each, context, [&](Index i, auto indices, auto) {
        std::copy_n(indices, lists.each,
                    lists.indices.begin() + static_cast<std::ptrdiff_t>(i * lists.each));
    });
    return lists;
}

double mean_spacing(std::span<const Vec3f> points, const RunContext& context) {
    if (points.size() < 2) return 0.0;
    constexpr std::size_t kAsked = 16'384 / kWidth;  // leaves
    const PointTree tree(points, PointTree::Leaves::Quick, context);
    const std::size_t step = std::max<std::size_t>(1, tree.leaf_count() / kAsked);
    const std::size_t asked = (tree.leaf_count() + step - 1) / step;
    std::vector<float> sums(asked);  // of a leaf's gaps
    parallel_for_blocks(asked, kLeavesPerBlock, context, [&](std::size_t begin, std::size_t end) {
        LeafQuery query(tree, points, 1);
        for (std::size_t i = begin; i < end; ++i) {
            query.run(i * step, [&](std::size_t, const Candidates&, const Chosen& chosen) {
                const auto nearest =
                    std::min_element(chosen.distance_sq, chosen.distance_sq + chosen.count);
                sums[i] += std::sqrt(*nearest);
            });
        }
    });
    limit_largest(sums);
    double sum = 0;
    std::size_t count = 0;
    for (std::size_t i = 0; i < asked; ++i) {
        sum += sums[i];
        count += tree.points_in(i * step);
    }
    return sum / static_cast<double>(count);
}

NeighborLists radius_neighbors(std::span<const Vec3f> points, float radius,
                               const RunContext& context) {
    require(radius > 0 && std::isfinite(radius), "radius", radius, "a finite length above 0");
    NeighborLists lists;
    lists.offsets.assign(points.size() + 1, 0);
    const float radius_sq = radius * radius;
    const PointTree tree(points, PointTree::Leaves::Quick, context);

    // Calls visit(i, neighbours) for the points of a block, in the order of the tree.
    const auto for_each_list = [&](std::size_t begin, std::size_t end, auto&& visit) {
        std::vector<Neighbor> found;
        for (std::size_t l = begin; l < end; ++l) {
            for (std::size_t lane = 0; lane < tree.points_in(l); ++lane) {
                const Index own = tree.leaf(l).index[lane];
                found.clear();
                find_within(tree, tree.leaf(l).position(lane), radius_sq, found);
                found.erase(std::ranges::find(found, own, &Neighbor::index));
                visit(own, found);
            }
        }
    };
    const auto in_blocks = [&](auto&& visit) {
        parallel_for_blocks(
            tree.leaf_count(), kLeavesPerBlock, context,
            [&](std::size_t begin, std::size_t end) { for_each_list(begin, end, visit); });
    };
    in_blocks([&](Index i, const std::vector<Neighbor>& found) {
        lists.offsets[i + std::size_t{1}] = found.size();
    });
    for (std::size_t i = 1; i < lists.offsets.size(); ++i) lists.offsets[i] += lists.offsets[i - 1];
    constexpr std::uint64_t kMaxPairs = std::uint64_t{1} << 32U;
    if (lists.offsets.back() > kMaxPairs) {
        throw Error(ErrorCode::TooLarge, std::to_string(lists.offsets.back()) +
                                             " pairs within radius " + std::to_string(radius) +
                                             ": expected at most 2^32; choose a smaller radius");
    }
    resize_in_blocks(lists.indices, lists.offsets.back(), context);
    resize_in_blocks(lists.distances_sq, lists.offsets.back(), context);
    in_blocks([&](Index i, std::vector<Neighbor>& found) {
        std::ranges::sort(found);
        std::uint64_t to = lists.offsets[i];
        for (const Neighbor& neighbor : found) {
            lists.indices[to] = neighbor.index;
            lists.distances_sq[to++] = neighbor.distance_sq;
        }
    });
    return lists;
}

}  // namespace stipple
