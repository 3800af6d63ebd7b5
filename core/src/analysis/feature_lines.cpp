#include "stipple/feature_lines.hpp"

#include "analysis/leaf_shapes.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "base/until_stopped.hpp"
#include "neighbors/point_tree.hpp"
#include "stipple/local_analysis.hpp"
#include "stipple/neighbors.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numeric>
#include <tuple>
#include <utility>
#include <vector>

// Follows: Pauly, Keiser and Gross 2003, "Multi-scale feature extraction on point-sampled
// surfaces": weights that count scales, hysteresis, a minimum spanning graph with loops, pruning.
// We thin the weighted points to their ridge before they are joined, so that the graph of a line is
// a chain, and leave out the snakes that smooth it.

namespace stipple {

namespace {

constexpr std::size_t kLeavesPerBlock = 128;

/// What all scales together say of a point.
struct Weighted {
    std::vector<float> weights;     ///< share of the scales, from the largest down, with enough
    std::vector<float> variations;  ///< their mean, which has its ridge along the feature
    std::vector<float> reaches;     ///< half the width of what has weight beside a feature
};

Weighted weigh(std::span<const Vec3f> points, double variation, const RunContext& context) {
    const std::size_t n = points.size();
    Weighted result{std::vector<float>(n), std::vector<float>(n), std::vector<float>(n)};
    if (n < 2) return result;
    const PointTree tree(points, PointTree::Leaves::Quick, context);
    const std::vector<unsigned> sizes = sizes_up_to(n - 1, kScales);
    parallel_for_blocks(
        tree.leaf_count(), kLeavesPerBlock, context, [&](std::size_t begin, std::size_t end) {
            LeafShapes shapes(tree, points, sizes);
            const auto scales = static_cast<double>(sizes.size());
            for (std::size_t l = begin; l < end; ++l) {
                shapes.run(l);
                for (std::size_t lane = 0; lane < tree.points_in(l); ++lane) {
                    double count = 0, sum = 0;
                    const Index i = tree.leaf(l).index[lane];
                    for (std::size_t scale = 0; scale < sizes.size(); ++scale) {
                        const Shape s = shapes.shape(scale, lane);
                        const double here = surface_variation({s.low, s.middle, s.high});
                        count = here >= variation ? count + 1 : 0;  // up to the largest
                        sum += here;
                        if (s.k <= 32)
                            result.reaches[i] = static_cast<float>(std::sqrt(s.radius_sq));
                    }
                    result.weights[i] = static_cast<float>(count / scales);
                    result.variations[i] = static_cast<float>(sum / scales);
                }
            }
        });
    return result;
}

/// Some of the points by their numbers in the cloud, with a search among them.
struct Nodes {
    std::vector<Index> numbers;
    std::vector<Vec3f> positions;
    NeighborSearch search;

    Nodes(std::span<const Vec3f> points, std::vector<Index> chosen, const RunContext& context)
        : numbers(std::move(chosen)),
          positions(positions_of(points, numbers)),
          search(positions, context) {}

private:
    static std::vector<Vec3f> positions_of(std::span<const Vec3f> points,
                                           const std::vector<Index>& numbers) {
        std::vector<Vec3f> positions;
        for (const Index i : numbers) positions.push_back(points[i]);
        return positions;
    }
};

/// The points of enough weight that have the most variation within their reach, the greatest first.
std::vector<Index> thin_to_ridge(std::span<const Vec3f> points, const Weighted& weighted,
                                 double low, const RunContext& context) {
    std::vector<Index> heavy;
    for (Index i = 0; i < points.size(); ++i) {
        if (static_cast<double>(weighted.weights[i]) >= low) heavy.push_back(i);
    }
    std::ranges::sort(heavy, until_stopped(context, [&](Index a, Index b) {
                          const float va = weighted.variations[a], vb = weighted.variations[b];
                          return va != vb ? va > vb : a < b;
                      }));
    const Nodes nodes(points, std::move(heavy), context);
    std::vector<char> taken(nodes.numbers.size());
    std::vector<Neighbor> near;
    std::vector<Index> ridge;
    for (std::size_t i = 0; i < nodes.numbers.size(); ++i) {
        if (i % 4096 == 0) context.throw_if_stopped();
        if (taken[i] != 0) continue;
        ridge.push_back(nodes.numbers[i]);
        nodes.search.within(nodes.positions[i], weighted.reaches[nodes.numbers[i]], near);
        for (const Neighbor& neighbor : near) taken[neighbor.index] = 1;
    }
    return ridge;
}

/// Nodes and the links between them.
using Links = std::vector<std::vector<Index>>;

/// A graph that grows, and tells how many links lie between two of its nodes.
class LinkedNodes {
public:
    explicit LinkedNodes(std::size_t nodes) : links_(nodes), parts_(nodes), seen_(nodes) {
        std::iota(parts_.begin(), parts_.end(), Index{0});
    }

