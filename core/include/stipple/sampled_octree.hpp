#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace stipple {

/// A cube of 2^bits steps per side, on whose grid positions are integers.
struct OctreeCube {
    Vec3d low = Vec3d::Zero();  ///< its minimum corner, in the unit of the input
    double step = 1;            ///< in the unit of the input, > 0
    unsigned bits = 30;         ///< 1..30

    double side() const noexcept { return step * static_cast<double>(1U << bits); }
};

struct SampledOctreeOptions {
    unsigned grid = 128;  ///< 2..256: an inner node keeps one point per cell of a grid with this
                          ///< many cells per axis
    std::uint32_t max_points = 20'000;  ///< per leaf, >= 1
    unsigned max_depth = 21;            ///< of a leaf with more points; the root has depth 0
};

/// An additive octree: every point belongs to one node, and the nodes down to any depth are an even
/// subset. A node with more than `max_points` below it keeps the point of each cell of its grid
/// that is nearest to the centre of the cell; the rest goes to its children. This is the sampling
/// of Potree 1 (Schütz, Potree: Rendering Large Point Clouds in Web Browsers, 2016).
class SampledOctree {
public:
    using Position = std::array<std::int32_t, 3>;

    struct Node {
        std::uint32_t first = 0, count = 0;  ///< of its own points, in `order`
        unsigned depth = 0;
        Position place{};  ///< of its cube, in cubes of its size, as in the keys of COPC and EPT
        /// -1: none. Indexed by the bits x, y, z, x the highest, as in Potree.
        std::array<std::int32_t, 8> children{-1, -1, -1, -1, -1, -1, -1, -1};
    };

    /// @param cloud  finite positions; those outside of the cube are clamped to its border.
    /// @throws Error(InvalidArgument) for a cloud without points or options out of range.
    ///
    /// O(N log N), partly parallel; the same for any number of threads. 16 bytes per point, and as
    /// many during construction.
    SampledOctree(const PointCloud& cloud, const OctreeCube& cube,
                  const SampledOctreeOptions& options = {}, const RunContext& context = {});

    const OctreeCube& cube() const noexcept { return cube_; }
    /// Each node before its descendants; the root is the first.
    std::span<const Node> nodes() const noexcept { return nodes_; }
    /// The numbers of the points, node by node, within a node along a curve; and their places on
    /// the grid of the cube.
    std::span<const Index> order() const noexcept { return order_; }
    std::span<const Position> positions() const noexcept { return positions_; }

private:
    class Builder;

    OctreeCube cube_;
    std::vector<Node> nodes_;
    std::vector<Index> order_;
    std::vector<Position> positions_;
};

}  // namespace stipple
