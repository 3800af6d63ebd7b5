#include "stipple/sampled_octree.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "cloud/grid_step.hpp"
#include "cloud/hilbert_order.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

namespace stipple {

namespace {

using Position = SampledOctree::Position;

void check(const PointCloud& cloud, const SampledOctreeOptions& options) {
    if (cloud.empty()) refuse("the cloud has no points: expected at least 1");
    require(options.grid >= 2 && options.grid <= 256, "grid", options.grid, "2..256");
    if (options.max_points == 0) refuse("max_points 0: expected at least 1");
}

/// In the order of `numbers`.
std::vector<Position> on_grid(const PointCloud& cloud, std::span<const Index> numbers,
                              const OctreeCube& cube, const RunContext& context) {
    constexpr std::size_t kBlock = 16'384;
    auto positions = made_in_blocks<std::vector<Position>>(numbers.size(), context);
    const Vec3d shift = cloud.origin - cube.low;
    const double most = static_cast<double>((1U << cube.bits) - 1);
    parallel_for_blocks(numbers.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const Vec3d p = (cloud.positions[numbers[i]].cast<double>() + shift) / cube.step;
            for (int axis = 0; axis < 3; ++axis)
                positions[i][axis] =
                    static_cast<std::int32_t>(std::clamp(p[axis], 0.0, most) + 0.5);
        }
    });
    return positions;
}

}  // namespace

/// Numbers points by their places along the curve, so that those of a node lie together.
class SampledOctree::Builder {
public:
    Builder(std::span<const Position> positions, const OctreeCube& cube,
            const SampledOctreeOptions& options, const RunContext& context)
        : positions_(positions),
          bits_(cube.bits),
          max_depth_(std::min(options.max_depth, cube.bits)),
          max_points_(options.max_points),
          grid_(options.grid),
          best_(std::size_t{1} * grid_ * grid_ * grid_, kNone),
          context_(context) {
        std::vector<Index> all(positions.size());
        std::iota(all.begin(), all.end(), Index{0});
        reserve_in_blocks(order, all.size(), context);
        build(std::move(all), 0, {});
    }

    std::vector<Node> nodes;
    std::vector<Index> order;

private:
    static constexpr Index kNone = ~Index{0};
    static constexpr std::size_t kBetweenChecks = 65'536;

    std::int32_t build(std::vector<Index>&& points, unsigned depth, const Position& place) {
        context_.throw_if_stopped();
        const std::size_t number = nodes.size();
        const bool is_leaf = points.size() <= max_points_ || depth == max_depth_;
        const std::size_t kept = is_leaf ? points.size() : sample(points, depth);
        nodes.push_back({.first = static_cast<std::uint32_t>(order.size()),
                         .count = static_cast<std::uint32_t>(kept),
                         .depth = depth,
                         .place = place});
        const auto own_end = points.begin() + static_cast<std::ptrdiff_t>(kept);
        order.insert(order.end(), points.begin(), own_end);

        std::array<std::vector<Index>, 8> parts;
        for (auto i = own_end; i != points.end(); ++i) parts[octant(*i, depth)].push_back(*i);
        std::vector<Index>().swap(points);
        for (unsigned c = 0; c < parts.size(); ++c) {
            if (parts[c].empty()) continue;
            Position below;
            for (int axis = 0; axis < 3; ++axis)
                below[axis] = 2 * place[axis] + static_cast<std::int32_t>((c >> (2 - axis)) & 1U);
            const std::int32_t child = build(std::move(parts[c]), depth + 1, below);
            nodes[number].children[c] = child;
        }
        return static_cast<std::int32_t>(number);
    }

    unsigned octant(Index point, unsigned depth) const noexcept {
        unsigned octant = 0;
        for (const std::int32_t x : positions_[point])
            octant = 2 * octant + ((static_cast<unsigned>(x) >> (bits_ - 1 - depth)) & 1U);
        return octant;
    }

    /// Moves the points that the node keeps to the front, the rest behind them, both in order.
    std::size_t sample(std::vector<Index>& points, unsigned depth) {
        std::vector<std::uint32_t> cells;
        cells.reserve(points.size());
        for (const Index point : points) {
            if (cells.size() % kBetweenChecks == 0) context_.throw_if_stopped();
            cells.push_back(cell_of(point, depth));
            Index& best = best_[cells.back()];
            if (best == kNone || off_center(point, depth) < off_center(best, depth)) best = point;
        }
        std::vector<Index> rest;
        std::size_t kept = 0;
        for (std::size_t i = 0; i < points.size(); ++i) {
            if (best_[cells[i]] == points[i])
                points[kept++] = points[i];
            else
                rest.push_back(points[i]);
        }
        std::ranges::copy(rest, points.begin() + static_cast<std::ptrdiff_t>(kept));
        for (const std::uint32_t cell : cells) best_[cell] = kNone;
        return kept;
    }

    /// Where a coordinate is in the cube of its node, in steps.
    std::uint64_t within(std::int32_t x, unsigned depth) const noexcept {
        return static_cast<std::uint32_t>(x) & ((1U << (bits_ - depth)) - 1);
    }

    std::uint32_t cell_of(Index point, unsigned depth) const noexcept {
        std::uint64_t cell = 0;
        for (const std::int32_t x : positions_[point])
            cell = cell * grid_ + (within(x, depth) * grid_ >> (bits_ - depth));
        return static_cast<std::uint32_t>(cell);
    }

    /// The squared distance to the middle of the cell, in parts of a step: cells are `grid` of
    /// them for each step of the cube's side.
    double off_center(Index point, unsigned depth) const noexcept {
        const std::uint64_t side = std::uint64_t{1} << (bits_ - depth);
        double sum = 0;
        for (const std::int32_t x : positions_[point]) {
            const std::uint64_t twice_in_cell = (2 * within(x, depth) + 1) * grid_ % (2 * side);
            const double off = static_cast<double>(twice_in_cell) - static_cast<double>(side);
            sum += off * off;
        }
        return sum;
    }

    std::span<const Position> positions_;
    unsigned bits_, max_depth_;
    std::uint32_t max_points_, grid_;
    std::vector<Index> best_;  ///< of each cell of a node's grid, while it is sampled
    const RunContext& context_;
};

SampledOctree::SampledOctree(const PointCloud& cloud, const OctreeCube& cube,
                             const SampledOctreeOptions& options, const RunContext& context)
    : cube_(cube) {
    check(cloud, options);
    require(makes_steps(cube.step), "step of the cube", cube.step, "a finite number above 0");
    require(cube.bits >= 1 && cube.bits <= 30, "bits of the cube", cube.bits, "1..30");
    const std::vector<Index> along_curve = hilbert_order(cloud.positions, context);
    const std::vector<Position> positions = on_grid(cloud, along_curve, cube, context);
    Builder built(positions, cube, options, context);
    nodes_ = std::move(built.nodes);
    order_ = std::move(built.order);
    reserve_in_blocks(positions_, order_.size(), context);
    for (Index& i : order_) {
        positions_.push_back(positions[i]);
        i = along_curve[i];
    }
}

}  // namespace stipple
