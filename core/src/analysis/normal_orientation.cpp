#include "stipple/normal_orientation.hpp"

#include "base/counting_sort.hpp"
#include "base/first_touch.hpp"
#include "base/large_memory.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "neighbors/leaf_query.hpp"
#include "neighbors/point_tree.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory_resource>
#include <numeric>
#include <span>
#include <string>
#include <utility>
#include <vector>

// Follows: Hoppe, DeRose, Duchamp, McDonald and Stuetzle 1992, with Kruskal's algorithm over edges
// in 4096 classes of cost; sets of points know which of them are turned, so that no tree has to be
// walked. We depart in two ways. An edge also costs the more the steeper it leaves the tangent
// planes: it may join the two sides of a thin sheet. And each part is turned outward by six extreme
// points, not by the highest alone.

namespace stipple {

namespace {

constexpr std::size_t kWidth = PointTree::kWidth;
constexpr std::size_t kLeavesPerBlock = 128;
constexpr std::size_t kPointsPerBlock = 65'536;
constexpr std::uint16_t kClasses = 4096;
constexpr std::uint16_t kKnown = kClasses;  ///< of an edge that the other end has too

struct Edge {
    Index a, b;
};

/// The graph of nearest neighbours. Points are numbered by their place in the tree, so that
/// neighbours lie near each other in memory.
struct Graph {
    template <typename T>
    using Values = std::pmr::vector<T>;

    std::size_t size = 0;
    unsigned k = 0;
    Values<Index> number{&large_memory_resource()};  ///< of each point in the cloud
    Values<Vec3f> positions{&large_memory_resource()}, normals{&large_memory_resource()};
    Values<float> radii_sq{&large_memory_resource()};         ///< of the k-th neighbours
    Values<Index> neighbors{&large_memory_resource()};        ///< size * k
    Values<std::uint16_t> classes{&large_memory_resource()};  ///< of cost, beside them
};

Graph graph_of_one(const Vec3f& point, const Vec3f& normal) {
    Graph graph;
    graph.size = 1;
    graph.number = {0};
    graph.positions = {point};
    graph.normals = {normal};
    graph.radii_sq = {0};
    return graph;
}

Graph make_graph(std::span<const Vec3f> points, std::span<const Vec3f> normals, unsigned k,
                 const RunContext& context) {
    const PointTree tree(points, PointTree::Leaves::Quick, context);
    const std::size_t n = points.size();
    Graph graph;
    graph.size = n;
    graph.k = k;
    resize_in_blocks(graph.number, n, context);
    resize_in_blocks(graph.positions, n, context);
    resize_in_blocks(graph.normals, n, context);
    resize_in_blocks(graph.radii_sq, n, context);
    resize_in_blocks(graph.neighbors, n * k, context);
    auto place = made_in_blocks<std::vector<Index>>(n, context);
    parallel_for_blocks(n, kPointsPerBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const Index in_cloud = tree.leaf(i / kWidth).index[i % kWidth];
            graph.number[i] = in_cloud;
            graph.positions[i] = points[in_cloud];
            graph.normals[i] = normals[in_cloud];
            place[in_cloud] = static_cast<Index>(i);
        }
    });
    parallel_for_blocks(
        tree.leaf_count(), kLeavesPerBlock, context, [&](std::size_t begin, std::size_t end) {
            LeafQuery query(tree, points, k);
            for (std::size_t l = begin; l < end; ++l) {
                query.run(l, [&](std::size_t lane, const Candidates& near, const Chosen& chosen) {
                    const std::size_t i = l * kWidth + lane;
                    std::size_t to = i * k;
                    for (std::uint32_t c = 0; c < chosen.count; ++c) {
                        if (chosen.rank[c] >= k) continue;
                        graph.neighbors[to++] = place[near.index[chosen.slot[c]]];
                        graph.radii_sq[i] = std::max(graph.radii_sq[i], chosen.distance_sq[c]);
                    }
                });
            }
        });
    return graph;
}

