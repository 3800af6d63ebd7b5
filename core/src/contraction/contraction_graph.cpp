#include "contraction/contraction_graph.hpp"

#include "analysis/tangent_plane.hpp"
#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/progress_for.hpp"
#include "contraction/contraction_quadrics.hpp"
#include "neighbors/leaf_query.hpp"
#include "neighbors/point_tree.hpp"
#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <array>

namespace stipple {

namespace {

constexpr unsigned kForTangent = 16, kForBorder = 32;  // neighbours
constexpr std::size_t kLeavesPerBlock = 128, kPlacesPerBlock = 8192;

/// The tangent at p by the offsets of its neighbours; where these leave room for a border, that is
/// looked for among more of them.
Tangent tangent_at(const Vec3f& p, std::span<const Vec3d> neighbors, const PointTree& tree,
                   std::span<const Vec3f> positions) {
    const Vec3d normal = normal_from(neighbors);
    if (!may_be_on_border(neighbors, normal)) return {normal};
    std::array<Neighbor, kForBorder> room;
    std::array<Vec3d, kForBorder> offsets;
    std::size_t count = 0;
    for (const Neighbor& neighbor : find_nearest(tree, p, room)) {
        const Vec3f offset = positions[neighbor.index] - p;
        if (offset != Vec3f::Zero()) offsets[count++] = offset.cast<double>();
    }
    return with_border(normal, std::span(offsets).first(count));
}

}  // namespace

ContractionGraph contraction_graph(std::span<const Vec3f> positions, unsigned k, bool with_tangents,
                                   const RunContext& context) {
    const std::size_t n = positions.size();
    const PointTree tree(positions, PointTree::Leaves::Quick, context);
    ContractionGraph graph;
    resize_in_blocks(graph.order, n, context);
    auto place_of = made_in_blocks<std::vector<Index>>(n, context);
    parallel_for_blocks(n, kPlacesPerBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            graph.order[i] = tree.leaf(i / PointTree::kWidth).index[i % PointTree::kWidth];
            place_of[graph.order[i]] = static_cast<Index>(i);
        }
    });
    graph.neighbors.reserve(n * k);
    for_blocks_in_order(n * k, context, [&](std::size_t, std::size_t end) {
        graph.neighbors.resize(end, ContractionGraph::kNone);
    });
    resize_in_blocks(graph.tangents, with_tangents ? n : 0, context);
    if (n < 2) return graph;
    const auto asked = static_cast<unsigned>(
        std::min<std::size_t>(with_tangents ? std::max(k, kForTangent) : k, n - 1));
    const auto answer_leaves = [&](std::size_t begin, std::size_t end) {
        LeafQuery query(tree, positions, asked);
        std::vector<Vec3d> offsets(asked);
        for (std::size_t leaf = begin; leaf < end; ++leaf) {
            query.run(leaf, [&](std::size_t lane, const Candidates& near, const Chosen& chosen) {
                const std::size_t place = leaf * PointTree::kWidth + lane;
                const Vec3f p = tree.leaf(leaf).position(lane);
                for (std::uint32_t c = 0; c < chosen.count; ++c) {
                    const std::uint32_t from = chosen.slot[c], rank = chosen.rank[c];
                    if (rank >= asked) continue;
                    if (rank < k) graph.neighbors[place * k + rank] = place_of[near.index[from]];
                    const Vec3f offset = Vec3f(near.x[from], near.y[from], near.z[from]) - p;
                    offsets[rank] = offset.cast<double>();
                }
                if (with_tangents)
                    graph.tangents[place] = packed(tangent_at(p, offsets, tree, positions));
            });
        }
    };
    parallel_for_blocks_in_parts(tree.leaf_count(), kLeavesPerBlock, context, answer_leaves);
    return graph;
}

}  // namespace stipple
