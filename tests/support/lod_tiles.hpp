#pragma once

#include "stipple/lod_tiles.hpp"
#include "stipple/point_cloud.hpp"

#include <cstddef>
#include <numeric>
#include <utility>
#include <variant>
#include <vector>

namespace stipple::test {

/// A cloud whose points know their numbers.
inline PointCloud numbered(PointCloud cloud) {
    std::vector<float> numbers(cloud.size());
    std::iota(numbers.begin(), numbers.end(), 0.0F);
    set_attribute(cloud, {"number", std::move(numbers), 1, Reduction::Nearest});
    return cloud;
}

inline std::vector<std::size_t> numbers_of(const PointCloud& tile) {
    const auto& values = std::get<std::vector<float>>(find_attribute(tile, "number")->values);
    return {values.begin(), values.end()};
}

/// The tiles of a pyramid that has the whole cloud as its only level.
inline std::vector<LodTile> tiles_of(const PointCloud& cloud, const LodTileOptions& options,
                                     const RunContext& context = {}) {
    return LodTiler(cloud, options, context).add_level(cloud, true, context);
}

}  // namespace stipple::test
