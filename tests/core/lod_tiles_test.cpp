#include "stipple/lod_tiles.hpp"

#include "stipple/error.hpp"
#include "stipple/neighbors.hpp"
#include "support/expect_error.hpp"
#include "support/lod_tiles.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <cstddef>
#include <functional>
#include <numeric>
#include <string_view>
#include <utility>
#include <vector>

namespace stipple {
namespace {

using test::expect_to_hold, test::numbered, test::numbers_of, test::tiles_of;

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

TEST(LodTiles, OfAPointFarOffTellNoWideSpacing) {
    PointCloud cloud = test::sphere(20'000);
    const double spacing = mean_spacing(cloud.positions);
    cloud.positions.push_back({1e6F, 0, 0});
    const auto tiles = tiles_of(cloud, {});
    ASSERT_GT(tiles.size(), 1U);
    for (const LodTile& tile : tiles) EXPECT_LT(tile.spacing, 10 * spacing);
}

TEST(LodTiles, WhosePointsShareTheirPlacesTellTheSpacingOfThose) {
    PointCloud cloud = test::plane(40'000);
    const double spacing = mean_spacing(cloud.positions);
    // Steps of ten spacings: a hundred points to a place.
    const auto tiles = tiles_of(cloud, {.precision = 5 * spacing, .max_points = 10'000});
    ASSERT_GT(tiles.size(), 1U);
    for (const LodTile& tile : tiles) EXPECT_NEAR(tile.spacing / tile.step, 1, 0.3);
}

TEST(LodTiles, OfACloudWithAllPointsThriceTellTheSpacingOfOne) {
    PointCloud cloud = test::sphere(8'000);
    const double spacing = tiles_of(cloud, {}).front().spacing;
    const std::vector<Vec3f> once = cloud.positions;
    for (int times = 0; times < 2; ++times)
        cloud.positions.insert(cloud.positions.end(), once.begin(), once.end());
    EXPECT_NEAR(tiles_of(cloud, {}).front().spacing / spacing, 1, 0.1);
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
            const double rounding = 1e-7 * decoded.positions[i].norm();
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
    constexpr double kPrecision = 0.0007;  // 26 bits of the whole, with what floats round
    PointCloud cloud = test::sphere(20'000);
    cloud.positions.push_back({1e4F, 0, 0});
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
    const auto tiles = tiler.add_level(subset(cloud, some), false);
    EXPECT_LT(tiler.level_spacing(), 0.2);
    EXPECT_LT(tiler.figures().spacing, 2 * tiles.front().step);
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

TEST(LodTiles, StopWhenAskedTo) {
    const PointCloud cloud = test::sphere(20'000);
    LodTiler tiler(cloud, {});
    std::stop_source stop;
    stop.request_stop();
    EXPECT_THROW(tiler.add_level(cloud, true, {.stop = stop.get_token()}), Cancelled);
}

TEST(LodTiles, RefuseAPrecisionThatTheyCannotHave) {
    const PointCloud cloud = test::sphere(100);
    test::expect_refused("precision 1e-12: expected at least 1.1",
                         [&] { tiles_of(cloud, {.precision = 1e-12}); });
    // About the middle they are floats anew, rounded by up to 6e-8; doubles were so before.
    test::expect_refused("precision 5e-08: expected at least 1.1",
                         [&] { tiles_of(cloud, {.precision = 5e-8}); });
    EXPECT_LE(tiles_of(cloud, {.precision = 1e-6}).front().step, 2e-6 - 1e-7);
    PointCloud wide = cloud;
    wide.double_precision = true;
    test::expect_refused("precision 1e-07: expected at least 2.3",
                         [&] { tiles_of(wide, {.precision = 1e-7}); });
    EXPECT_LE(tiles_of(wide, {.precision = 1e-6}).front().step, 2e-6 - 2e-7);
}

TEST(LodTiles, OfClustersFarApartHaveThePrecisionOrAreRefused) {
    PointCloud cloud = test::sphere(1'000);
    for (const Vec3f& p : test::sphere(1'000).positions)
        cloud.positions.push_back(p + Vec3f(1e5F, 3, 0));
    cloud = numbered(std::move(cloud));
    unsigned kept = 0;
    for (const double precision : {0.1, 0.03, 0.01, 0.007, 0.005, 0.001}) {
        try {
            LodTiler tiler(cloud, {.precision = precision, .attributes = true});
            expect_within(precision, tiler.add_level(cloud, true), tiler.center(), cloud);
            ++kept;
        } catch (const Error& refused) {
            EXPECT_NE(std::string(refused.what()).find("expected at least 0.00596"),
                      std::string::npos)
                << refused.what();
        }
    }
    EXPECT_EQ(kept, 5U);
}

TEST(LodTiles, TakeThePrecisionThatARefusalNames) {
    PointCloud cloud = test::sphere(100);
    cloud.double_precision = true;
    for (Vec3f& p : cloud.positions) p *= 1e5F;
    for (double precision = 1e-4; precision < 1; precision *= 1.07) {
        try {
            tiles_of(cloud, {.precision = precision});
        } catch (const Error& refused) {
            const std::string text = refused.what();
            const double least = std::stod(text.substr(text.find("at least ") + 9));
            EXPECT_GT(least, precision);
            EXPECT_NO_THROW(tiles_of(cloud, {.precision = 1.001 * least})) << text;
        }
    }
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
