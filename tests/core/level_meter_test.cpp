#include "level_meter.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>

namespace stipple {
namespace {

TEST(MeasuredLevel, IsSearchedForOnePointOfEachPlaceWhereMostHaveOthers) {
    std::vector<Vec3f> crowd(900, Vec3f(1, 2, 3));
    crowd.resize(1'000, Vec3f(4, 5, 6));
    const MeasuredLevel crowded(std::vector<Vec3f>(crowd), {});
    EXPECT_EQ(crowded.points, crowd);
    ASSERT_EQ(crowded.samples().size(), 2U);
    EXPECT_EQ(crowded.tree->size(), 2U);

    std::vector<Vec3f> few = test::sphere(1'000).positions;
    few[1] = few[0];
    const MeasuredLevel even(std::move(few), {});
    EXPECT_EQ(even.samples().size(), 1'000U);
}

}  // namespace
}  // namespace stipple
