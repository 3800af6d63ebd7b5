#include "stray_points.hpp"

#include "first_touch.hpp"
#include "parallel_for.hpp"
#include "point_blocks.hpp"

#include <algorithm>
#include <cmath>
#include <ranges>
#include <vector>

namespace stipple {

namespace {

/// The centroids of the chosen regions.
class Centroids {
public:
    Centroids(const Regions& regions, std::span<const Index> chosen, const RunContext& context)
        : scale_(regions.scale),
          blocks_(positions_of(regions, chosen, context), 16, 1.0F, context) {
        first_look_ = 0.5F * blocks_.extent() / std::sqrt(static_cast<float>(chosen.size()));
    }

    /// Numbers among the chosen regions and scaled positions.
    struct Near {
        std::vector<Index> number;
        std::vector<Vec3f> position;
    };

    /// Finds every centroid that may be the closest to a point within `reach` of q.
    void find_candidates(const Vec3f& q, float reach, Near& near) const {
        float radius = std::max(2 * reach, first_look_);
        float closest_sq = find(q, radius, near);
        while (near.number.empty()) {
            constexpr float kNotZero = std::numeric_limits<float>::min();
            radius = 2 * std::max(radius, kNotZero);
            closest_sq = find(q, radius, near);
        }
        constexpr float kRounding = 1.0001F;
        const float needed = kRounding * (std::sqrt(closest_sq) + 2 * reach);
        if (needed > radius) find(q, needed, near);
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

    /// @return the least squared distance.
    float find(const Vec3f& q, float radius, Near& near) const {
        near.number.clear();
        near.position.clear();
        float closest_sq = std::numeric_limits<float>::infinity();
        const float radius_sq = radius * radius;
        blocks_.find(q, radius_sq, [&](Index begin, Index end) {
            for (Index place = begin; place < end; ++place) {
                const Vec3f position = blocks_.samples().position(place);
                const float distance_sq = (position - q).squaredNorm();
                if (distance_sq > radius_sq) continue;
                near.number.push_back(blocks_.samples().index[place]);
                near.position.push_back(position);
                closest_sq = std::min(closest_sq, distance_sq);
            }
            return true;
        });
        return closest_sq;
    }

    float scale_, first_look_;
    PointBlocks blocks_;
};

Index closest(const Vec3f& p, const Centroids::Near& near) {
    std::pair<float, Index> best = {std::numeric_limits<float>::infinity(), near.number.front()};
    for (std::size_t i = 0; i < near.number.size(); ++i)
        best = std::min(best, {(near.position[i] - p).squaredNorm(), near.number[i]});
    return best.second;
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
    centroids.find_candidates(stray.centroid, std::sqrt(reach_sq), near);
    for (Index at = stray.begin; at < stray.end; ++at) cluster[at] = closest(position(at), near);
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
