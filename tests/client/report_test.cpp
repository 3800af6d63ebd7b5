#include "cli/report.hpp"

#include <gtest/gtest.h>

namespace stipple::cli {
namespace {

proto::MeasuredBound whole_within(double bound) {
    proto::MeasuredBound measured;
    measured.max_error = bound;
    measured.whole = true;
    return measured;
}

TEST(BoundLine, SaysWhereFewerPointsAreTooFar) {
    proto::MeasuredBound bound = whole_within(0.3);
    bound.too_far = {30'000, {0.5, -2, 1234567.25}, 0.4321};
    EXPECT_EQ(bound_line(bound, 60'000, {}),
              "kept all 60,000 points: with 30,000 the surface at (0.5, -2, 1234567.25) is off by "
              "0.432, above the bound 0.3; `stipple curve` shows the errors of other counts");
}

TEST(BoundLine, SaysThatABoundIsBelowTheNoise) {
    proto::MeasuredBound bound = whole_within(0.3);
    bound.too_far = {60'000, {1, 2, 3}, 0.5};
    EXPECT_EQ(
        bound_line(bound, 60'000, {}),
        "kept all 60,000 points: the one at (1, 2, 3) is off their own surface by 0.5, above the "
        "bound 0.3: the bound is below the noise");
}

TEST(BoundLine, SaysThatNoSmallerCloudWasFoundWhereNothingElseIsKnown) {
    EXPECT_EQ(bound_line(whole_within(0.3), 1, {}),
              "kept all 1 point: no smaller cloud was found within 0.3");
}

TEST(LossesLine, CountsOutliersBesideWhatElseWasRemoved) {
    proto::CloudStatistics source;
    source.duplicates = 1;
    source.outliers = 12;
    EXPECT_EQ(losses_line(source, {}), "removed 1 duplicate, 12 outliers");
    source = {};
    source.outliers = 0;
    EXPECT_EQ(losses_line(source, {}), "removed 0 outliers");
}

TEST(DracoLine, SaysWhatPositionsAreRelativeToAndHowFarTheyWereRounded) {
    EXPECT_EQ(draco_line({500'000, 5'000'000, 100.5}, 0.002, {}),
              "coordinates relative to 500000 5000000 100.5 | rounded by at most 0.001 per axis");
    EXPECT_EQ(draco_line(Vec3d::Zero(), 0.5, {}), "rounded by at most 0.25 per axis");
    EXPECT_EQ(draco_line(Vec3d::Zero(), 0, {}), "");
}

TEST(BoundLine, SaysHowManyPointsAreNotCounted) {
    proto::MeasuredBound bound{.max_error = 0.3,
                               .forward = 0.2,
                               .backward = 0.1,
                               .samples = 200,
                               .sampling = ErrorSampling::Surface,
                               .tries = 7};
    EXPECT_TRUE(bound_line(bound, 10, {}).ends_with("7 tries"));
    bound.points_off_surface = 3;
    EXPECT_TRUE(
        bound_line(bound, 10, {})
            .ends_with("not counted: 3 points of the input, farther than that from its surface"));
}

TEST(BoundLine, SaysThatTheSearchEndedEarly) {
    proto::MeasuredBound bound{.max_error = 0.3, .tries = 7, .ended_early = true};
    EXPECT_TRUE(bound_line(bound, 10, {}).ends_with("fewer points may also hold"));
    bound = whole_within(0.3);
    bound.ended_early = true;
    const std::string line = bound_line(bound, 10, {});
    EXPECT_TRUE(line.starts_with("kept all 10 points: no smaller cloud was found")) << line;
    EXPECT_TRUE(line.ends_with("fewer points may also hold")) << line;
}

TEST(ErrorLine, HasNoFiguresWhereNothingWasSimplifiedAway) {
    proto::ErrorFigures figures;
    EXPECT_EQ(error_line(figures, {}), "error: none, no points were removed");
    figures.error.diagonal = 10;
    figures.error.forward.mean = 0.01;
    figures.error.forward.max = 0.5;
    figures.error.forward.samples = 200;
    const std::string line = error_line(figures, {});
    EXPECT_TRUE(line.starts_with("error: mean 0.01 (0.1 %)")) << line;
    EXPECT_TRUE(line.ends_with("max at least 0.5 (5 %) of the diagonal, at 200 samples")) << line;
}

TEST(ErrorLine, SaysHowSureTheMeanIsAndHowNearPointsAre) {
    proto::ErrorFigures figures;
    figures.error.diagonal = 10;
    DirectedError& forward = figures.error.forward;
    forward.mean = 0.0123;
    forward.mean_confidence = 0.00234;
    forward.samples = 200;
    forward.cover_radius = 0.75;
    const std::string line = error_line(figures, {.unicode = true});
    EXPECT_TRUE(line.starts_with("error: mean 0.0123 ± 0.0023 (0.123 %) · ")) << line;
    EXPECT_TRUE(line.ends_with("at 200 samples, each within 0.75 of a point")) << line;
}

}  // namespace
}  // namespace stipple::cli
