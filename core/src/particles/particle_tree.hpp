#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace stipple {

/// The neighbours of each of some particles, flat: those of the i-th are `members[ends[i - 1]] ..
/// members[ends[i]]`.
struct ParticleNeighborhoods {
    std::vector<Index> members;
    std::vector<Index> ends;

    std::span<const Index> of(std::size_t i) const noexcept {
        return {members.data() + (i == 0 ? 0 : ends[i - 1]), members.data() + ends[i]};
    }
};

/// Particles and how far each reaches, for pairs within the mean of both reaches.
///
/// In place of the paper's grid (§5.1) a tree of boxes over the particles as they follow each
/// other: eight make a leaf, eight leaves a node, and so on. It is quick where particles that
/// follow each other are near each other, which holds for those that were spread along a
/// space-filling curve, and it does not matter to it how far reaches differ.
class ParticleTree {
public:
    /// @param reach  one for each position, input units, finite and positive. O(N); 16 bytes a
    /// particle and about 4 more.
    ParticleTree(std::span<const Vec3f> positions, std::span<const float> reach,
                 const RunContext& context);

    /// Replaces `found` by the neighbours of the particles begin..end: all others nearer than the
    /// mean of both reaches, in an order that depends on the particles alone. Where there are more
    /// than `most`, the nearest of those in some times as many leaves nearby: a particle takes no
    /// more time where all reach each other.
    void find_neighbors(std::size_t begin, std::size_t end, ParticleNeighborhoods& found,
                        std::size_t most = std::numeric_limits<std::size_t>::max()) const;

private:
    static constexpr std::size_t kWidth = 8;
    using Eight = std::array<float, kWidth>;

    /// What is missing in the last one lies at infinity and has no reach.
    struct alignas(16) Leaf {
        Eight x, y, z, reach;
    };
    /// Boxes of eight children, and how far any particle in them reaches.
    struct alignas(16) Node {
        std::array<Eight, 3> low, high;
        Eight reach;
    };

    bool append_near_leaves(std::size_t leaf, float part, std::size_t most,
                            std::vector<std::uint32_t>& near) const;
    std::size_t pack_neighbors(std::size_t i, std::span<const std::uint32_t> near,
                               Index* found) const;
    /// So many that are nearest to particle i.
    void move_nearest_to_front(std::size_t i, std::size_t most, std::span<Index> found) const;
    Vec3f position(std::size_t i) const noexcept {
        const Leaf& leaf = leaves_[i / kWidth];
        return {leaf.x[i % kWidth], leaf.y[i % kWidth], leaf.z[i % kWidth]};
    }

    std::size_t size_;
    std::vector<Leaf> leaves_;
    std::vector<std::vector<Node>> levels_;  ///< level 0 has the boxes of the leaves
};

}  // namespace stipple
