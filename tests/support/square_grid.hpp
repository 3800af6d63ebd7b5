#pragma once

#include "stipple/point_cloud.hpp"

#include <cstddef>

namespace stipple::test {

/// A square grid of the unit square.
inline PointCloud square_grid(std::size_t side) {
    PointCloud cloud;
    for (std::size_t i = 0; i < side * side; ++i)
        cloud.positions.emplace_back(static_cast<float>(i % side) / static_cast<float>(side - 1),
                                     static_cast<float>(i / side) / static_cast<float>(side - 1),
                                     0.0F);
    return cloud;
}

}  // namespace stipple::test