/// What an edge costs, as one of the classes: as the angle between the normals where it lies in the
/// tangent planes, up to that of a right angle where it leaves one at a right angle.
std::uint16_t class_of(const Vec3f& difference, float distance_sq, const Vec3f& a,
                       const Vec3f& b) noexcept {
    const float agreement = std::abs(a.dot(b));
    const float lift_a = difference.dot(a), lift_b = difference.dot(b);
    const float lift_sq = std::max(lift_a * lift_a, lift_b * lift_b);
    const float level = distance_sq > 0 ? 1.0F - lift_sq / distance_sq : 1.0F;
    const float cost = 1.0F - agreement * level;
    if (!(cost < 1.0F)) return kClasses - 1;
    return static_cast<std::uint16_t>(std::sqrt(std::max(0.0F, cost)) * kClasses);
}

/// Fills in the classes. Of an edge that both ends have, only the later one's counts.
void classify(Graph& graph, const RunContext& context) {
    resize_in_blocks(graph.classes, graph.neighbors.size(), context);
    parallel_for_blocks(
        graph.size, kPointsPerBlock / 8, context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                for (std::size_t e = i * graph.k; e < (i + 1) * graph.k; ++e) {
                    const Index j = graph.neighbors[e];
                    const Vec3f d = graph.positions[j] - graph.positions[i];
                    const float distance_sq = d.x() * d.x() + d.y() * d.y() + d.z() * d.z();
                    graph.classes[e] =
                        i < j && distance_sq < graph.radii_sq[j]
                            ? kKnown
                            : class_of(d, distance_sq, graph.normals[i], graph.normals[j]);
                }
            }
        });
}

/// The edges, the cheapest first: a counting sort.
std::pmr::vector<Edge> sorted_edges(const Graph& graph, const RunContext& context) {
    constexpr std::size_t kBuckets = kClasses + 1;  // the last for edges that are known
    const std::size_t blocks = (graph.size + kPointsPerBlock - 1) / kPointsPerBlock;
    std::vector<Index> places(blocks * kBuckets);
    parallel_for_blocks(graph.size, kPointsPerBlock, context,
                        [&](std::size_t begin, std::size_t end) {
                            Index* count = places.data() + begin / kPointsPerBlock * kBuckets;
                            for (std::size_t e = begin * graph.k; e < end * graph.k; ++e)
                                ++count[graph.classes[e]];
                        });
    const std::vector<Index> starts = counts_to_places(places, kBuckets);
    std::pmr::vector<Edge> edges(&large_memory_resource());
    resize_in_blocks(edges, starts[kKnown], context);
    parallel_for_blocks(
        graph.size, kPointsPerBlock, context, [&](std::size_t begin, std::size_t end) {
            Index* next = places.data() + begin / kPointsPerBlock * kBuckets;
            for (std::size_t i = begin; i < end; ++i) {
                for (std::size_t e = i * graph.k; e < (i + 1) * graph.k; ++e) {
                    if (graph.classes[e] == kKnown) continue;
                    edges[next[graph.classes[e]]++] = {static_cast<Index>(i), graph.neighbors[e]};
                }
            }
        });
    return edges;
}

/// Sets of points whose normals agree once some of them are turned.
class TurnedSets {
public:
    explicit TurnedSets(std::size_t n) : links_(n) {
        for (std::size_t i = 0; i < n; ++i) links_[i] = static_cast<std::uint32_t>(2 * i);
    }

    struct Place {
        Index root;
        bool turned;  ///< against the root
    };

    Place find(Index i) noexcept {
        std::uint32_t turned = 0;
        while (links_[i] >> 1U != i) {
            const std::uint32_t up = links_[i], above = links_[up >> 1U];
            links_[i] = above ^ (up & 1U);  // halves the way for the next
            turned ^= links_[i] & 1U;
            i = links_[i] >> 1U;
        }
        return {i, turned != 0};
    }

    /// Joins the sets of two points; false where they are one.
    bool join(Index a, Index b, bool opposed) noexcept {
        Place p = find(a), q = find(b);
        if (p.root == q.root) return false;
        if (q.root < p.root) std::swap(p, q);
        const bool turned = opposed != (p.turned != q.turned);
        links_[q.root] = p.root << 1U | (turned ? 1U : 0U);
        return true;
    }

private:
    std::vector<std::uint32_t> links_;  ///< twice the point above, plus 1 where turned against it
};

