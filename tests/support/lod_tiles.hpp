#pragma once

#include "stipple/lod_tiles.hpp"
#include "stipple/point_cloud.hpp"

#include <gtest/gtest.h>
#include <cstddef>
#include <numeric>
#include <set>
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

/// Every point of the level in one tile, within half a step of where it was; no tile empty or
/// larger than allowed.
inline void expect_to_hold(const std::vector<LodTile>& tiles, const PointCloud& level,
                           const Vec3d& center, std::size_t most) {
    std::set<std::size_t> seen;
    for (const LodTile& tile : tiles) {
        ASSERT_GT(tile.step, 0);
        ASSERT_GE(tile.points, 1U);
        EXPECT_LE(tile.points, most);
        const PointCloud decoded = decode_tile(tile, center);
        ASSERT_EQ(decoded.size(), tile.points);
        const std::vector<std::size_t> numbers = numbers_of(decoded);
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            EXPECT_TRUE(seen.insert(numbers[i]).second) << "point " << numbers[i] << " twice";
            const Vec3d was = level.positions[numbers[i]].cast<double>() + level.origin;
            const Vec3d is = decoded.positions[i].cast<double>() + center;
            const double rounding = 1e-6 * (was - center).norm();
            ASSERT_LE((was - is).cwiseAbs().maxCoeff(), 0.5001 * tile.step + rounding);
        }
    }
    EXPECT_EQ(seen.size(), level.size());
}

}  // namespace stipple::test
