// nanoflann as its examples use it: one tree in single precision, built by one thread.

#include "peers.hpp"

#include <algorithm>
#include <nanoflann.hpp>
#include <thread>
#include <vector>

namespace stipple::bench {

namespace {

struct PointSet {
    std::span<const Vec3f> points;

    std::size_t kdtree_get_point_count() const { return points.size(); }
    float kdtree_get_pt(std::size_t i, std::size_t axis) const {
        return points[i][static_cast<Eigen::Index>(axis)];
    }
    template <typename Box>
    bool kdtree_get_bbox(Box&) const {
        return false;
    }
};

using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, PointSet>,
                                                 PointSet, 3, Index>;

/// Asks for one more than k, since the point finds itself, and leaves itself out.
void query(const Tree& tree, std::span<const Vec3f> points, std::size_t k, std::size_t begin,
           std::size_t end, NeighborLists& lists) {
    std::vector<Index> indices(k + 1);
    std::vector<float> distances_sq(k + 1);
    for (std::size_t i = begin; i < end; ++i) {
        const std::size_t found =
            tree.knnSearch(points[i].data(), k + 1, indices.data(), distances_sq.data());
        std::size_t out = lists.offsets[i];
        for (std::size_t j = 0; j < found && out < lists.offsets[i + 1]; ++j) {
            if (indices[j] == i) continue;
            lists.indices[out] = indices[j];
            lists.distances_sq[out++] = distances_sq[j];
        }
    }
}

}  // namespace

NeighborLists nanoflann_nearest_neighbors(std::span<const Vec3f> points, unsigned k,
                                          unsigned threads) {
    const PointSet set{points};
    const Tree tree(3, set, {10});

    const std::size_t n = points.size();
    const std::size_t each = std::min<std::size_t>(k, n > 0 ? n - 1 : 0);
    NeighborLists lists;
    lists.indices.resize(n * each);
    lists.distances_sq.resize(n * each);
    lists.offsets.resize(n + 1);
    for (std::size_t i = 0; i <= n; ++i) lists.offsets[i] = i * each;

    {
        std::vector<std::jthread> others;  // joined at the end of the block
        for (unsigned t = 1; t < threads; ++t)
            others.emplace_back([&, t] {
                query(tree, points, each, n * t / threads, n * (t + 1) / threads, lists);
            });
        query(tree, points, each, 0, n / std::max(1U, threads), lists);
    }
    return lists;
}

}  // namespace stipple::bench
