#pragma once

#include "error/foot_finder.hpp"
#include "neighbors/point_tree.hpp"
#include "stipple/run_context.hpp"

#include <utility>
#include <vector>

namespace stipple {

/// The surface of points in the coordinates of an `ErrorFrame`.
struct FramedSurface {
    std::vector<Vec3f> points;
    PointTree tree;
    FootFinder finder;

    FramedSurface(std::vector<Vec3f>&& points_, PointTree::Leaves leaves,
                  const FootFinder::Options& options, const RunContext& context)
        : points(std::move(points_)),
          tree(points, leaves, context),
          finder(points, tree, options) {}
    FramedSurface(const FramedSurface&) = delete;
    FramedSurface& operator=(const FramedSurface&) = delete;
};

}  // namespace stipple
