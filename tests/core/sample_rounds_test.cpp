#include "error/sample_rounds.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>

#include <algorithm>

// Places in rounds (core/src/error/sample_rounds.hpp), and how they are drawn
// (core/src/error/error_samples.hpp).

namespace stipple {
namespace {

TEST(SampleRounds, LieAlongTheCurveHoweverManyWereAdded) {
    const PointCloud cloud = test::sphere(50'000);
    const PointTree tree(cloud.positions, PointTree::Leaves::Quick, {});
    const LonePoints points(cloud.positions, tree);
    SampleRounds rounds;
    unsigned so_far = 0;
    for (const unsigned more : {2U, 3U, 1U}) {
        const std::uint64_t count = more * SampleRounds::kRound;
        rounds.add(take_points_by_area(points, count, so_far, {}), more);
        so_far += more;
        for (unsigned first = 1; first <= so_far; ++first) {
            const std::vector<Index> places = rounds.of_first(first);
            EXPECT_EQ(places.size(), first * SampleRounds::kRound);
            EXPECT_TRUE(std::ranges::is_sorted(
                places, {}, [&](Index place) { return rounds.all().numbers[place]; }));
        }
    }
    EXPECT_EQ(rounds.rounds(), 6U);
    // Those of fewer rounds are among those of more.
    std::vector<Index> few = rounds.of_first(3), many = rounds.of_first(4);
    std::ranges::sort(few);
    std::ranges::sort(many);
    EXPECT_TRUE(std::ranges::includes(many, few));
}

TEST(TakePointsByArea, KnowsThePartOfAFewThatLieFarApart) {
    PointCloud cloud =
        test::sphere(60'000);  // dense; few of the points have two thirds of the area
    for (const Vec3f& p : test::sphere(2'000).positions) cloud.positions.push_back(1.5F * p);
    const PointTree tree(cloud.positions, PointTree::Leaves::Quick, {});
    const LonePoints points(cloud.positions, tree);
    const auto part_outside = [](const ErrorSamples& samples) {
        double outside = 0, all = 0;
        for (std::size_t i = 0; i < samples.size(); ++i) {
            all += samples.areas[i];
            if (samples.positions[i].norm() > 1.25F) outside += samples.areas[i];
        }
        return outside / all;
    };
    const double part = part_outside(take_points(points, tree.size(), 0, {}));
    ASSERT_GT(part, 0.5);
    for (std::uint64_t seed = 0; seed < 20; ++seed)
        EXPECT_NEAR(part_outside(take_points_by_area(points, 2'000, seed, {})), part, 0.08) << seed;
}

}  // namespace
}  // namespace stipple
