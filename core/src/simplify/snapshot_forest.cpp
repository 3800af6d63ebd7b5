#include "simplify/snapshot_forest.hpp"

#include "base/parallel_for.hpp"
#include "cloud/cloud_copy.hpp"
#include "neighbors/nearest_lists.hpp"
#include "stipple/cleaning.hpp"
#include "stipple/neighbors.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cassert>
#include <numeric>
#include <utility>

namespace stipple {

namespace {

/// A place is described by so many points around it: about two rings of an even piece of surface,
/// which is where a surface through 20 neighbours still changes much.
constexpr std::size_t kAround = 16, kFarAround = 64;

/// Levels between neighbours.
constexpr std::size_t kMostJump = 2;

void append(PointCloud& to, const PointCloud& from) {
    const auto add = [](auto& values, const auto& more) {
        values.insert(values.end(), more.begin(), more.end());
    };
    add(to.positions, from.positions);
    add(to.normals, from.normals);
    add(to.colors, from.colors);
    assert(to.attributes.size() == from.attributes.size());
    for (std::size_t a = 0; a < to.attributes.size(); ++a) {
        std::visit(
            [&]<typename Values>(Values& values) {
                add(values, std::get<Values>(from.attributes[a].values));
            },
            to.attributes[a].values);
    }
}

/// For each place, so many points around it; each point once, in their order.
std::vector<Index> points_around(std::span<const Vec3f> points, std::span<const Vec3f> places,
                                 std::size_t count, const RunContext& context) {
    const NeighborSearch search(points, context);
    std::vector<std::uint8_t> found(points.size(), 0);
    for_blocks_in_order(places.size(), context, [&](std::size_t begin, std::size_t end) {
        std::vector<Neighbor> room(count);
        for (std::size_t i = begin; i < end; ++i)
            for (const Neighbor& near : search.nearest(places[i], room)) found[near.index] = 1;
    });
    std::vector<Index> which;
    for (std::size_t i = 0; i < found.size(); ++i)
        if (found[i] != 0) which.push_back(static_cast<Index>(i));
    return which;
}

}  // namespace

SnapshotForest::SnapshotForest(std::vector<PointCloud> levels, const RunContext& context)
    : offsets_{0} {
    for (std::size_t l = 0; l < levels.size(); ++l) {
        PointCloud& level = levels[l];
        if (l > 0) {
            const std::span<const Vec3f> above =
                std::span(nodes_.positions).subspan(offsets_[l - 1]);
            const NeighborSearch search(above, context);
            const std::size_t begin = parents_.size();
            parents_.resize(begin + level.size());
            parallel_for_blocks(level.size(), 2048, context, [&](std::size_t from, std::size_t to) {
                for (std::size_t i = from; i < to; ++i) {
                    std::array<Neighbor, 1> room;
                    const Neighbor nearest = search.nearest(level.positions[i], room).front();
                    parents_[begin + i] = offsets_[l - 1] + nearest.index;
                }
            });
            append(nodes_, level);
        } else {
            nodes_ = std::move(level);
        }
        offsets_.push_back(static_cast<Index>(nodes_.size()));
        level = {};
    }
    const Index roots = offsets_[1];
    first_child_.assign(nodes_.size() + 1, 0);
    for (const Index parent : parents_) ++first_child_[parent + 1];
    std::partial_sum(first_child_.begin(), first_child_.end(), first_child_.begin());
    children_.resize(parents_.size());
    std::vector<Index> next(first_child_.begin(), first_child_.end() - 1);
    for (std::size_t i = 0; i < parents_.size(); ++i)
        children_[next[parents_[i]]++] = roots + static_cast<Index>(i);
    too_coarse_.assign(nodes_.size(), 0);
}

std::span<const Index> SnapshotForest::children_of(Index node) const noexcept {
    return std::span(children_).subspan(first_child_[node],
                                        first_child_[node + 1] - first_child_[node]);
}

PointCloud SnapshotForest::level(std::size_t level, const RunContext& context) const {
    std::vector<Index> nodes(size_of(level));
    std::iota(nodes.begin(), nodes.end(), offsets_[level]);
    return subset(nodes_, nodes, context);
}

void SnapshotForest::mark(std::size_t level, std::span<const Vec3f> places,
                          const RunContext& context) {
    if (level + 1 == level_count()) return;
    const std::span<const Vec3f> points =
        std::span(nodes_.positions).subspan(offsets_[level], size_of(level));
    for (const Index i : points_around(points, places, kAround, context))
        too_coarse_[offsets_[level] + i] = 1;
}

bool SnapshotForest::mark(std::span<const Index> cut, std::span<const Vec3f> places, unsigned steps,
                          const RunContext& context) {
    std::vector<Vec3f> points(cut.size());
    for (std::size_t i = 0; i < cut.size(); ++i) points[i] = nodes_.positions[cut[i]];
    bool changed = false;
    for (const Index i : points_around(points, places, kAround, context)) {
        if (cut[i] >= offsets_[level_count() - 1]) continue;  // a point of the input
        mark_below(cut[i], steps);
        changed = true;
    }
    return changed;
}

bool SnapshotForest::mark_all(std::span<const Vec3f> places, const RunContext& context) {
    const Index finest = offsets_[level_count() - 1], roots = offsets_[1];
    const std::span<const Vec3f> points = std::span(nodes_.positions).subspan(finest);
    bool changed = false;
    for (const Index i : points_around(points, places, kFarAround, context)) {
        for (Index node = finest + i; node >= roots;) {
            node = parents_[node - roots];
            changed |= too_coarse_[node] == 0;
            too_coarse_[node] = 1;
        }
    }
    return changed;
}

bool SnapshotForest::grade(std::span<const Index> cut, const RunContext& context) {
    std::vector<Vec3f> points(cut.size());
    std::vector<std::uint8_t> levels(cut.size());
    for (std::size_t i = 0; i < cut.size(); ++i) {
        points[i] = nodes_.positions[cut[i]];
        levels[i] = level_of(cut[i]);
    }
    const NearestLists near = nearest_lists(points, kAround, context);
    std::atomic<bool> changed = false;
    parallel_for_blocks(cut.size(), 2048, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const bool too_coarse = std::ranges::any_of(
                near.of(i), [&](Index j) { return levels[j] > levels[i] + kMostJump; });
            if (!too_coarse) continue;
            too_coarse_[cut[i]] = 1;
            changed = true;
        }
    });
    return changed;
}

