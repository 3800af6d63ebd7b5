#include "clustering/stray_points.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "cloud/float4.hpp"
#include "clustering/point_blocks.hpp"
#include "clustering/surroundings.hpp"
#include "neighbors/point_tree.hpp"
#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <cmath>
#include <ranges>
#include <utility>
#include <vector>

namespace stipple {

namespace {

/// The centroids of the chosen regions.
class Centroids {
public:
    Centroids(const Regions& regions, std::span<const Index> chosen, const RunContext& context)
        : scale_(regions.scale),
          positions_(positions_of(regions, chosen, context)),
          blocks_(positions_, 16, 1.0F, context),
          tree_(positions_, PointTree::Leaves::Quick, context) {}

    /// Some of them: numbers among the chosen regions and scaled positions, and behind those
    /// groups of four are filled up with what is infinitely far.
    struct Near {
        std::vector<Index> number;
        std::vector<float> x, y, z;
        Surroundings found;  ///< without those that lie too far
    };

    /// Finds every centroid that may be the closest to a point within `reach` of q. For those of so
    /// many points: false where they are too many to look at them all for each.
    bool find_candidates(const Vec3f& q, float reach, std::size_t points, Near& near) const {
        constexpr float kRounding = 1.0001F, kNotZero = std::numeric_limits<float>::min();
        constexpr std::size_t kMany = 64, kForEach = 4;
        const float needed =
            std::max(kNotZero, kRounding * (std::sqrt(nearest_to(q).distance_sq) + 2 * reach));
        near.found.look(blocks_, q, 0, needed, blocks_.samples().size);
        if (near.found.free_count > kMany + kForEach * points) return false;
        write_out(needed * needed, near);
        return true;
    }

    /// Of equally near ones the least.
    Neighbor nearest_to(const Vec3f& q) const {
        Neighbor nearest;
        find_nearest(tree_, q, {&nearest, 1});
        return nearest;
    }

    float scale() const noexcept { return scale_; }

private:
    static std::vector<Vec3f> positions_of(const Regions& regions, std::span<const Index> chosen,
                                           const RunContext& context) {
        auto positions = made_in_blocks<std::vector<Vec3f>>(chosen.size(), context);
        for_blocks_in_order(chosen.size(), context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i)
                positions[i] = regions.regions[chosen[i]].centroid;
        });
        return positions;
    }

    /// Numbers and positions of those found that are within the root of `limit_sq`.
    void write_out(float limit_sq, Near& near) const {
        constexpr float kFar = std::numeric_limits<float>::infinity();
        near.number.clear();
        for (auto* const axis : {&near.x, &near.y, &near.z}) axis->clear();
        const auto add = [&](Index number, const Vec3f& position) {
            near.number.push_back(number);
            near.x.push_back(position.x());
            near.y.push_back(position.y());
            near.z.push_back(position.z());
        };
        for (std::size_t i = 0; i < near.found.free_count; ++i) {
            if (near.found.free_sq[i] > limit_sq) continue;
            const Index place = near.found.free[i];
            add(blocks_.samples().index[place], blocks_.samples().position(place));
        }
        while (near.number.size() % 4 != 0) add(0, Vec3f::Constant(kFar));
    }

    float scale_;
    std::vector<Vec3f> positions_;
    PointBlocks blocks_;
    PointTree tree_;
};

/// The number of the nearest; of equally near ones the least.
Index closest(const Vec3f& p, const Centroids::Near& near) {
    constexpr float kFar = std::numeric_limits<float>::infinity();
    Float4 best_sq = {kFar, kFar, kFar, kFar};
    Int4 best = {};
    for (std::size_t i = 0; i < near.number.size(); i += 4) {
        const Float4 x = load(&near.x[i]) - p.x(), y = load(&near.y[i]) - p.y(),
                     z = load(&near.z[i]) - p.z();
        const Float4 distance_sq = x * x + y * y + z * z;
        Int4 number;
        __builtin_memcpy(&number, &near.number[i], sizeof number);
        const Int4 nearer = (distance_sq < best_sq) | ((distance_sq == best_sq) & (number < best));
        best_sq = nearer ? distance_sq : best_sq;
        best = nearer ? number : best;
    }
    std::pair nearest = {best_sq[0], best[0]};
    for (int lane = 1; lane < 4; ++lane)
        nearest = std::min(nearest, std::pair(best_sq[lane], best[lane]));
    return static_cast<Index>(nearest.second);
}

/// Writes the number of the closest centroid for each point of a region, beside its members.
void join(std::span<const Vec3f> points, const Regions& regions, const Region& stray,
          const Centroids& centroids, Centroids::Near& near, std::vector<Index>& cluster) {
    const auto position = [&](Index at) {
        return Vec3f(points[regions.members[at]] * centroids.scale());
    };
    float reach_sq = 0;
    for (Index at = stray.begin; at < stray.end; ++at)
        reach_sq = std::max(reach_sq, (position(at) - stray.centroid).squaredNorm());
    const bool is_narrow =
        centroids.find_candidates(stray.centroid, std::sqrt(reach_sq), stray.size(), near);
    for (Index at = stray.begin; at < stray.end; ++at)
        cluster[at] =
            is_narrow ? closest(position(at), near) : centroids.nearest_to(position(at)).index;
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
        const Centroids centroids(regions, chosen, context);
        parallel_for_blocks(strays.size(), 64, context, [&](std::size_t begin, std::size_t end) {
            Centroids::Near near;
            for (std::size_t i = begin; i < end; ++i)
                join(points, regions, regions.regions[strays[i]], centroids, near, cluster);
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
