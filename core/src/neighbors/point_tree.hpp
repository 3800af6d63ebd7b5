#pragma once

#include "base/large_memory.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace stipple {

/// A packed Hilbert R-tree (Kamel and Faloutsos 1994): the points along a Hilbert curve, cut into
/// leaves of eight whose coordinates lie together for vector code; the boxes of eight leaves make a
/// node, those of eight nodes the node above, up to one.
class PointTree {
public:
    static constexpr std::size_t kWidth = 8;  ///< points of a leaf, children of a node
    static constexpr Index kNone = std::numeric_limits<Index>::max();

    /// Eight points; what is missing in the last leaf lies at infinity and has the index `kNone`.
    struct alignas(32) Leaf {
        std::array<float, kWidth> x, y, z;
        std::array<Index, kWidth> index;

        Vec3f position(std::size_t lane) const noexcept { return {x[lane], y[lane], z[lane]}; }
    };

    /// The boxes of eight children and the lowest index in each; one that is missing is empty,
    /// infinitely far from everything.
    struct alignas(32) Node {
        std::array<std::array<float, kWidth>, 3> low, high;
        std::array<Index, kWidth> lowest;
    };

    enum class Leaves {
        Loose,    ///< along a coarse curve: for a few queries
        Quick,    ///< as the curve has them: for one pass over all points, leaf by leaf
        Compact,  ///< ordered anew, which costs as much again: for many single queries
        Given,    ///< as the points stand, which follow a curve already: a tenth of the cost
    };

    /// Finite points. O(N log N), parallel; 20 bytes a point, and about 30 more while it is built.
    PointTree(std::span<const Vec3f> points, Leaves leaves, const RunContext& context);

    std::size_t size() const noexcept { return size_; }
    std::size_t leaf_count() const noexcept { return leaves_.size(); }
    const Leaf& leaf(std::size_t l) const noexcept { return leaves_[l]; }
    /// Of a point by its number in the tree: leaf by leaf, lane by lane.
    Vec3f position(std::size_t at) const noexcept {
        return leaves_[at / kWidth].position(at % kWidth);
    }
    std::size_t points_in(std::size_t l) const noexcept {
        return std::min(kWidth, size_ - l * kWidth);
    }

    /// Level 0 has the boxes of the leaves: those of leaf l are child l % 8 of node l / 8. The last
    /// level has one node; there is none where there are no points.
    std::size_t level_count() const noexcept { return levels_.size(); }
    const Node& node(std::size_t level, std::size_t n) const noexcept { return levels_[level][n]; }
    /// How many children the nodes of a level have in all.
    std::size_t child_count(std::size_t level) const noexcept {
        return level == 0 ? leaves_.size() : levels_[level - 1].size();
    }

    /// All points of the tree by raw pointers, for kernels that are compiled for several
    /// instruction sets and must share no inline function with other code.
    struct View {
        const Leaf* leaves;
        const Node* const* levels;
        const std::uint32_t* child_counts;
        std::uint32_t level_count;
    };
    View view() const noexcept {
        return {leaves_.data(), level_data_.data(), child_counts_.data(),
                static_cast<std::uint32_t>(levels_.size())};
    }

private:
    std::size_t size_;
    LargeArray<Leaf> leaves_;
    std::vector<std::vector<Node>> levels_;
    std::vector<const Node*> level_data_;
    std::vector<std::uint32_t> child_counts_;
};

/// Better leaves pay off when about as many places are looked for as there are points.
constexpr PointTree::Leaves leaves_for(std::uint64_t points, std::uint64_t places) noexcept {
    constexpr std::uint64_t kMany = 8, kAll = 64;  // points for each place
    return places < points / kAll    ? PointTree::Leaves::Loose
           : places < points / kMany ? PointTree::Leaves::Quick
                                     : PointTree::Leaves::Compact;
}

}  // namespace stipple
