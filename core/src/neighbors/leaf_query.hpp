#pragma once

#include "base/large_memory.hpp"
#include "neighbors/nearest_kernels.hpp"
#include "neighbors/point_tree.hpp"
#include "stipple/neighbors.hpp"

#include <bit>
#include <cstddef>
#include <span>
#include <vector>

namespace stipple {

/// Finds the k nearest others of the points of one leaf at a time. One for each thread; quickest
/// when leaves come in the order of the tree, since each leaf tells how far the next has to look.
class LeafQuery {
public:
    /// @param k  1 to the number of points less one.
    LeafQuery(const PointTree& tree, std::span<const Vec3f> points, unsigned k);

    /// Calls answer(lane, candidates, chosen) for each point of the leaf: those of the chosen whose
    /// rank is below k are its neighbours, and there are k of them.
    template <typename Answer>
    void run(std::size_t leaf, Answer&& answer) {
        std::uint32_t open = (1U << tree_.points_in(leaf)) - 1U;  // lanes without an answer
        start(leaf);
        while (true) {
            for (std::uint32_t lanes = open; lanes != 0; lanes &= lanes - 1) {
                const auto lane = static_cast<std::uint32_t>(std::countr_zero(lanes));
                if (!ask(leaf, lane)) continue;
                answer(lane, static_cast<const Candidates&>(candidates_),
                       static_cast<const Chosen&>(chosen_));
                open &= ~(1U << lane);
            }
            if (open == 0) break;
            look_farther(leaf);
        }
    }

    /// There are never more chosen than this.
    std::size_t most_chosen() const noexcept {
        return std::size_t{candidates_.capacity} * PointTree::kWidth;
    }

private:
    void start(std::size_t leaf);
    void gather(std::size_t leaf, float limit_sq);
    void look_farther(std::size_t leaf);
    bool ask(std::size_t leaf, std::uint32_t lane);
    void search(std::size_t leaf, std::uint32_t lane);

    const PointTree& tree_;
    std::span<const Vec3f> points_;
    std::uint32_t k_, slack_;
    const NearestKernels& kernels_;
    LargeMemory memory_;
    Candidates candidates_;
    Chosen chosen_;
    std::vector<Neighbor> found_;
    bool gathered_ = false;  ///< else each point is searched for by itself
    unsigned tries_ = 0;
    std::uint32_t home_ = 0;       ///< slot of the first point of this leaf
    float guess_sq_ = 0;           ///< about the radius of the next answer
    float largest_radius_sq_ = 0;  ///< of the answers of this leaf
};

}  // namespace stipple