    void link(Index a, Index b) {
        links_[a].push_back(b);
        links_[b].push_back(a);
        parts_[part_of(a)] = part_of(b);
    }
    /// Whether `to` can be reached from `from` over fewer than `steps` links.
    bool is_near(Index from, Index to, unsigned steps) {
        if (part_of(from) != part_of(to)) return false;
        ++search_;
        reached_.assign(1, from);
        seen_[from] = search_;
        std::size_t first = 0;
        for (unsigned step = 1; step < steps; ++step) {
            const std::size_t end = reached_.size();
            for (; first < end; ++first) {
                for (const Index next : links_[reached_[first]]) {
                    if (next == to) return true;
                    if (std::exchange(seen_[next], search_) != search_) reached_.push_back(next);
                }
            }
        }
        return false;
    }
    Links take() { return std::move(links_); }

private:
    Index part_of(Index node) {
        while (parts_[node] != node) node = parts_[node] = parts_[parts_[node]];
        return node;
    }

    Links links_;
    std::vector<Index> parts_;         ///< a node of the same part, up to one that is its own
    std::vector<std::uint64_t> seen_;  ///< the last search that came by
    std::vector<Index> reached_;
    std::uint64_t search_ = 0;
};

/// The minimum spanning graph: the shortest link first, each that joins two parts or closes a loop
/// of at least `min_links`.
Links span(const Nodes& nodes, const Weighted& weighted, unsigned min_links,
           const RunContext& context) {
    // Points of the ridge stand within two reaches of the next, or weight is missing between them.
    constexpr float kFar = 2.0F;
    std::vector<std::tuple<float, Index, Index>> pairs;
    std::vector<Neighbor> near;
    for (Index i = 0; i < nodes.numbers.size(); ++i) {
        if (i % 4096 == 0) context.throw_if_stopped();
        const float reach = weighted.reaches[nodes.numbers[i]];
        nodes.search.within(nodes.positions[i], kFar * reach, near);
        for (const Neighbor& neighbor : near) {
            if (neighbor.index != i)
                pairs.emplace_back(neighbor.distance_sq, std::min(i, neighbor.index),
                                   std::max(i, neighbor.index));
        }
    }
    std::ranges::sort(pairs, until_stopped(context, std::less<>()));
    pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
    LinkedNodes linked(nodes.numbers.size());
    for (const auto& [distance_sq, a, b] : pairs) {
        context.throw_if_stopped();
        if (!linked.is_near(a, b, min_links)) linked.link(a, b);
    }
    return linked.take();
}

void unlink(Links& links, Index a, Index b) {
    std::erase(links[a], b);
    std::erase(links[b], a);
}

/// The way from `from` by its link `next` to the first node that has not two links, or back.
std::vector<Index> follow(const Links& links, Index from, Index next) {
    std::vector<Index> way = {from, next};
    while (links[way.back()].size() == 2 && way.back() != from) {
        const std::vector<Index>& both = links[way.back()];
        way.push_back(both[0] == way[way.size() - 2] ? both[1] : both[0]);
    }
    return way;
}

/// Cuts off short ends that hang on a fork, the shortest first, and lonely short lines.
void prune(Links& links, unsigned min_links) {
    for (unsigned length = 1; length < min_links; ++length) {
        for (Index end = 0; end < links.size(); ++end) {
            if (links[end].size() != 1) continue;
            const std::vector<Index> way = follow(links, end, links[end].front());
            if (way.size() - 1 != length) continue;
            const bool lonely = links[way.back()].size() == 1;
            if (lonely && length + 1 < min_links) continue;  // may grow when others are cut off
            for (std::size_t i = 1; i < way.size(); ++i) unlink(links, way[i - 1], way[i]);
        }
    }
    for (Index end = 0; end < links.size(); ++end) {
        if (links[end].size() != 1) continue;
        const std::vector<Index> way = follow(links, end, links[end].front());
        if (links[way.back()].size() != 1 || way.size() > min_links) continue;
        for (std::size_t i = 1; i < way.size(); ++i) unlink(links, way[i - 1], way[i]);
    }
}

/// Cuts the graph into lines, which it takes out of it: first those with ends, then loops.
std::vector<std::vector<Index>> take_lines(Links& links) {
    std::vector<std::vector<Index>> lines;
    const Links whole = links;  // where the forks are
    const auto take_from = [&](Index start) {
        while (!links[start].empty()) {
            lines.push_back(follow(whole, start, links[start].front()));
            const std::vector<Index>& line = lines.back();
            for (std::size_t i = 1; i < line.size(); ++i) unlink(links, line[i - 1], line[i]);
        }
    };
    for (Index i = 0; i < links.size(); ++i) {
        if (whole[i].size() != 2) take_from(i);
    }
    for (Index i = 0; i < links.size(); ++i) take_from(i);
    return lines;
}

/// Leaves out the links of parts where no point has a high weight.
void keep_strong_parts(Links& links, const Nodes& nodes, const Weighted& weighted, double high) {
    std::vector<char> seen(links.size());
    std::vector<Index> part;
    for (Index start = 0; start < links.size(); ++start) {
        if (seen[start] != 0) continue;
        part = {start};
        seen[start] = 1;
        bool strong = false;
        for (std::size_t i = 0; i < part.size(); ++i) {
            strong |= static_cast<double>(weighted.weights[nodes.numbers[part[i]]]) >= high;
            for (const Index next : links[part[i]]) {
                if (seen[next] == 0) part.push_back(next);
                seen[next] = 1;
            }
        }
        if (strong) continue;
        for (const Index i : part) links[i].clear();
    }
}

void check(const FeatureLineOptions& options) {
    require(options.variation > 0 && options.variation < 1.0 / 3.0, "variation", options.variation,
            "more than 0, less than 1/3");
    require(options.high > 0 && options.high <= 1, "high", options.high, "more than 0, at most 1");
    require(options.low > 0 && options.low <= options.high, "low", options.low,
            "more than 0, at most high");
    require(options.min_links >= 2 && options.min_links <= 1000, "min_links", options.min_links,
            "2..1000");
}

}  // namespace

FeatureLines find_feature_lines(std::span<const Vec3f> points, const FeatureLineOptions& options,
                                const RunContext& context) {
    check(options);
    Weighted weighted = weigh(points, options.variation, context);
    const Nodes nodes(points, thin_to_ridge(points, weighted, options.low, context), context);
    Links links = span(nodes, weighted, options.min_links, context);
    keep_strong_parts(links, nodes, weighted, options.high);
    prune(links, options.min_links);
    std::vector<std::vector<Index>> lines = take_lines(links);
    for (auto& line : lines) {
        for (Index& node : line) node = nodes.numbers[node];
    }
    std::ranges::sort(lines);

    FeatureLines result;
    result.weights = std::move(weighted.weights);
    result.offsets = {0};
    for (const auto& line : lines) {
        result.points.insert(result.points.end(), line.begin(), line.end());
        result.offsets.push_back(result.points.size());
    }
    return result;
}

}  // namespace stipple
