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
#include <cstddef>
#include <memory>
#include <set>
#include <utility>
#include <vector>

namespace stipple {
namespace {

using test::expect_to_hold, test::numbered;

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

}  // namespace
}  // namespace stipple
