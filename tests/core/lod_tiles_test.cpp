#include "stipple/lod_tiles.hpp"

#include "stipple/error.hpp"
#include "stipple/lod_pyramid.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/surface_error.hpp"
#include "support/expect_error.hpp"
#include "support/lod_tiles.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <numeric>
#include <set>
#include <string_view>
#include <utility>

namespace stipple {
namespace {

using test::numbered, test::numbers_of, test::tiles_of;

PointCloud repeated(const Vec3f& p, std::size_t n) {
    PointCloud cloud;
    cloud.positions.assign(n, p);
    return cloud;
}

PointCloud two_clusters(std::size_t n, float apart) {
    PointCloud cloud = test::cube(n);
    for (std::size_t i = 0; i < n; i += 2) cloud.positions[i].x() += apart;
    return cloud;
}

/// Every point of the level in one tile, within half a step of where it was; no tile empty or
/// larger than allowed.
void expect_to_hold(const std::vector<LodTile>& tiles, const PointCloud& level, const Vec3d& center,
                    std::size_t most) {
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

struct Shape {
    const char* name;
    std::function<PointCloud()> make;
    std::size_t least_tiles;  ///< of at most 1,000 points
};

class LodTilesOfShapes : public testing::TestWithParam<Shape> {};

TEST_P(LodTilesOfShapes, HoldEveryPointOnceWithinHalfAStep) {
    const PointCloud cloud = numbered(GetParam().make());
    LodTileOptions options{.max_points = 1'000, .attributes = true};
    LodTiler tiler(cloud, options);
    const std::vector<LodTile> tiles = tiler.add_level(cloud, true);
    const Aabb box = bounds(cloud);
    EXPECT_EQ(tiler.center(), 0.5 * (box.min + box.max));  // what every reader takes it for
    const bool coincide = box.diagonal() == 0;
    expect_to_hold(tiles, cloud, tiler.center(), coincide ? cloud.size() : options.max_points);
    EXPECT_GE(tiles.size(), GetParam().least_tiles);
    for (const LodTile& tile : tiles) {
        EXPECT_TRUE(std::isfinite(tile.error.mean) && std::isfinite(tile.error.max));
        EXPECT_TRUE(std::isfinite(tile.spacing) && std::isfinite(tile.cover_radius));
    }
}

INSTANTIATE_TEST_SUITE_P(
    , LodTilesOfShapes,
    testing::Values(Shape{"OnePoint",
                          [] {
                              return repeated({5, 6, 7}, 1);
                          },
                          1},
                    Shape{"ManyPointsInOnePlace",
                          [] {
                              return repeated({5, 6, 7}, 5'000);
                          },
                          1},
                    Shape{"AHundredPoints", [] { return test::sphere(100); }, 1},
                    Shape{"ALine", [] { return test::line(5'000); }, 5},
                    Shape{"APlane", [] { return test::plane(5'000); }, 5},
                    Shape{"ASphere", [] { return test::sphere(20'000); }, 20},
                    Shape{"TwoClusters", [] { return two_clusters(1'000, 100); }, 1},
                    Shape{"TwoClustersFarApart", [] { return two_clusters(1'000, 1e6F); }, 2},
                    Shape{"ASphereAndAPointFarOff",
                          [] {
                              PointCloud cloud = test::sphere(20'000);
                              cloud.positions.push_back({1e3F, 0, 0});
                              return cloud;
                          },
                          21}),
    [](const auto& shape) { return shape.param.name; });

TEST(LodTiles, AreAtLeastHalfFullWhereALevelIsCutOnItsOwn) {
    for (const LodTile& tile : tiles_of(test::sphere(20'000), {.max_points = 1'000}))
        EXPECT_GE(tile.points, 500U);
}

TEST(LodTiles, OfClustersFarApartKeepTheStepThatWasAskedFor) {
    // 2^17 steps apart: more than 16 bits can tell apart in one tile.
    const auto tiles = tiles_of(two_clusters(1'000, 131'072), {.precision = 0.5});
    ASSERT_EQ(tiles.size(), 2U);
    for (const LodTile& tile : tiles) EXPECT_EQ(tile.step, 1.0);
}

TEST(LodTiles, OfACloudWithAPointFarOffTellItsOtherPointsApart) {
    // Whether that point is the first of the curve, where gaps are looked at, or the last.
    for (const float far : {-3e3F, 3e3F}) {
        PointCloud cloud = test::plane(20'000);
        const double spacing = mean_spacing(cloud.positions);
        cloud.positions.push_back({far, 0, 0});
        for (const LodTile& tile : tiles_of(cloud, {})) EXPECT_LT(tile.step, spacing);
    }
}

TEST(LodTiles, OfACloudWithAPointFarOffAreAsFineAsWithoutIt) {
    PointCloud cloud = test::plane(20'000);
    const double step = tiles_of(cloud, {}).front().step;
    for (const float far : {1e3F, 1e4F}) {
        PointCloud with_stray = cloud;
        with_stray.positions.push_back({far, 0, 0});
        for (const LodTile& tile : tiles_of(with_stray, {})) EXPECT_LE(tile.step, step);
    }
}

/// Of a cloud that was `numbered`: each axis of each point is where it was, within a precision.
void expect_within(double precision, std::vector<LodTile> tiles, const Vec3d& center,
                   const PointCloud& cloud) {
    for (LodTile& tile : tiles) {
        // From the tile's own place: from the middle of the bounds floats may tell less apart.
        const Vec3d place = center + std::exchange(tile.offset, Vec3d::Zero());
        const PointCloud decoded = decode_tile(tile);
        const std::vector<std::size_t> numbers = numbers_of(decoded);
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            const Vec3d was = cloud.positions[numbers[i]].cast<double>();
            const Vec3d is = place + decoded.positions[i].cast<double>();
            const double rounding = 1e-6 * was.norm();
            ASSERT_LE((was - is).cwiseAbs().maxCoeff(), precision + rounding);
        }
    }
}

TEST(LodTiles, OfTheFinestLevelKeepThePrecisionThatWasAskedFor) {
    constexpr double kPrecision = 1e-4;
    const PointCloud cloud = numbered(test::sphere(8'000));
    std::vector<Index> some(2'000);
    std::iota(some.begin(), some.end(), 0U);
    const PointCloud level = subset(cloud, some);
    LodTiler tiler(cloud, {.precision = kPrecision, .finest_points = 2'000, .attributes = true});
    expect_within(kPrecision, tiler.add_level(level, false), tiler.center(), cloud);
}

TEST(LodTiles, KeepThePrecisionThatWasAskedForThoughAPointIsFarOff) {
    constexpr double kPrecision = 0.001;  // 26 bits of the whole
    PointCloud cloud = test::sphere(20'000);
    cloud.positions.push_back({1e5F, 0, 0});
    cloud = numbered(std::move(cloud));
    LodTiler tiler(cloud, {.precision = kPrecision, .attributes = true});
    expect_within(kPrecision, tiler.add_level(cloud, true), tiler.center(), cloud);
}

TEST(LodTiles, TellTheErrorOfTheSurfaceThoughAPointIsFarOff) {
    PointCloud cloud = test::sphere(50'000);
    std::vector<Index> some(5'000);
    for (std::size_t i = 0; i < some.size(); ++i) some[i] = static_cast<Index>(10 * i);
    const auto mean_error = [&](const PointCloud& source) {
        LodTiler tiler(source, {.position_bits = 20, .tolerance = 0});
        tiler.add_level(subset(source, some), false);
        return tiler.figures().error.mean;
    };
    const double alone = mean_error(cloud);
    cloud.positions.push_back({0, 0, 1e3F});
    some.push_back(50'000);
    EXPECT_NEAR(mean_error(cloud) / alone, 1, 0.2);
}

TEST(LodTiles, TellTheSpacingOfMostThoughAPointIsVeryFarOff) {
    PointCloud cloud = test::sphere(50'000);
    std::vector<Index> some(5'000);
    for (std::size_t i = 0; i < some.size(); ++i) some[i] = static_cast<Index>(10 * i);
    cloud.positions.push_back({0, 0, 1e9F});
    some.push_back(50'000);
    LodTiler tiler(cloud, {.position_bits = 20});
    tiler.add_level(subset(cloud, some), false);
    EXPECT_LT(tiler.figures().spacing, 0.2);
}

TEST(LodTiles, OfOneTileHaveTheFiguresOfTheirLevel) {
    const PointCloud cloud = test::cube(5'000);
    LodTiler tiler(cloud, {});
    const std::vector<LodTile> tiles = tiler.add_level(cloud, true);
    ASSERT_EQ(tiles.size(), 1U);
    EXPECT_EQ(tiles[0].spacing, tiler.figures().spacing);
    EXPECT_EQ(tiles[0].error.mean, tiler.figures().error.mean);
}

TEST(LodTiles, AreRefusedWhereThereWouldBeTooMany) {
    const PointCloud cloud = test::plane(31'000);
    LodTiler tiler(cloud, {.max_points = 1, .errors = LodErrors::Rough});
    try {
        tiler.add_level(cloud, true);
        FAIL() << "as many tiles as points";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::TooLarge);
        EXPECT_NE(std::string(error.what()).find("max_points 1"), std::string::npos);
    }
}

TEST(LodTiles, OfALevelShareOneGrid) {
    const auto tiles = tiles_of(test::sphere(5'000), {.max_points = 1'000});
    for (const LodTile& tile : tiles) {
        EXPECT_EQ(tile.step, tiles.front().step);
        for (const double offset : tile.offset) {
            const double steps = offset / tile.step;
            EXPECT_NEAR(steps, std::round(steps), 1e-6);
        }
    }
}

TEST(LodTiles, AreTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = test::sphere(20'000, 0.01);
    const LodTileOptions options{.max_points = 1'000};
    const auto one = tiles_of(cloud, options, {.threads = 1});
    const auto eight = tiles_of(cloud, options, {.threads = 8});
    ASSERT_EQ(one.size(), eight.size());
    for (std::size_t t = 0; t < one.size(); ++t) {
        EXPECT_EQ(one[t].streams.front().bytes, eight[t].streams.front().bytes);
        EXPECT_EQ(one[t].error.mean, eight[t].error.mean);
        EXPECT_EQ(one[t].spacing, eight[t].spacing);
    }
}

class LodTilesOfLevels : public testing::Test {
protected:
    void SetUp() override {
        cloud_ = test::sphere(40'000, 0.002);
        build_lod_pyramid(cloud_, {.base_points = 2'000},
                          [&](LodLevel&& level) { levels_.push_back(std::move(level)); });
        tiler_ = std::make_unique<LodTiler>(cloud_, LodTileOptions{.max_points = 4'000});
        for (const LodLevel& level : levels_)
            tiles_.push_back(tiler_->add_level(level.cloud, level.cloud.size() == cloud_.size()));
    }

    PointCloud decoded(std::size_t level) const {
        PointCloud all;
        all.origin = tiler_->center();
        for (const LodTile& tile : tiles_[level]) {
            const PointCloud part = decode_tile(tile, tiler_->center());
            all.positions.insert(all.positions.end(), part.positions.begin(), part.positions.end());
        }
        return all;
    }

    PointCloud cloud_;
    std::vector<LodLevel> levels_;
    std::vector<std::vector<LodTile>> tiles_;
    std::unique_ptr<LodTiler> tiler_;
};

TEST_F(LodTilesOfLevels, HaveAParentInTheLevelAboveThemThatAllChildrenShareOut) {
    ASSERT_EQ(tiles_.size(), 4U);
    std::uint32_t first_above = 0, first = 0;
    for (std::size_t level = 0; level < tiles_.size(); ++level) {
        std::set<std::uint32_t> parents;
        for (const LodTile& tile : tiles_[level]) {
            EXPECT_EQ(tile.level, level);
            EXPECT_EQ(tile.parent.has_value(), level > 0);
            if (tile.parent) parents.insert(*tile.parent);
        }
        if (level > 0) {
            EXPECT_EQ(parents.size(), tiles_[level - 1].size());
            EXPECT_GE(*parents.begin(), first_above);
            EXPECT_LT(*parents.rbegin(), first);
        }
        first_above = first;
        first += static_cast<std::uint32_t>(tiles_[level].size());
    }
    EXPECT_EQ(tiles_[0].size(), 1U);
    EXPECT_GE(tiles_[3].size(), 10U);
}

TEST_F(LodTilesOfLevels, TellTheErrorOfWhatTheyDecodeTo) {
    for (std::size_t level = 0; level < tiles_.size(); ++level) {
        const SurfaceError measured = measure_error(cloud_, decoded(level));
        double mean = 0, max = 0;
        for (const LodTile& tile : tiles_[level]) {
            mean += tile.error.mean / static_cast<double>(tiles_[level].size());
            max = std::max(max, tile.error.max);
            EXPECT_LE(tile.error.p99, tile.error.max);
            EXPECT_LE(tile.error.mean, tile.error.p99);
        }
        EXPECT_NEAR(mean / measured.mean(), 1, 0.06) << level;
        EXPECT_LE(max, 1.3 * measured.forward.max) << level;
    }
}

TEST_F(LodTilesOfLevels, SayTheErrorOfTheWholeLevelToo) {
    LodTiler tiler(cloud_, {.max_points = 4'000});
    for (std::size_t level = 0; level < levels_.size(); ++level) {
        const bool whole = level + 1 == levels_.size();
        const auto tiles = tiler.add_level(levels_[level].cloud, whole);
        const LodFigures& all = tiler.figures();
        const double measured = measure_error(cloud_, decoded(level)).mean();
        EXPECT_NEAR(all.error.mean / measured, 1, 0.03) << level;
        EXPECT_LT(all.error.mean_confidence, 0.03 * all.error.mean) << level;
        double max = 0, cover = 0;
        std::uint64_t samples = 0;
        for (const LodTile& tile : tiles) {
            max = std::max(max, tile.error.max);
            cover = std::max(cover, tile.cover_radius);
            samples += tile.error.samples;
        }
        EXPECT_EQ(all.error.max, max);
        EXPECT_EQ(all.cover_radius, cover);
        EXPECT_EQ(all.error.samples, samples);
        EXPECT_NEAR(all.spacing / mean_spacing(decoded(level).positions), 1, 0.05) << level;
    }
}

TEST_F(LodTilesOfLevels, AreOfLevelsWhoseErrorIsSoonEstimated) {
    RunContext three;
    three.threads = 3;
    LodTiler tiler(cloud_, {.level_errors = true}), other(cloud_, {.level_errors = true}, three);
    for (std::size_t l = 0; l + 1 < levels_.size(); ++l) {
        const PointCloud& level = levels_[l].cloud;
        const SurfaceError measured = measure_error(cloud_, level);
        tiler.add_level(level, false);
        const SurfaceError error = tiler.level_error().value();
        EXPECT_EQ(error.forward.samples, 4096U);
        EXPECT_NEAR(error.mean() / measured.mean(), 1, 0.03) << l;
        EXPECT_NEAR(error.forward.p95 / measured.forward.p95, 1, 0.05) << l;
        EXPECT_LE(error.max(), 1.001 * measured.max());
        EXPECT_NEAR(error.backward.mean / measured.backward.mean, 1, 0.15) << l;
        EXPECT_EQ(error.diagonal, measured.diagonal);
        EXPECT_EQ(error.candidate_diagonal, measured.candidate_diagonal);

        other.add_level(level, false, three);
        EXPECT_EQ(other.level_error()->forward.rms, error.forward.rms);
        EXPECT_EQ(other.level_error()->backward.rms, error.backward.rms);
    }
    tiler.add_level(cloud_, true);
    EXPECT_EQ(tiler.level_error()->max(), 0);
    EXPECT_EQ(tiler.level_error()->diagonal, bounds(cloud_).diagonal());
    EXPECT_FALSE(tiler_->level_error());
}

TEST_F(LodTilesOfLevels, TakeTheFewestBitsThatKeepTheError) {
    for (std::size_t level = 0; level + 1 < tiles_.size(); ++level) {
        const double exact = measure_error(cloud_, levels_[level].cloud).mean();
        const double rounded = measure_error(cloud_, decoded(level)).mean();
        EXPECT_LT(rounded / exact, 1.02 + LodTileOptions{}.tolerance) << level;
        EXPECT_LT(tiles_[level].front().bits, tiles_.back().front().bits) << level;
    }
}

TEST_F(LodTilesOfLevels, TellSpacingAndCoverRadius) {
    const double spacing = mean_spacing(decoded(0).positions);
    EXPECT_NEAR(tiles_[0].front().spacing / spacing, 1, 0.1);
    double cover = 0;
    const NeighborSearch search(decoded(0).positions);
    for (const Vec3f& p : cloud_.positions) {
        Neighbor nearest;
        const Vec3d place = p.cast<double>() - tiler_->center();
        search.nearest(place.cast<float>(), {&nearest, 1});
        cover = std::max(cover, std::sqrt(static_cast<double>(nearest.distance_sq)));
    }
    EXPECT_LE(tiles_[0].front().cover_radius, cover * 1.000001);
    EXPECT_GE(tiles_[0].front().cover_radius, 0.8 * cover);
}

PointCloud level_of(const PointCloud& cloud, std::uint64_t points) {
    PointCloud level;
    build_lod_pyramid(cloud, {.sizes = {points}},
                      [&](LodLevel&& made) { level = std::move(made.cloud); });
    return level;
}

TEST(LodTiles, AreMeasuredAtMorePlacesWhereASmallPartDecidesTheError) {
    PointCloud cloud = test::plane(100'000);
    for (Vec3f& p : cloud.positions)
        if (p.x() < 0.1F && p.y() < 0.1F)
            p.z() = 0.01F * std::sin(800 * p.x()) * std::sin(800 * p.y());
    const PointCloud level = level_of(cloud, 4'000);
    LodTiler tiler(cloud, {});
    const auto once = tiler.add_level(level, false);
    EXPECT_GT(tiler.figures().error.samples, 32'768U);
    EXPECT_LE(tiler.figures().error.samples, 131'072U);
    tiler.restart();
    const auto again = tiler.add_level(level, false);
    EXPECT_EQ(again.front().error.mean, once.front().error.mean);
    EXPECT_EQ(again.front().error.samples, once.front().error.samples);
}

TEST(LodTiles, AreMeasuredAtNoMorePlacesThanItTakes) {
    const PointCloud cloud = test::sphere(100'000);
    LodTiler tiler(cloud, {.tolerance = 0});
    tiler.add_level(level_of(cloud, 4'000), false);
    EXPECT_EQ(tiler.figures().error.samples, 8'192U);
    EXPECT_LT(tiler.figures().error.mean_confidence, 0.0145 * tiler.figures().error.mean);
}

/// A pyramid of nested levels, its tiles, and what is there of each level when its tiles and all
/// above them are.
class AdditiveLodTiles : public testing::Test {
protected:
    void SetUp() override {
        cloud_ = numbered(test::sphere(8'000, 0.002));
        LodTiler tiler(cloud_, {.max_points = 1'000, .attributes = true, .additive = true});
        center_ = tiler.center();
        build_lod_pyramid(
            cloud_,
            {.base_points = 500, .simplification = {.method = Method::Iterative}, .nested = true},
            [&](LodLevel&& level) {
                const bool whole = level.cloud.size() == cloud_.size();
                tiles_.push_back(tiler.add_level(level.cloud, whole));
                figures_.push_back(tiler.figures());
                sizes_.push_back(level.cloud.size());
            });
    }

    PointCloud down_to(std::size_t level) const {
        PointCloud all;
        all.origin = center_;
        for (std::size_t above = 0; above <= level; ++above) {
            for (const LodTile& tile : tiles_[above]) {
                const PointCloud part = decode_tile(tile, center_);
                all.positions.insert(all.positions.end(), part.positions.begin(),
                                     part.positions.end());
            }
        }
        return all;
    }

    PointCloud cloud_;
    Vec3d center_;
    std::vector<std::vector<LodTile>> tiles_;
    std::vector<LodFigures> figures_;
    std::vector<std::size_t> sizes_;
};

TEST_F(AdditiveLodTiles, HoldEveryPointOnceOverAllLevelsOnOneGrid) {
    ASSERT_EQ(tiles_.size(), 3U);
    std::vector<LodTile> all;
    for (std::size_t level = 0; level < tiles_.size(); ++level) {
        EXPECT_EQ(down_to(level).size(), sizes_[level]);
        for (const LodTile& tile : tiles_[level]) {
            EXPECT_EQ(tile.step, tiles_[0][0].step);
            EXPECT_EQ(tile.parent.has_value(), level > 0);
            all.push_back(tile);
        }
    }
    expect_to_hold(all, cloud_, center_, 1'000);
}

TEST_F(AdditiveLodTiles, TellTheErrorAndTheSpacingOfAllThatIsThere) {
    for (std::size_t level = 0; level < tiles_.size(); ++level) {
        const PointCloud there = down_to(level);
        EXPECT_NEAR(figures_[level].error.mean / measure_error(cloud_, there).mean(), 1, 0.03);
        EXPECT_NEAR(figures_[level].spacing / mean_spacing(there.positions), 1, 0.06);
        if (level > 0) {
            EXPECT_LT(figures_[level].error.mean, figures_[level - 1].error.mean);
        }
    }
}

TEST(LodTiles, OfFewNewPointsTellTheSpacingOfAllThatAreThere) {
    const PointCloud cloud = test::sphere(100);
    LodTiler tiler(cloud, {.additive = true});
    PointCloud there;
    there.origin = tiler.center();
    build_lod_pyramid(
        cloud,
        {.sizes = {10, 99, 100}, .simplification = {.method = Method::Iterative}, .nested = true},
        [&](LodLevel&& level) {
            for (const LodTile& tile : tiler.add_level(level.cloud, level.cloud.size() == 100)) {
                const PointCloud part = decode_tile(tile, tiler.center());
                there.positions.insert(there.positions.end(), part.positions.begin(),
                                       part.positions.end());
            }
            EXPECT_NEAR(tiler.figures().spacing / mean_spacing(there.positions), 1, 0.02);
            EXPECT_NEAR(tiler.level_spacing() / mean_spacing(level.cloud.positions), 1, 0.02);
        });
}

TEST(LodTiles, TellTheSpacingOfALevelBeforeRoundingToo) {
    const PointCloud cloud = test::sphere(20'000), level = level_of(cloud, 2'000);
    for (const bool errors : {false, true}) {
        // Steps are as long as they may be: half the spacing, and that of the source for the whole.
        LodTiler tiler(cloud, {.position_bits = 6, .tolerance = 100, .level_errors = errors});
        for (const PointCloud* const each : {&level, &cloud}) {
            tiler.add_level(*each, each == &cloud);
            const double spacing = mean_spacing(each->positions);
            EXPECT_NEAR(tiler.level_spacing() / spacing, 1, 0.02);
            EXPECT_GT(std::abs(tiler.figures().spacing / spacing - 1), 0.04);
        }
    }
}

TEST_F(AdditiveLodTiles, NeedLevelsThatGrow) {
    LodTiler tiler(cloud_, {.additive = true});
    tiler.add_level(cloud_, false);
    test::expect_refused(": expected more than the level before",
                         [&] { tiler.add_level(cloud_, true); });
}

TEST(LodTiles, AreMeasuredAtEveryPointWhereErrorsAreToBeExact) {
    const PointCloud cloud = test::sphere(60'000, 0.02);
    const PointCloud level = [&] {
        PointCloud coarse;
        for (std::size_t i = 0; i < cloud.size(); i += 4)
            coarse.positions.push_back(cloud.positions[i]);
        return coarse;
    }();
    LodTiler exact(cloud, {.max_points = 2'000, .errors = LodErrors::Exact}),
        some(cloud, {.max_points = 2'000});
    const std::vector<LodTile> tiles = exact.add_level(level, false),
                               quick = some.add_level(level, false);
    ASSERT_EQ(tiles.size(), quick.size());
    std::uint64_t samples = 0;
    for (std::size_t t = 0; t < tiles.size(); ++t) {
        EXPECT_EQ(tiles[t].streams.front().bytes, quick[t].streams.front().bytes);
        samples += tiles[t].error.samples;
        EXPECT_LT(tiles[t].error.mean_confidence, 0.035 * tiles[t].error.mean);
        EXPECT_NEAR(quick[t].error.mean, tiles[t].error.mean, 2 * quick[t].error.mean_confidence);
    }
    EXPECT_EQ(samples, cloud.size());
    EXPECT_EQ(exact.figures().error.samples, cloud.size());
    EXPECT_LT(some.figures().error.samples, cloud.size() / 3);

    // Small clouds are measured between their points as well.
    const PointCloud small = test::sphere(3'000);
    LodTiler of_small(small, {.errors = LodErrors::Exact});
    of_small.add_level(small, true);
    EXPECT_EQ(of_small.figures().error.samples, 131'072U);
}

TEST(LodTiles, AreMeasuredAtFewPlacesWhereErrorsMayBeRough) {
    const PointCloud cloud = test::sphere(60'000, 0.02);
    LodTiler rough(cloud, {.errors = LodErrors::Rough}), sure(cloud, {});
    rough.add_level(cloud, true);
    sure.add_level(cloud, true);
    const TileError error = rough.figures().error;
    EXPECT_EQ(error.samples, 2'048U);
    EXPECT_GT(error.mean_confidence, sure.figures().error.mean_confidence);
    EXPECT_NEAR(error.mean, sure.figures().error.mean, 2 * error.mean_confidence);
}

TEST(LodTiles, StopWhenAskedTo) {
    const PointCloud cloud = test::sphere(20'000);
    LodTiler tiler(cloud, {});
    std::stop_source stop;
    stop.request_stop();
    EXPECT_THROW(tiler.add_level(cloud, true, {.stop = stop.get_token()}), Cancelled);
}

TEST(LodTiles, RefuseAPrecisionThatTheyCannotHave) {
    const PointCloud cloud = test::sphere(100);
    try {
        tiles_of(cloud, {.precision = 1e-12});
        ADD_FAILURE() << "made tiles";
    } catch (const Error& error) {
        EXPECT_NE(std::string(error.what()).find("precision 1e-12: expected at least 1.8"),
                  std::string::npos)
            << error.what();
    }
    EXPECT_LE(tiles_of(cloud, {.precision = 2e-9}).front().step, 4.1e-9);
}

TEST(LodTiles, RefuseOptionsOutOfRange) {
    const auto refuses = [](const LodTileOptions& options, std::string_view part) {
        test::expect_refused(part, [&] { validate(options); });
    };
    refuses({.position_bits = 1}, "tiles: position_bits 1: expected 2..24");
    refuses({.position_bits = 25}, "tiles: position_bits 25: expected 2..24");
    refuses({.precision = 0.0}, "tiles: precision 0: expected a finite length above 0");
    refuses({.precision = 1.2e308}, "tiles: precision 1.2e+308: expected a finite length above 0");
    refuses({.tolerance = -1}, "tiles: tolerance -1: expected at least 0");
    refuses({.max_points = 0}, "tiles: max_points 0: expected 1..65536");
    const std::vector<Index> too_few(99);
    test::expect_refused("points of an order 99: expected all of the level", [&] {
        LodTiler(test::sphere(100), {}).add_level(test::sphere(100), false, {}, too_few);
    });
    test::expect_refused("the cloud has no points", [&] { LodTiler(PointCloud{}, {}); });
}

TEST(DecodeTile, RejectsEveryTruncation) {
    LodTile tile = tiles_of(test::with_attributes(test::sphere(300)), {.attributes = true}).front();
    for (TileStream& stream : tile.streams) {
        const std::vector<std::byte> whole = stream.bytes;
        for (std::size_t length = 0; length < whole.size(); ++length) {
            stream.bytes.assign(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length));
            SCOPED_TRACE(length);
            test::expect_error(ErrorCode::MalformedInput, stream.name, [&] { decode_tile(tile); });
        }
        stream.bytes = whole;
    }
    EXPECT_EQ(decode_tile(tile).size(), 300U);
}

}  // namespace
}  // namespace stipple