TurnedSets join_along(std::span<const Edge> edges, const Graph& graph, const RunContext& context) {
    TurnedSets sets(graph.size);
    std::size_t joined = 0;
    for (std::size_t e = 0; e < edges.size() && joined + 1 < graph.size; ++e) {
        if (e % 65'536 == 0) context.throw_if_stopped();
        const auto [a, b] = edges[e];
        joined += sets.join(a, b, graph.normals[a].dot(graph.normals[b]) < 0) ? 1 : 0;
    }
    return sets;
}

/// Of one connected part: how far its normals point outward.
class Outwardness {
public:
    void add(const Vec3f& position, const Vec3f& normal) noexcept {
        for (std::size_t direction = 0; direction < 6; ++direction) {
            const auto axis = static_cast<Eigen::Index>(direction / 2);
            const float sign = direction % 2 == 0 ? 1.0F : -1.0F;
            if (!(sign * position[axis] > farthest_[direction])) continue;
            farthest_[direction] = sign * position[axis];
            votes_[direction] = sign * normal[axis];
        }
        ++count_;
        up_ += static_cast<double>(normal.z());
    }

    double total() const noexcept {
        return std::accumulate(votes_.begin(), votes_.end(), up_ / count_);
    }

private:
    static constexpr float kNone = -std::numeric_limits<float>::infinity();
    std::array<float, 6> farthest_ = {kNone, kNone, kNone, kNone, kNone, kNone};
    std::array<float, 6> votes_{};
    double count_ = 0, up_ = 0;
};

/// Turns the normals within each set, and then those of whole sets.
void turn(std::span<Vec3f> normals, TurnedSets& sets, const Graph& graph,
          const RunContext& context) {
    constexpr Index kNone = std::numeric_limits<Index>::max();
    std::vector<Index> part_of_root(graph.size, kNone), part(graph.size);
    std::vector<Outwardness> parts;
    for (Index i = 0; i < graph.size; ++i) {
        if (i % 65'536 == 0) context.throw_if_stopped();
        const auto [root, turned] = sets.find(i);
        if (part_of_root[root] == kNone) {
            part_of_root[root] = static_cast<Index>(parts.size());
            parts.emplace_back();
        }
        part[i] = part_of_root[root];
        Vec3f& normal = normals[graph.number[i]];
        if (turned) normal = -normal;
        parts[part[i]].add(graph.positions[i], normal);
    }
    for_blocks_in_order(graph.size, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            if (parts[part[i]].total() < 0) normals[graph.number[i]] *= -1.0F;
    });
}

void turn_to(const Vec3d& viewpoint, std::span<const Vec3f> points, std::span<Vec3f> normals,
             const RunContext& context) {
    parallel_for_blocks(points.size(), kPointsPerBlock, context,
                        [&](std::size_t begin, std::size_t end) {
                            for (std::size_t i = begin; i < end; ++i) {
                                const Vec3d seen = viewpoint - points[i].cast<double>();
                                if (normals[i].cast<double>().dot(seen) < 0) normals[i] *= -1.0F;
                            }
                        });
}

void check(std::size_t points, std::size_t normals, const NormalOrientationOptions& options) {
    if (points != normals) refuse(normals, " normals: expected ", points, ", one for each point");
    require(options.k >= 1 && options.k <= 64, "k", options.k, "1..64 neighbours");
    if (options.viewpoint && !options.viewpoint->allFinite())
        refuse("viewpoint: expected finite coordinates");
    constexpr std::size_t kMost = std::size_t{1} << 31U;
    if (points >= kMost)
        throw Error(ErrorCode::TooLarge,
                    std::to_string(points) + " points: expected fewer than 2^31; split the cloud");
    if (points * options.k > std::numeric_limits<Index>::max())
        throw Error(ErrorCode::TooLarge, std::to_string(points) + " points of " +
                                             std::to_string(options.k) +
                                             " neighbours: expected fewer than 2^32 pairs; give a "
                                             "smaller k, or split the cloud");
}

}  // namespace

void orient_normals(std::span<const Vec3f> points, std::span<Vec3f> normals,
                    const NormalOrientationOptions& options, const RunContext& context) {
    check(points.size(), normals.size(), options);
    if (options.viewpoint) return turn_to(*options.viewpoint, points, normals, context);
    if (points.empty()) return;
    const auto k = static_cast<unsigned>(std::min<std::size_t>(options.k, points.size() - 1));
    Graph graph =
        k > 0 ? make_graph(points, normals, k, context) : graph_of_one(points[0], normals[0]);
    classify(graph, context);
    TurnedSets sets = join_along(sorted_edges(graph, context), graph, context);
    turn(normals, sets, graph, context);
}

}  // namespace stipple
