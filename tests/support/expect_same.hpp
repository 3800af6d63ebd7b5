#pragma once

#include "stipple/point_cloud.hpp"

#include <gtest/gtest.h>
#include <cstddef>

namespace stipple::test {

/// Expects the same points with all they have, in the same order.
inline void expect_same(const PointCloud& a, const PointCloud& b) {
    EXPECT_EQ(a.positions, b.positions);
    EXPECT_EQ(a.normals, b.normals);
    EXPECT_EQ(a.colors, b.colors);
    ASSERT_EQ(a.attributes.size(), b.attributes.size());
    for (std::size_t i = 0; i < a.attributes.size(); ++i)
        EXPECT_EQ(a.attributes[i].values, b.attributes[i].values);
}

}  // namespace stipple::test
