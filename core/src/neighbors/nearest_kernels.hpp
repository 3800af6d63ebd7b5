#pragma once

#include "neighbors/point_tree.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace stipple {

/// Leaves near a place, copied side by side: what is chosen from. The slot of a point is its place
/// among all their points. Arrays have room for 24 points more than `capacity` leaves have.
struct Candidates {
    float *x, *y, *z;
    Index* index;
    float* distance_sq;        ///< to the point that asks
    std::uint32_t* leaf;       ///< their numbers, ascending
    std::uint32_t capacity;    ///< leaves there is room for
    std::uint32_t leaves = 0;  ///< that were gathered
    float limit_sq = 0;        ///< every point this far from any in the box is here
};

/// The k nearest or a few more, in order of the candidates. Arrays have room for all candidates and
/// 24 more.
struct Chosen {
    float* distance_sq;
    std::uint32_t* slot;      ///< their places among the candidates
    std::uint32_t* rank;      ///< their places by (distance, index), from 0
    std::uint32_t* flipped;   ///< room for their indices, which `rank` compares
    std::uint32_t count = 0;  ///< 0 where the candidates do not suffice
    float radius_sq = 0;      ///< within which they lie
};

/// How many more than k are as cheap to rank: up to the next but one whole group of eight.
constexpr std::uint32_t slack_for(std::uint32_t k) noexcept {
    return 2 * PointTree::kWidth - 1 - (k + PointTree::kWidth - 1) % PointTree::kWidth;
}

/// The inner loops of the neighbour queries, for one instruction set. Every set gives the same
/// bits.
struct NearestKernels {
    const char* name;

    /// Finds the leaves within a distance of a box, low and high corner. False where they are too
    /// many.
    bool (*gather)(const PointTree::View& tree, const float* low, const float* high, float limit_sq,
                   Candidates& candidates) noexcept;

    /// Chooses the nearest to a place within the box: `k`, or up to `slack` more, or still more
    /// where distances are equal. The point at slot `own` is left out; there may be none.
    /// `guess_sq` is about the squared distance of the last.
    void (*choose)(const Candidates& candidates, const float* from, std::uint32_t own,
                   std::uint32_t k, std::uint32_t slack, float guess_sq, Chosen& chosen) noexcept;

    /// Fills in the ranks.
    void (*rank)(const Candidates& candidates, const Chosen& chosen) noexcept;

    /// The `k` points nearest to any place, nearest first, the smaller index first among equals: of
    /// each the bits of its squared distance, above its index. One place before `keys` and three
    /// behind the last are written as well. Quickest for few. False where fewer than `k` are at a
    /// finite distance.
    bool (*nearest)(const PointTree::View& tree, const float* from, std::uint32_t k,
                    std::int64_t* keys) noexcept;

    /// All points within a finite distance of any place, in the order of the tree: their squared
    /// distances and indices. Both arrays have room for `most` and 8 more.
    /// @return  how many there are; some number above `most` where there are more.
    std::uint32_t (*within)(const PointTree::View& tree, const float* from, float radius_sq,
                            std::uint32_t most, float* distances_sq, Index* indices) noexcept;

    /// The same points, relative to the place, coordinate by coordinate.
    std::uint32_t (*around)(const PointTree::View& tree, const float* from, float radius_sq,
                            std::uint32_t most, float* x, float* y, float* z) noexcept;

    /// For each point of a leaf the mean of the squared distances to the eight nearest of the
    /// points in this leaf and the two beside it on the curve, all finite; anything for points that
    /// the leaf is short of.
    void (*spread)(const PointTree::View& tree, std::uint32_t leaf, float* spreads) noexcept;
};

/// What this machine can run, the plainest first.
std::vector<NearestKernels> available_nearest_kernels();

/// The quickest of them.
const NearestKernels& nearest_kernels();

}  // namespace stipple
