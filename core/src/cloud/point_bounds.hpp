#pragma once

#include "base/parallel_for.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace stipple {

/// The `bounds` of a cloud whose coordinates are all finite, else nothing.
std::optional<Aabb> finite_bounds(const PointCloud& cloud);

/// The box around what `place` makes of each point: a vector of any type and fixed length. Empty
/// for no points. O(N), on the threads of `context`.
template <typename Place>
auto bounds_of(std::span<const Vec3f> points, const RunContext& context, Place&& place) {
    using Placed = decltype(place(points.front()));
    using Box = Eigen::AlignedBox<typename Placed::Scalar, Placed::RowsAtCompileTime>;
    constexpr std::size_t kBlock = 65'536;  // points of which a thread finds the bounds
    std::vector<Box> boxes((points.size() + kBlock - 1) / kBlock);
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        Box& box = boxes[begin / kBlock];
        for (std::size_t i = begin; i < end; ++i) box.extend(place(points[i]));
    });
    Box all;
    for (const Box& box : boxes) all.extend(box);
    return all;
}

}  // namespace stipple
