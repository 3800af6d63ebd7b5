#pragma once

#include "point_tree.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace stipple {

/// The leaves near one leaf, "home", copied side by side: what its points choose their neighbours
/// from.
struct Candidates {
    float *x, *y, *z;
    Index* index;
    float* distance_sq;        ///< to the point that asks
    std::uint32_t capacity;    ///< leaves there is room for
    std::uint32_t leaves = 0;  ///< that were gathered
    std::uint32_t home = 0;    ///< the place of the home leaf among them
    float limit_sq = 0;        ///< every point this far from any of the home leaf is here
};

/// The answer to one point: its k nearest or a few more, in order of the candidates. Arrays have
/// room for all candidates and 24 more.
struct Chosen {
    float* distance_sq;
    std::uint32_t* slot;      ///< their places among the candidates
    std::uint32_t* rank;      ///< their places by (distance, index), from 0
    std::uint32_t* flipped;   ///< room for their indices, which `rank` compares
    std::uint32_t count = 0;  ///< 0 where the candidates do not suffice
    float radius_sq = 0;      ///< within which they lie
};

/// The inner loops of the neighbour queries, for one instruction set. Every set gives the same
/// bits.
struct NearestKernels {
    const char* name;

    /// Finds the leaves within a distance of leaf `home`. False where they are too many.
    bool (*gather)(const PointTree::View& tree, std::uint32_t home, float limit_sq,
                   Candidates& candidates) noexcept;

    /// Chooses among the candidates for the point in `lane` of the home leaf, without itself: `k`,
    /// or up to `slack` more, or still more where distances are equal. `guess_sq` is about the
    /// squared distance of the last.
    void (*choose)(const Candidates& candidates, std::uint32_t lane, std::uint32_t k,
                   std::uint32_t slack, float guess_sq, Chosen& chosen) noexcept;

    /// Fills in the ranks.
    void (*rank)(const Candidates& candidates, const Chosen& chosen) noexcept;
};

/// What this machine can run, the plainest first.
std::vector<NearestKernels> available_nearest_kernels();

/// The quickest of them.
const NearestKernels& nearest_kernels();

}  // namespace stipple
