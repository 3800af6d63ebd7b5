#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace stipple {

/// A cube of 2^bits steps a side, on whose grid positions are integers.
struct OctreeCube {
    Vec3d low = Vec3d::Zero();  ///< its corner, in the unit of the input
    double step = 1;            ///< in the unit of the input, > 0
    unsigned bits = 30;         ///< 1..30

    double side() const noexcept { return step * static_cast<double>(1U << bits); }
};

struct SampledOctreeOptions {
    unsigned grid = 128;  ///< 2..256: an inner node keeps one point for each cell that it cuts its
                          ///< cube into along each axis
    std::uint32_t max_points = 20'000;  ///< of a leaf, >= 1
    unsigned max_depth = 21;            ///< of a leaf that has more; the root has depth 0
};

/// An additive octree: every point stands in one node, and the nodes down to any depth are an even
/// subset. A node with more than `max_points` below it keeps the point of each cell of its grid
/// that is nearest to the middle of the cell; the rest goes to its children. As Potree 1 samples
/// (Schütz, Potree: Rendering Large Point Clouds in Web Browsers, 2016).
class SampledOctree {
public:
    using Position = std::array<std::int32_t, 3>;

    struct Node {
        std::uint32_t first = 0, count = 0;  ///< of its own points, in `order`
        unsigned depth = 0;
        Position place{};  ///< of its cube, in cubes of its size; as in the keys of COPC and EPT
        /// None: -1. By their bits x, y, z, x the highest, as Potree numbers them.
        std::array<std::int32_t, 8> children{-1, -1, -1, -1, -1, -1, -1, -1};
    };

    /// @param cloud  finite positions; those outside of the cube count as on its border.
    /// @throws Error(InvalidArgument) for a cloud without points or options out of range.
    /// O(N log N), in part parallel; the same for any number of threads. 16
    /// bytes a point, and as many while it is made.
    SampledOctree(const PointCloud& cloud, const OctreeCube& cube,
                  const SampledOctreeOptions& options = {}, const RunContext& context = {});

    const OctreeCube& cube() const noexcept { return cube_; }
    /// Each before those below it; the root is the first.
    std::span<const Node> nodes() const noexcept { return nodes_; }
    /// The numbers of the points, node by node, each node's along a curve; and where they are on
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
