#include "cloud/srgb.hpp"
#include "pyramid/vertex_codec.hpp"
#include "stipple/lod_tiles.hpp"
#include "support/lod_tiles.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>
#include <string>
#include <string_view>
#include <vector>

// Normals, colours, alpha and other attributes of tiles.

namespace stipple {
namespace {

using test::numbered, test::numbers_of, test::tiles_of;

TEST(LodTiles, KeepNormalsColoursAndAttributes) {
    PointCloud cloud = numbered(test::with_attributes(test::sphere(3'000)));
    std::vector<double> wide(6 * cloud.size());
    for (std::size_t i = 0; i < wide.size(); ++i) wide[i] = static_cast<double>(i % 1000);
    set_attribute(cloud, {"wide", wide, 6, Reduction::Mean});
    const auto tiles = tiles_of(cloud, {.max_points = 1'000, .attributes = true});
    for (const LodTile& tile : tiles) {
        const PointCloud decoded = decode_tile(tile);
        ASSERT_EQ(decoded.colors.size(), decoded.size());
        ASSERT_EQ(decoded.normals.size(), decoded.size());
        const std::vector<std::size_t> numbers = numbers_of(decoded);
        const Attribute* const fourth = find_attribute(decoded, "wide_3");
        ASSERT_NE(fourth, nullptr);
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            EXPECT_EQ(decoded.colors[i], cloud.colors[numbers[i]]);
            EXPECT_GT(decoded.normals[i].dot(cloud.normals[numbers[i]]), std::cos(0.03F));
            EXPECT_EQ(std::get<std::vector<float>>(fourth->values)[i],
                      static_cast<float>((6 * numbers[i] + 3) % 1000));
        }
    }
    for (const LodTile& tile : tiles_of(cloud, {.max_points = 1'000}))
        EXPECT_TRUE(decode_tile(tile).attributes.empty()) << "not asked for";
}

TEST(LodTiles, KeepDirectionsOfNormalsOfAnyLength) {
    PointCloud cloud = numbered(test::sphere(3'000));
    for (std::size_t i = 0; i < cloud.size(); ++i)
        cloud.normals.push_back(cloud.positions[i].normalized());
    const std::vector<Vec3f> directions = cloud.normals;
    constexpr std::array<float, 4> kLengths = {1, 1e-30F, 1e30F, 0.3F};
    for (std::size_t i = 0; i < cloud.size(); ++i) cloud.normals[i] *= kLengths[i % 4];
    for (const LodTile& tile : tiles_of(cloud, {.attributes = true})) {
        const PointCloud decoded = decode_tile(tile);
        const std::vector<std::size_t> numbers = numbers_of(decoded);
        for (std::size_t i = 0; i < numbers.size(); ++i)
            EXPECT_LT((decoded.normals[i] - directions[numbers[i]]).norm(), 0.02F);
    }
}

TEST(LodTiles, HaveNormalsUpwardsWhereThereIsNoDirection) {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    PointCloud cloud = test::plane(4);
    cloud.normals = {Vec3f::Zero(), Vec3f(0, std::numeric_limits<float>::quiet_NaN(), 1),
                     Vec3f(-kInfinity, 0, 1), Vec3f(0, 0, 2)};
    for (const Vec3f& normal : decode_tile(tiles_of(cloud, {}).front()).normals)
        EXPECT_EQ(normal, Vec3f(0, 0, 1));
}

TEST(LodTiles, HaveNoNormalsWhereNoneHasADirection) {
    PointCloud cloud = test::sphere(900);
    cloud.normals.assign(cloud.size(), Vec3f::Zero());
    EXPECT_TRUE(decode_tile(tiles_of(cloud, {}).front()).normals.empty());
    cloud.normals.back() = Vec3f::UnitX();
    EXPECT_EQ(decode_tile(tiles_of(cloud, {}).front()).normals.size(), cloud.size());
}

TEST(LodTiles, HaveNoNumbersThatGltfForbids) {
    PointCloud cloud = numbered(test::sphere(900));
    std::vector<float> some(cloud.size(), 0.5F), whole(cloud.size(), 2.5F);
    std::vector<double> far(3 * cloud.size(), 7.5);
    some[5] = std::numeric_limits<float>::quiet_NaN();
    some[6] = std::numeric_limits<float>::infinity();
    far[3 * 8 + 1] = -1e300;
    cloud.attributes.push_back({"some", some, 1, Reduction::Mean});
    cloud.attributes.push_back({"far", far, 3, Reduction::Mean});
    cloud.attributes.push_back({"whole", whole, 1, Reduction::Mean});
    LodTile tile = tiles_of(cloud, {.attributes = true}).front();
    const auto values_of = [](const PointCloud& decoded, std::string_view name) {
        return std::get<std::vector<float>>(find_attribute(decoded, name)->values);
    };
    const PointCloud decoded = decode_tile(tile);
    const std::vector<std::size_t> numbers = numbers_of(decoded);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        const std::size_t n = numbers[i];
        EXPECT_EQ(std::isnan(values_of(decoded, "some")[i]), n == 5 || n == 6);
        EXPECT_EQ(std::isnan(values_of(decoded, "far")[3 * i + 1]), n == 8);
        EXPECT_EQ(values_of(decoded, "far")[3 * i + 2], 7.5F);
    }
    for (TileStream& stream : tile.streams) {
        EXPECT_EQ(stream.has_no_data, stream.name == "_some" || stream.name == "_far");
        stream.has_no_data = false;
    }
    const PointCloud stored = decode_tile(tile);
    EXPECT_EQ(std::ranges::count(values_of(stored, "some"), TileStream::kNoData), 2);
    EXPECT_EQ(std::ranges::count(values_of(stored, "far"), TileStream::kNoData), 1);
}

TEST(LodTiles, TellNumbersApartThatLieFarFromZero) {
    PointCloud cloud = numbered(test::sphere(3'000));
    const std::size_t n = cloud.size();
    std::vector<double> times(2 * n), near(n);
    std::vector<std::uint32_t> ids(n);
    for (std::size_t i = 0; i < n; ++i) {
        times[2 * i] = 1.3e9 + 0.01 * static_cast<double>(i);
        times[2 * i + 1] = i == 7 ? std::numeric_limits<double>::quiet_NaN() : times[2 * i] + 0.25;
        near[i] = 0.1 * static_cast<double>(i);
        ids[i] = 4'000'000'000U + static_cast<std::uint32_t>(i);
    }
    cloud.attributes.push_back({"times", times, 2, Reduction::Mean});
    cloud.attributes.push_back({"near", near, 1, Reduction::Mean});
    cloud.attributes.push_back({"ids", ids, 1, Reduction::Nearest});
    for (const LodTile& tile : tiles_of(cloud, {.max_points = 1'000, .attributes = true})) {
        const PointCloud decoded = decode_tile(tile);
        const auto of = [&](const char* name) {
            return std::get<std::vector<double>>(find_attribute(decoded, name)->values);
        };
        EXPECT_TRUE(
            std::holds_alternative<std::vector<float>>(find_attribute(decoded, "near")->values));
        const std::vector<std::size_t> numbers = numbers_of(decoded);
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            const std::size_t number = numbers[i];
            EXPECT_NEAR(of("times")[2 * i], times[2 * number], 2e-6);
            EXPECT_EQ(std::isnan(of("times")[2 * i + 1]), number == 7);
            EXPECT_EQ(of("ids")[i], ids[number]);
        }
        for (const TileStream& stream : tile.streams) {
            const double offset = stream.name == "_times" ? 1.3e9 : stream.name == "_ids" ? 4e9 : 0;
            EXPECT_EQ(stream.offset, offset) << stream.name;
        }
    }
}

TEST(LodTiles, KeepAllColoursThoughGltfHasThemLinear) {
    PointCloud cloud = test::plane(256);
    for (std::size_t i = 0; i < 256; ++i) {
        const auto code = static_cast<std::uint8_t>(i);
        cloud.colors.push_back({code, static_cast<std::uint8_t>(255 - code), 0, code});
    }
    cloud.has_alpha = true;
    const PointCloud decoded = decode_tile(tiles_of(cloud, {}).front());
    ASSERT_TRUE(decoded.has_alpha);
    std::set<int> reds;
    for (const Rgba8& color : decoded.colors) {
        EXPECT_EQ(color.r + color.g, 255);
        EXPECT_EQ(color.r, color.a);
        reds.insert(color.r);
    }
    EXPECT_EQ(reds.size(), 256U);
}

/// Of each point the alpha that its number says.
PointCloud with_alpha(std::size_t n) {
    PointCloud cloud = numbered(test::sphere(n));
    for (std::size_t i = 0; i < n; ++i)
        cloud.colors.push_back({200, 100, 50, static_cast<std::uint8_t>(i % 256)});
    cloud.has_alpha = true;
    return cloud;
}

void expect_alpha_by_number(const PointCloud& tile) {
    ASSERT_TRUE(tile.has_alpha);
    const std::vector<std::size_t> numbers = numbers_of(tile);
    for (std::size_t i = 0; i < numbers.size(); ++i)
        EXPECT_EQ(tile.colors[i], (Rgba8{200, 100, 50, static_cast<std::uint8_t>(numbers[i])}));
}

TEST(LodTiles, HaveAlphaBesideColoursSoThatNobodyDrawsThemDarker) {
    const LodTile tile = tiles_of(with_alpha(500), {.attributes = true}).front();
    for (const TileStream& stream : tile.streams) EXPECT_LE(stream.components, 3U) << stream.name;
    const PointCloud decoded = decode_tile(tile);
    expect_alpha_by_number(decoded);
    EXPECT_EQ(decoded.attributes.size(), 1U);
    EXPECT_TRUE(decode_tile(tiles_of(with_alpha(500), {}).front()).has_alpha) << "of no attributes";
}

TEST(LodTiles, KeepAlphaApartFromAttributesOfThatName) {
    PointCloud cloud = with_alpha(500);
    for (const char* const name : {"alpha", "COLOR_0_ALPHA"})
        set_attribute(cloud, {name, std::vector<std::uint8_t>(500, 7), 1, Reduction::Nearest});
    const LodTile tile = tiles_of(cloud, {.attributes = true}).front();
    std::set<std::string> names;
    for (const TileStream& stream : tile.streams) EXPECT_TRUE(names.insert(stream.name).second);
    const PointCloud decoded = decode_tile(tile);
    expect_alpha_by_number(decoded);
    for (const char* const name : {"alpha", "COLOR_0_ALPHA"})
        EXPECT_EQ(find_attribute(decoded, name)->values, find_attribute(cloud, name)->values);
}

TEST(DecodeTile, ReadsAlphaInColoursAsItOnceWas) {
    LodTile tile = tiles_of(with_alpha(500), {.attributes = true}).front();
    const PointCloud decoded = decode_tile(tile);
    std::erase_if(tile.streams, [](const TileStream& s) { return s.name.ends_with("ALPHA"); });
    TileStream& colors = *std::ranges::find(tile.streams, "COLOR_0", &TileStream::name);
    colors.components = 4;
    VertexEncoder encoder;
    colors.bytes = encoder.encode(500, 8, [&](std::size_t begin, std::size_t end, std::byte* to) {
        for (std::size_t i = begin; i < end; ++i, to += 8) {
            const Rgba8& color = decoded.colors[i];
            const auto code = [](std::uint8_t c) {
                return static_cast<std::uint16_t>(std::lround(65'535 * linear_from_srgb()[c]));
            };
            const std::array<std::uint16_t, 4> vertex = {code(color.r), code(color.g),
                                                         code(color.b),
                                                         static_cast<std::uint16_t>(257 * color.a)};
            std::memcpy(to, vertex.data(), sizeof vertex);
        }
    });
    expect_alpha_by_number(decode_tile(tile));
}

}  // namespace
}  // namespace stipple