std::uint8_t SnapshotForest::level_of(Index node) const noexcept {
    const auto levels = std::ranges::upper_bound(offsets_, node) - offsets_.begin();
    return static_cast<std::uint8_t>(levels - 1);
}

void SnapshotForest::mark_below(Index node, unsigned steps) {
    if (steps == 0 || node >= offsets_[level_count() - 1]) return;
    too_coarse_[node] = 1;
    for (const Index child : children_of(node)) mark_below(child, steps - 1);
}

std::vector<Index> SnapshotForest::cut(std::size_t base) const {
    std::vector<Index> cut, open;
    for (Index root = offsets_[base]; root < offsets_[base + 1]; ++root) {
        open.push_back(root);
        while (!open.empty()) {
            const Index node = open.back();
            open.pop_back();
            if (too_coarse_[node] == 0) {
                cut.push_back(node);
                continue;
            }
            // One without children leaves its place to those of its neighbours.
            const std::span<const Index> children = children_of(node);
            open.insert(open.end(), children.rbegin(), children.rend());
        }
    }
    return cut;
}

PointCloud SnapshotForest::cloud_of(std::span<const Index> cut, const RunContext& context) const {
    PointCloud cloud = subset(nodes_, cut, context);
    clean(cloud, context);
    return cloud;
}

}  // namespace stipple
