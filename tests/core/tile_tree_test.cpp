#include "pyramid/tile_tree.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>
#include <vector>

namespace stipple {
namespace {

TEST(TileTree, CutsWhereManyPointsShareACoordinate) {
    std::vector<Vec3f> points(5'000, Vec3f::Zero());
    for (std::size_t i = 4'000; i < points.size(); ++i)
        points[i].x() = static_cast<float>(i - 3'999);
    TileTree tree;
    std::size_t all = 0;
    for (const TileTree::Part& part : tree.add_level(points, {.points = 1'000}, {})) {
        const bool coincide = part.points.front() < 4'000;
        EXPECT_LE(part.points.size(), coincide ? 4'000U : 1'000U);
        all += part.points.size();
    }
    EXPECT_EQ(all, points.size());
}

TEST(TileTree, FindsThePartInWhoseCellAPlaceLies) {
    const PointCloud cloud = test::cube(5'000);
    TileTree tree;
    const auto parts = tree.add_level(cloud.positions, {.points = 500}, {});
    for (std::uint32_t part = 0; part < parts.size(); ++part)
        for (const Index i : parts[part].points) EXPECT_EQ(tree.part_at(cloud.positions[i]), part);
}

TEST(TileTree, TellsThatALevelHasNothingWhereTheOneBeforeHad) {
    const std::vector<Vec3f> both = {{0, 0, 0}, {1, 0, 0}}, one = {{1, 0, 0}};
    TileTree tree;
    ASSERT_EQ(tree.add_level(both, {.points = 1}, {}).size(), 2U);
    const auto parts = tree.add_level(one, {.points = 1}, {});
    ASSERT_EQ(parts.size(), 1U);
    EXPECT_EQ(parts[0].parent, 1U);
    EXPECT_EQ(tree.part_at(both[0]), TileTree::kNone);
    EXPECT_EQ(tree.part_at(both[1]), 0U);
}

}  // namespace
}  // namespace stipple
