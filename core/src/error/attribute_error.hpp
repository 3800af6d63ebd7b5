#pragma once

#include "neighbors/point_tree.hpp"
#include "stipple/surface_error.hpp"

#include <span>
#include <vector>

namespace stipple {

/// A cloud whose attributes are compared, and the tree of its points.
struct AttributedSurface {
    const PointCloud& cloud;
    const PointTree& tree;
};

/// How much every attribute that both have differs between places on one surface and their feet on
/// the other: colour, normal, then the others in the order of `from`. Between points, values are
/// weighted means of the `k` nearest with h = r / 3, colours in linear light; those that are
/// reduced to the nearest or most frequent value (labels) are that of the nearest point.
std::vector<AttributeError> attribute_errors(const AttributedSurface& from,
                                             const AttributedSurface& to,
                                             std::span<const Vec3f> places,
                                             std::span<const Vec3f> feet,
                                             std::span<const float> areas, unsigned k,
                                             const RunContext& context);

}  // namespace stipple
