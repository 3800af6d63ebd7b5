#include "cluster_splitting.hpp"

#include "sample_moments.hpp"
#include "symmetric_eigen.hpp"
#include "until_stopped.hpp"

#include <algorithm>
#include <functional>
#include <vector>

namespace stipple {

namespace {

/// A cluster that may be split: some of the members.
struct Piece {
    double variation = 0;  ///< total
    Index begin = 0, size = 0;

    /// In a heap, the one to be split first is the largest.
    bool operator<(const Piece& other) const noexcept {
        return variation != other.variation ? variation < other.variation : begin > other.begin;
    }
};

SampleMoments moments_of(std::span<const Vec3f> points, std::span<const Index> members) {
    const Vec3d reference = points[members.front()].cast<double>();
    SampleSums sums{};
    for (const Index i : members) {
        const Vec3d d = points[i].cast<double>() - reference;
        const SampleSums terms = {d.x(),         d.y(),         d.z(),
                                  d.x() * d.x(), d.x() * d.y(), d.x() * d.z(),
                                  d.y() * d.y(), d.y() * d.z(), d.z() * d.z()};
        for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += terms[k];
    }
    return moments_from(sums, members.size(), reference);
}

/// Moves the members on one side of the plane to the front. @return how many they are.
Index partition(std::span<const Vec3f> points, std::span<Index> members) {
    const SampleMoments moments = moments_of(points, members);
    const Vec3d direction = eigenvector(moments.scatter, eigenvalues(moments.scatter)[2]);
    const auto height = [&](Index i) {
        return (points[i].cast<double>() - moments.centroid).dot(direction);
    };
    const auto right =
        std::ranges::stable_partition(members, [&](Index i) { return height(i) < 0; });
    const auto front = static_cast<Index>(members.size() - right.size());
    if (front != 0 && front != members.size()) return front;
    std::ranges::sort(members, {}, [&](Index i) { return std::pair(height(i), i); });
    return static_cast<Index>(members.size() / 2);
}

}  // namespace

void split_clusters(std::span<const Vec3f> points, std::uint64_t target, Clusters& clusters,
                    const RunContext& context) {
    if (clusters.size() >= target) return;
    const auto members_of = [&](const Piece& piece) {
        return std::span(clusters.members).subspan(piece.begin, piece.size);
    };
    std::vector<Piece> heap, single;  // those of one point are out of the way
    const auto add = [&](Index begin, Index end) {
        Piece piece{0, begin, end - begin};
        if (piece.size == 1) return single.push_back(piece);
        piece.variation = moments_of(points, members_of(piece)).scatter.trace();
        heap.push_back(piece);
    };
    for (std::size_t i = 0; i < clusters.size(); ++i) {
        context.throw_if_stopped();
        add(clusters.offsets[i], clusters.offsets[i + 1]);
    }
    std::make_heap(heap.begin(), heap.end(), until_stopped(context, std::less<>()));
    const auto add_to_heap = [&](Index begin, Index end) {
        const std::size_t before = heap.size();
        add(begin, end);
        if (heap.size() > before) std::push_heap(heap.begin(), heap.end());
    };
    while (heap.size() + single.size() < target) {
        context.throw_if_stopped();
        std::pop_heap(heap.begin(), heap.end());
        const Piece piece = heap.back();
        heap.pop_back();
        const Index middle = piece.begin + partition(points, members_of(piece));
        add_to_heap(piece.begin, middle);
        add_to_heap(middle, piece.begin + piece.size);
    }
    clusters.offsets.clear();
    for (const Piece& piece : heap) clusters.offsets.push_back(piece.begin);
    for (const Piece& piece : single) clusters.offsets.push_back(piece.begin);
    clusters.offsets.push_back(static_cast<Index>(clusters.members.size()));
    std::ranges::sort(clusters.offsets, until_stopped(context, std::less<>()));
}

}  // namespace stipple
