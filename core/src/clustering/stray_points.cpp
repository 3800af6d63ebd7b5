#include "clustering/stray_points.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "neighbors/point_tree.hpp"
#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <iterator>
#include <ranges>
#include <vector>

namespace stipple {

namespace {

/// The centroids of the chosen regions, as they are scaled there.
std::vector<Vec3f> centroids_of(const Regions& regions, std::span<const Index> chosen,
                                const RunContext& context) {
    auto centroids = made_in_blocks<std::vector<Vec3f>>(chosen.size(), context);
    for_blocks_in_order(chosen.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            centroids[i] = regions.regions[chosen[i]].centroid;
    });
    return centroids;
}

}  // namespace

Clusters with_strays_joined(std::span<const Vec3f> points, const Regions& regions,
                            std::span<const Index> chosen, const RunContext& context) {
    std::vector<Index> strays;
    strays.reserve(regions.regions.size() - chosen.size());
    for_blocks_in_order(regions.regions.size(), context, [&](std::size_t begin, std::size_t end) {
        const auto all = std::views::iota(static_cast<Index>(begin), static_cast<Index>(end));
        const auto first = std::ranges::lower_bound(chosen, all.front());
        std::ranges::set_difference(all, std::ranges::subrange(first, chosen.end()),
                                    std::back_inserter(strays));
    });
    // Of the members of strays.
    auto cluster = made_in_blocks<std::vector<Index>>(regions.members.size(), context);
    if (!strays.empty()) {
        const std::vector<Vec3f> centroids = centroids_of(regions, chosen, context);
        const PointTree tree(centroids, PointTree::Leaves::Compact, context);
        parallel_for_blocks(strays.size(), 64, context, [&](std::size_t begin, std::size_t end) {
            Neighbor closest;  // the smaller number among equals
            for (std::size_t i = begin; i < end; ++i) {
                const Region& stray = regions.regions[strays[i]];
                for (Index at = stray.begin; at < stray.end; ++at) {
                    find_nearest(tree, points[regions.members[at]] * regions.scale, {&closest, 1});
                    cluster[at] = closest.index;
                }
            }
        });
    }

    Clusters clusters;
    const auto for_strays = [&](auto&& visit) {
        for (const Index stray : strays) {
            context.throw_if_stopped();
            const Region& region = regions.regions[stray];
            for (Index at = region.begin; at < region.end; ++at) visit(at);
        }
    };
    const auto for_chosen = [&](auto&& visit) {
        for_blocks_in_order(chosen.size(), context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t c = begin; c < end; ++c) visit(c, regions.regions[chosen[c]]);
        });
    };
    resize_in_blocks(clusters.offsets, chosen.size() + 1, context);
    for_chosen([&](std::size_t c, const Region& r) { clusters.offsets[c + 1] = r.size(); });
    for_strays([&](Index at) { ++clusters.offsets[cluster[at] + 1]; });
    for_chosen([&](std::size_t c, auto&) { clusters.offsets[c + 1] += clusters.offsets[c]; });
    resize_in_blocks(clusters.members, regions.members.size(), context);
    auto next = made_in_blocks<std::vector<Index>>(chosen.size(), context);
    for_chosen([&](std::size_t c, const Region& region) {
        next[c] = clusters.offsets[c] + region.size();
        std::copy_n(&regions.members[region.begin], region.size(),
                    &clusters.members[clusters.offsets[c]]);
    });
    for_strays([&](Index at) { clusters.members[next[cluster[at]]++] = regions.members[at]; });
    return clusters;
}

}  // namespace stipple
