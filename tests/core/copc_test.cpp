#include "stipple/copc.hpp"

#include "base/random.hpp"
#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "stipple/globe.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <string_view>

// That other people's readers find every value in a file is e2e/copc's to say.

namespace stipple {
namespace {

template <typename T>
T at(const std::vector<std::byte>& bytes, std::size_t offset) {
    T value;
    std::memcpy(&value, bytes.data() + offset, sizeof value);
    return value;
}

/// The step of a file's grid.
double step_of(const std::vector<std::byte>& file) {
    return at<double>(file, 131);
}

std::string refusal(const PointCloud& cloud, const CopcOptions& options = {}) {
    try {
        encode_copc(cloud, options);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::InvalidArgument);
        return error.what();
    }
    return "";
}

TEST(Copc, IsALazFileThatBeginsWithItsInfo) {
    const std::vector<std::byte> file = encode_copc(test::sphere(3000));
    const std::string_view text(reinterpret_cast<const char*>(file.data()), file.size());
    EXPECT_TRUE(text.starts_with("LASF"));
    EXPECT_EQ(text.substr(377, 4), "copc");
    EXPECT_EQ(at<std::uint64_t>(file, 247), 3000U);
    const auto pages = at<std::uint64_t>(file, 429 + 40) + at<std::uint64_t>(file, 429 + 48);
    EXPECT_EQ(pages, file.size());
}

struct Pages {
    unsigned pages = 0, deepest = 0;  ///< how many; so many below each other
    std::uint64_t points = 0;
    std::map<std::array<std::int32_t, 4>, std::int32_t> nodes{};  ///< points by depth and place
};

/// As a reader walks through them.
void walk(const std::vector<std::byte>& file, std::uint64_t offset, std::uint64_t size,
          unsigned below, Pages& found) {
    ++found.pages;
    found.deepest = std::max(found.deepest, below);
    ASSERT_EQ(size % 32, 0U);
    for (std::uint64_t entry = offset; entry < offset + size; entry += 32) {
        const auto key = at<std::array<std::int32_t, 4>>(file, entry);
        const auto points = at<std::int32_t>(file, entry + 28);
        const auto where = at<std::uint64_t>(file, entry + 16);
        const auto bytes = static_cast<std::uint64_t>(at<std::int32_t>(file, entry + 24));
        if (points < 0) {
            EXPECT_EQ(points, -1);
            walk(file, where, bytes, below + 1, found);
            EXPECT_TRUE(found.nodes.contains(key)) << "a page begins with the node it is named by";
            continue;
        }
        EXPECT_TRUE(found.nodes.emplace(key, points).second);
        found.points += static_cast<std::uint64_t>(points);
        // The number of its points stands behind the first in each chunk.
        EXPECT_EQ(at<std::uint32_t>(file, where + 30), static_cast<std::uint32_t>(points));
    }
}

TEST(Copc, CutsALargeHierarchyIntoPages) {
    PointCloud cloud;  // spheres within spheres
    for (const float radius : {1.0F, 0x1p-7F, 0x1p-14F})
        for (const Vec3f& p : test::sphere(20'000).positions) cloud.positions.push_back(radius * p);
    const std::vector<std::byte> file =
        encode_copc(cloud, {.octree = {.grid = 2, .max_points = 4}});
    Pages found;
    walk(file, at<std::uint64_t>(file, 429 + 40), at<std::uint64_t>(file, 429 + 48), 1, found);
    EXPECT_EQ(found.points, cloud.size());
    EXPECT_GT(found.pages, 4U);
    EXPECT_GT(found.deepest, 2U);
    for (const auto& [key, points] : found.nodes) {
        const auto [depth, x, y, z] = key;
        EXPECT_TRUE(depth == 0 || found.nodes.contains({depth - 1, x / 2, y / 2, z / 2}));
    }
}

TEST(Copc, TakesTheLongestDecimalStepOnWhichAllPointsLie) {
    PointCloud cloud;
    cloud.origin = Vec3d(636'000, 849'000, 400);
    for (int i = 0; i < 2000; ++i)
        cloud.positions.emplace_back(static_cast<float>(i % 89) * 0.25F,
                                     static_cast<float>(i / 89) * 0.5F, 7);
    EXPECT_EQ(step_of(encode_copc(cloud)), 0.01);
    cloud.positions[1999].z() = 7.125F;
    EXPECT_EQ(step_of(encode_copc(cloud)), 0.001);
}

TEST(Copc, SeesThroughTheDustThatArithmeticLeavesAtZero) {
    PointCloud cloud;
    for (int i = 0; i < 500; ++i)
        cloud.positions.emplace_back(static_cast<float>(0.001 * (i % 89)),
                                     static_cast<float>(0.001 * (i / 89)), 0.007F);
    cloud.positions[89].x() = -2.2e-18F;
    EXPECT_EQ(step_of(encode_copc(cloud)), 0.001);
}

TEST(Copc, KnowsMillimetresInATileOfTenKilometres) {
    constexpr double kSide = 10'000, kStep = 0.001;
    PointCloud cloud;
    cloud.origin = Vec3d(500'000, 5'200'000, 400);
    for (std::uint64_t i = 0; i < 2'000; ++i) {
        const auto on_grid = [&](std::uint64_t of) {
            return static_cast<float>(kStep *
                                      std::round((random_unit(3, of) - 0.5) * kSide / kStep));
        };
        cloud.positions.emplace_back(on_grid(2 * i), on_grid(2 * i + 1), 7);
    }
    EXPECT_EQ(step_of(encode_copc(cloud)), kStep);
    // A place of which one float tells that it is beside the grid.
    cloud.positions[5].z() = 7.0004F;
    EXPECT_LT(step_of(encode_copc(cloud)), kStep);
}

TEST(Copc, ElseTakesAStepAsShortAsFloatsTellApart) {
    const PointCloud cloud = test::sphere(3000);  // of radius 1
    const double step = step_of(encode_copc(cloud));
    EXPECT_LE(step, 2 * 0x1p-24);
    EXPECT_GT(step, 0.1 * 0x1p-24);
}

TEST(Copc, KeepsThePrecisionAskedFor) {
    const PointCloud cloud = test::sphere(3000);
    EXPECT_DOUBLE_EQ(step_of(encode_copc(cloud, {.precision = 0.01})), 0.01);
    EXPECT_DOUBLE_EQ(step_of(encode_copc(cloud, {.precision = 0.049})), 0.01);
    EXPECT_DOUBLE_EQ(step_of(encode_copc(cloud, {.precision = 0.05})), 0.1);
}

TEST(Copc, CountsWhatReadingDoublesHasRoundedToThePrecision) {
    PointCloud cloud = test::sphere(3000);
    for (Vec3f& p : cloud.positions) p *= 50'000;  // floats have 2 mm there, or 4
    EXPECT_DOUBLE_EQ(step_of(encode_copc(cloud, {.precision = 0.0055})), 0.01);
    cloud.double_precision = true;
    EXPECT_DOUBLE_EQ(step_of(encode_copc(cloud, {.precision = 0.0055})), 0.001);
    EXPECT_NE(refusal(cloud, {.precision = 0.0005}).find("in single precision"), std::string::npos);
    // On a grid that floats tell apart they are put back.
    for (Vec3f& p : cloud.positions) p = (p * 10).array().round() / 10;
    EXPECT_DOUBLE_EQ(step_of(encode_copc(cloud, {.precision = 0.055})), 0.1);
}

TEST(Copc, TellsTheCoordinateSystemItIsGiven) {
    const std::vector<std::byte> file = encode_copc(test::sphere(100), {.epsg = 32633});
    const std::string_view text(reinterpret_cast<const char*>(file.data()), file.size());
    EXPECT_EQ(at<std::uint32_t>(file, 100), 3U);  // records
    const std::string expected = well_known_text(32633) + '\0';
    const std::size_t found = text.find(expected);
    ASSERT_NE(found, std::string_view::npos);
    EXPECT_EQ(text.substr(found - 52, 15), "LASF_Projection");
    EXPECT_EQ(at<std::uint16_t>(file, found - 34), expected.size());
    EXPECT_EQ(at<std::uint32_t>(file, 96), found + expected.size()) << "the points follow";
    EXPECT_NE(refusal(test::sphere(10), {.epsg = 4326}).find("epsg 4326"), std::string::npos);
}

TEST(Copc, TellsThatTheCoordinateSystemIsUnknown) {
    const std::vector<std::byte> file = encode_copc(test::sphere(100));
    const std::string_view text(reinterpret_cast<const char*>(file.data()), file.size());
    EXPECT_EQ(at<std::uint32_t>(file, 100), 3U);  // records
    const std::size_t found = text.find("LOCAL_CS[\"unknown\"");
    ASSERT_NE(found, std::string_view::npos);
    EXPECT_EQ(text.substr(found - 52, 15), "LASF_Projection");
}

TEST(Copc, GivesEachExtraFieldANameOfItsOwn) {
    PointCloud cloud = test::sphere(10);
    const std::string longer = "a_name_that_is_longer_than_LAS_allows";
    for (const std::string& name : {longer + "1", longer + "2", std::string("X")})
        cloud.attributes.push_back({name, std::vector<float>(10, 0.5F)});
    const std::vector<std::byte> file = encode_copc(cloud);
    const std::string_view text(reinterpret_cast<const char*>(file.data()), file.size());
    const std::size_t first = text.find("a_name_that_is_longer_than_LAS_a");
    ASSERT_NE(first, std::string_view::npos);
    constexpr std::size_t kField = 192;
    EXPECT_EQ(text.substr(first + kField, 32), "a_name_that_is_longer_than_LAS_2");
    EXPECT_EQ(text.substr(first + 2 * kField, 4), std::string_view("X_2\0", 4));
}

TEST(Copc, GivesNoExtraFieldANameOfLasThatAnotherHas) {
    PointCloud cloud = test::sphere(10);
    cloud.attributes = {{"Intensity", std::vector<float>(10, 0.5F)},
                        {"intensity", std::vector<std::uint16_t>(10, 700)}};
    const std::vector<std::byte> file = encode_copc(cloud);
    const std::string_view text(reinterpret_cast<const char*>(file.data()), file.size());
    EXPECT_NE(text.find(std::string_view("Intensity_2\0", 12)), std::string_view::npos);
    EXPECT_EQ(text.find(std::string_view("Intensity\0", 10)), std::string_view::npos);
}

/// What is odd of a cloud, whose file has this among its extra bytes; empty: has none.
std::vector<std::string> odd_of(const PointCloud& cloud, std::string_view extra) {
    std::vector<std::string> odd;
    const std::vector<std::byte> file = encode_copc(cloud, {}, {}, &odd);
    const std::string_view text(reinterpret_cast<const char*>(file.data()), file.size());
    EXPECT_EQ(text.find("Extra bytes") != text.npos, !extra.empty());
    EXPECT_NE(text.find(extra), text.npos) << extra;
    return odd;
}

TEST(Copc, KeepsAFieldOfLasWhereFewPointsHaveOddValues) {
    PointCloud cloud = test::sphere(40);
    const auto with = [&]<typename T>(const std::string& name, T usual, T odd, std::size_t odds) {
        std::vector<T> values(40, usual);
        std::fill_n(values.begin() + 7, odds, odd);
        cloud.attributes.push_back({name, std::move(values)});
    };
    with("intensity", 700.0F, 1.5F, 1);
    EXPECT_EQ(
        odd_of(cloud, "intensity_2"),
        std::vector<std::string>{"intensity: 0 at 1 point whose values LAS's own field cannot "
                                 "hold; the extra bytes have all"});
    cloud.attributes.clear();
    with("GpsTime", 7.0, std::numeric_limits<double>::quiet_NaN(), 4);
    EXPECT_EQ(odd_of(cloud, "GpsTime_2"),
              std::vector<std::string>{"GpsTime: 0 at 4 points whose values LAS's own field cannot "
                                       "hold; the extra bytes have all"});
    cloud.attributes.clear();
    with("classification", 2, 256, 5);
    EXPECT_EQ(odd_of(cloud, "classification"),
              std::vector<std::string>{"classification: in the extra bytes alone, since LAS's own "
                                       "field cannot hold the values of 5 points"});
    cloud.attributes.clear();
    with("classification", 2, 255, 5);
    EXPECT_TRUE(odd_of(cloud, "").empty());
}

TEST(Copc, TakesAPointOfNoReturnForTheOnlyOne) {
    PointCloud cloud = test::sphere(40);
    std::vector<std::uint8_t> numbers(40, 2);
    numbers[3] = 0;
    cloud.attributes = {{"return_number", numbers},
                        {"number_of_returns", std::vector<std::uint8_t>(40, 2)}};
    EXPECT_EQ(odd_of(cloud, "return_number_2"),
              std::vector<std::string>{"return_number and number_of_returns: 1 of 1 at 1 point "
                                       "whose values LAS's own field cannot hold; the extra bytes "
                                       "have all"});
    const std::vector<std::byte> file = encode_copc(cloud);
    constexpr std::size_t kByReturn = 255;
    EXPECT_EQ(at<std::uint64_t>(file, kByReturn), 1U);
    EXPECT_EQ(at<std::uint64_t>(file, kByReturn + 8), 39U);
}

TEST(Copc, TakesFlagsOfZeroAndOne) {
    PointCloud cloud = test::sphere(40);
    for (const std::string name : {"synthetic", "KeyPoint", "scalar_Withheld", "overlap",
                                   "ScanDirectionFlag", "edge_of_flight_line"})
        cloud.attributes.push_back({name, std::vector<float>(40, 1)});
    EXPECT_TRUE(odd_of(cloud, "").empty());
    const std::vector<std::byte> file = encode_copc(cloud);
    EXPECT_EQ(at<std::uint8_t>(file, at<std::uint32_t>(file, 96) + 8 + 15), 0b1100'1111);
    cloud.attributes = {{"overlap", std::vector<std::uint8_t>(40, 12)}};
    EXPECT_EQ(odd_of(cloud, "overlap").size(), 1U);
}

TEST(Copc, RefusesWhatTheFormatCannotHold) {
    PointCloud cloud = test::sphere(10);
    EXPECT_NE(refusal({}).find("no points"), std::string::npos);
    EXPECT_NE(refusal(cloud, {.precision = 0.0}).find("precision"), std::string::npos);
    for (const double precision : {1e-12, 1e-320})
        EXPECT_NE(refusal(cloud, {.precision = precision}).find("2^30"), std::string::npos);
    EXPECT_NE(refusal(cloud, {.precision = 1.2e308}).find("finite"), std::string::npos);
    const std::string long_name(42, 'n');  // all its fields begin with the same 32 bytes
    cloud.attributes = {{long_name, std::vector<std::uint8_t>(341 * 10), 341}};
    EXPECT_EQ(refusal(cloud), "");
    cloud.attributes.push_back({"one", std::vector<std::uint8_t>(10)});
    EXPECT_NE(refusal(cloud).find("341 components, all together have 342"), std::string::npos);
    cloud.attributes = {{long_name, std::vector<std::uint8_t>(50'000 * 10), 50'000}};
    EXPECT_NE(refusal(cloud).find("50000 components"), std::string::npos);
    cloud.attributes.clear();
    cloud.positions[3].y() = std::numeric_limits<float>::quiet_NaN();
    EXPECT_NE(refusal(cloud).find("not finite"), std::string::npos);
}

TEST(Copc, KeepsTheStepOfMostWhereAnotherPointLiesFarOff) {
    PointCloud cloud;
    cloud.origin = Vec3d(500'224, 5'400'064, 512);
    cloud.double_precision = true;
    for (int i = 0; i < 2000; ++i)
        cloud.positions.emplace_back(static_cast<float>(i % 89) * 0.25F,
                                     static_cast<float>(i / 89) * 0.5F, 7.01F);
    cloud.positions.push_back((-cloud.origin).cast<float>());  // a return without coordinates
    EXPECT_EQ(step_of(encode_copc(cloud)), 0.01);
    EXPECT_EQ(step_of(encode_copc(cloud, {.precision = 0.005})), 0.01);
    for (std::size_t i = 0; i < 2000; ++i)
        cloud.positions[i].x() += 0.001F * static_cast<float>(i % 7);
    EXPECT_EQ(step_of(encode_copc(cloud)), 0.01) << "2^30 steps are no wider";
}

TEST(Copc, TakesPointsAtOnePlaceAndAnotherOne) {
    PointCloud cloud;
    cloud.positions.assign(1000, Vec3f(0, 0, 0));
    cloud.positions.emplace_back(1.0F / 3, 0, 0);
    const double step = step_of(encode_copc(cloud));
    EXPECT_GT(step, 0);
    EXPECT_LE(step, 1e-7);
}

TEST(Copc, RefusesAStepThatPointsAreNearerThanSinceAnotherLiesFarOff) {
    PointCloud cloud = test::sphere(2000);
    cloud.positions[7] = Vec3f(1e9F, 0, 0);
    EXPECT_NE(refusal(cloud).find("remove far-off points"), std::string::npos);
    EXPECT_EQ(refusal(cloud, {.precision = 10}), "");
    cloud.positions[7] = Vec3f(1e4F, 0, 0);
    EXPECT_EQ(refusal(cloud), "");
}

TEST(Copc, IsWrittenByItsExtension) {
    const test::TemporaryFolder folder;
    const PointCloud cloud = test::sphere(500);
    write_cloud(cloud, folder / "a.copc.laz");
    std::ifstream stream(folder / "a.copc.laz", std::ios::binary);
    const std::string content{std::istreambuf_iterator<char>(stream), {}};
    const std::vector<std::byte> expected = encode_copc(cloud);
    ASSERT_EQ(content.size(), expected.size());
    EXPECT_EQ(std::memcmp(content.data(), expected.data(), expected.size()), 0);
}

}  // namespace
}  // namespace stipple
