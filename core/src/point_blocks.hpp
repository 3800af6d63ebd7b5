#pragma once

#include "float4.hpp"
#include "samples.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <array>
#include <bit>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace stipple {

/// A power of two that brings coordinates of the extent of these points near 1, so that no square
/// of a difference over- or underflows.
float scale_near_one(std::span<const Vec3f> points);

/// Points in blocks of a few neighbours that lie together in memory, under a tree of boxes, eight
/// to a node: for queries in which a point may no longer take part.
///
/// The blocks are the leaves of a binary partition at the middle of the longest side, so that they
/// follow any density and an outlier costs nothing.
class PointBlocks {
public:
    static constexpr std::size_t kMostInBlock = 16;

    /// Finite points, at least one. Their coordinates are multiplied by `scale`.
    /// O(N log N), parallel; 36 bytes a point.
    PointBlocks(std::span<const Vec3f> points, float scale, const RunContext& context);

    std::size_t size() const noexcept { return size_; }
    /// The points, block by block.
    SampleSpan samples() const noexcept { return storage_.all().part(0, size_); }

    /// Leaves the sample at `place` out of what `find` calls free.
    void take(Index place) noexcept { taken_[place] = std::numeric_limits<float>::infinity(); }
    bool is_taken(Index place) const noexcept { return taken_[place] > 0; }

    /// Calls visit(begin, end) for the blocks, as ranges of samples, of which a part may be within
    /// the root of `radius_sq` (finite) of q, until it returns false.
    template <typename Visit>
    void find(const Vec3f& q, float radius_sq, Visit&& visit) const {
        visit_node(levels_.size() - 1, 0, q, radius_sq, visit);
    }

    /// Of each sample 0, or infinity when it is taken; as the coordinates, four can be read from any
    /// place, also from the last.
    const float* taken() const noexcept { return taken_.data(); }

private:
    struct Box {
        Vec3f low, high;
    };
    /// The boxes of eight children; one that is missing is infinitely far from everything.
    struct alignas(32) Node {
        std::array<std::array<float, 8>, 3> low, high;

        unsigned children_within(const Vec3f& q, float radius_sq) const noexcept {
            unsigned bits = 0;
            for (unsigned half = 0; half < 2; ++half) {
                Float4 distance_sq{};
                for (std::size_t axis = 0; axis < 3; ++axis) {
                    const float at = q[static_cast<Eigen::Index>(axis)];
                    const Float4 below = load(&low[axis][4 * half]) - at,
                                 above = at - load(&high[axis][4 * half]);
                    const Float4 outside = below > above ? below : above;
                    const Float4 gap = outside > 0.0F ? outside : Float4{};
                    distance_sq += gap * gap;
                }
                bits |= lane_bits(distance_sq <= radius_sq) << (4 * half);
            }
            return bits;
        }
    };
    struct Leaves {
        std::vector<Index> begins;
        std::vector<Box> boxes;
    };

    static Box box_of(const SampleSpan& samples) noexcept;
    void partition(std::size_t begin, std::size_t end, Leaves& leaves, const RunContext& context);
    void stack_levels(std::vector<Box> boxes);

    template <typename Visit>
    bool visit_node(std::size_t level, std::size_t n, const Vec3f& q, float radius_sq,
                    Visit& visit) const {
        for (unsigned near = levels_[level][n].children_within(q, radius_sq); near != 0;
             near &= near - 1) {
            const std::size_t child = 8 * n + static_cast<std::size_t>(std::countr_zero(near));
            const bool go_on = level == 0 ? visit(begins_[child], begins_[child + 1])
                                          : visit_node(level - 1, child, q, radius_sq, visit);
            if (!go_on) return false;
        }
        return true;
    }

    std::size_t size_;
    Samples storage_;            ///< the samples, and as many places again for their partition
    std::vector<float> taken_;   ///< 0 or infinity; four more than there are samples
    std::vector<Index> begins_;  ///< of each block; one more for the end
    std::vector<std::vector<Node>> levels_;  ///< the boxes of the blocks, of eight of them, ...
};

}  // namespace stipple
