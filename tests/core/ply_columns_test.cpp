#include "stipple/codec.hpp"
#include "support/expect_error.hpp"
#include "support/ply_text.hpp"

#include <gtest/gtest.h>
#include <cstdint>
#include <string>
#include <vector>

// What becomes of the properties of a vertex.

namespace stipple {
namespace {

using namespace stipple::test;

std::vector<Rgba8> colors_of(const std::string& type, const std::string& rows,
                             const std::string& more = "") {
    const std::string channel = "property " + type;
    const std::string text =
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\n"
        "property float y\nproperty float z\n" +
        channel + " red\n" + channel + " green\n" + channel + " blue\n" + more + "end_header\n" +
        rows;
    return decode_cloud(std::as_bytes(std::span(text))).colors;
}

/// What is told to be lost of the colours of two points.
std::vector<std::string> lost_of(const std::string& type, const std::string& rows) {
    const std::string channel = "property " + type;
    DecodeReport report;
    decode(ascii("element vertex 2\n" + kXyz + channel + " red\n" + channel + " green\n" + channel +
                     " blue\n",
                 rows),
           &report);
    return report.skipped;
}

TEST(PlyColumns, TakesColoursOf16BitsAsTheyAreWhereNoneIsAbove255) {
    EXPECT_EQ(colors_of("ushort", "0 0 0 255 128 0\n1 0 0 1 2 3\n"),
              (std::vector<Rgba8>{{255, 128, 0, 255}, {1, 2, 3, 255}}));
    EXPECT_EQ(colors_of("ushort", "0 0 0 65535 32896 0\n1 0 0 257 2 255\n"),
              (std::vector<Rgba8>{{255, 128, 0, 255}, {1, 0, 1, 255}}));
}

TEST(PlyColumns, TakesWideColoursAsTheyAreBesideAnAlphaOfAnotherType) {
    const std::vector<Rgba8> expected = {{200, 100, 50, 255}, {1, 2, 3, 128}};
    const std::string rows = "0 0 0 200 100 50 255\n1 0 0 1 2 3 128\n";
    for (const std::string type : {"ushort", "int", "float"})
        EXPECT_EQ(colors_of(type, rows, "property uchar alpha\n"), expected) << type;
    EXPECT_EQ(colors_of("int", rows, "property ushort alpha\n"), expected);
}

TEST(PlyColumns, TakesTheUpperBitsOfColoursAsLasHasThemAndTellsWhatIsLost) {
    const std::string las = "0 0 0 65280 32768 0\n1 0 0 256 512 768\n",
                      full = "0 0 0 65535 257 0\n1 0 0 0 514 771\n",
                      neither = "0 0 0 65535 256 0\n1 0 0 0 514 771\n";
    EXPECT_EQ(colors_of("ushort", las), (std::vector<Rgba8>{{255, 128, 0, 255}, {1, 2, 3, 255}}));
    EXPECT_EQ(colors_of("ushort", full), (std::vector<Rgba8>{{255, 1, 0, 255}, {0, 2, 3, 255}}));
    EXPECT_TRUE(lost_of("ushort", las).empty());
    EXPECT_TRUE(lost_of("ushort", full).empty());
    EXPECT_EQ(lost_of("ushort", neither).size(), 1U);
}

TEST(PlyColumns, TakesColoursOfWiderIntegersAsThoseOf16Bits) {
    for (const char* const type : {"int", "uint", "int64"}) {
        EXPECT_EQ(colors_of(type, "0 0 0 255 128 0\n1 0 0 1 2 3\n"),
                  (std::vector<Rgba8>{{255, 128, 0, 255}, {1, 2, 3, 255}}));
        EXPECT_EQ(colors_of(type, "0 0 0 65535 32896 0\n1 0 0 257 2 70000\n"),
                  (std::vector<Rgba8>{{255, 128, 0, 255}, {1, 0, 255, 255}}));
    }
    EXPECT_EQ(colors_of("short", "0 0 0 32639 -1 0\n1 0 0 257 514 771\n"),
              (std::vector<Rgba8>{{127, 0, 0, 255}, {1, 2, 3, 255}}));
}

TEST(PlyColumns, KeepsIntegersOf64BitsAsDoubles) {
    const std::string elements = "element vertex 1\n" + kXyz + "property int64 id\n";
    EXPECT_EQ(values<double>(decode(ascii(elements, "0 0 0 -9007199254740992\n")), "id").at(0),
              -0x1p53);
    for (const char* const beyond : {"9223372036854775808", "-9223372036854777856", "1e19"})
        test::expect_error(ErrorCode::MalformedInput, beyond,
                           [&] { decode(ascii(elements, std::string("0 0 0 ") + beyond + "\n")); });
    for (const bool big : {false, true}) {
        std::string file = std::string("ply\nformat binary_") + (big ? "big" : "little") +
                           "_endian 1.0\n" + elements +
                           "property list uint64 uint64 w\nend_header\n";
        for (int axis = 0; axis < 3; ++axis) append(file, float(axis), big);
        append(file, std::int64_t{-5'000'000'000}, big);
        append(file, std::uint64_t{1}, big);
        append(file, std::uint64_t{1} << 63, big);
        const PointCloud cloud = decode(file);
        EXPECT_EQ(values<double>(cloud, "id").at(0), -5e9);
        EXPECT_EQ(values<double>(cloud, "w").at(0), 0x1p63);
        EXPECT_EQ(cloud.positions.at(0), Vec3f(0, 1, 2));
    }
}

TEST(PlyColumns, TakesNormalsOfSmallIntegersAsShares) {
    const PointCloud cloud = decode(ascii(
        "element vertex 1\n" + kXyz + "property char nx\nproperty short ny\nproperty int nz\n",
        "0 0 0 127 -32767 2\n"));
    EXPECT_EQ(cloud.normals.at(0), Vec3f(1, -1, 2));
}

TEST(PlyColumns, GivesAttributesNamesThatItsOwnFilesCanHave) {
    const PointCloud cloud = decode(
        ascii("element vertex 1\n" + kXyz +
                  "property uchar r\nproperty uchar g\nproperty uchar b\nproperty float red\n"
                  "property float h\xc3\xb6he\nproperty float h_he\nproperty float nx\n",
              "0 0 0 1 2 3 4 5 6 7\n"));
    EXPECT_EQ(values<float>(cloud, "red_2").at(0), 4);
    EXPECT_EQ(values<float>(cloud, "h_he").at(0), 5);
    EXPECT_EQ(values<float>(cloud, "h_he_2").at(0), 6);
    EXPECT_EQ(values<float>(cloud, "nx").at(0), 7);  // without normals it is free
    const PointCloud back = decode(text_of(encode_ply(cloud)));
    EXPECT_EQ(back.colors, cloud.colors);
    EXPECT_EQ(values<float>(back, "red_2").at(0), 4);
}

TEST(PlyColumns, TakesColoursOfFloatsAsSharesOrAs8BitsByWhatTheCloudHas) {
    const std::vector<Rgba8> shares = {{0, 128, 255, 255}, {255, 0, 64, 255}};
    EXPECT_EQ(colors_of("float", "0 0 0 0 0.5 1\n1 0 0 1.01 -1 0.25\n"), shares);
    EXPECT_EQ(colors_of("double", "0 0 0 0 127.6 255\n1 0 0 300 nan 64\n"), shares);
    EXPECT_EQ(colors_of("float", "0 0 0 0 0.5 1\n1 0 0 inf -inf 0.25\n"), shares);
    EXPECT_EQ(colors_of("float", "0 0 0 0 32896 65535\n1 0 0 65535 0 16448\n"), shares);
    EXPECT_EQ(
        colors_of("float", "0 0 0 0 128 255 1\n1 0 0 255 0 64 0.5\n", "property float alpha\n"),
        (std::vector<Rgba8>{{0, 128, 255, 255}, {255, 0, 64, 128}}));
}

TEST(PlyColumns, TellsWhatFloatColoursHaveBeyond8Bits) {
    EXPECT_TRUE(lost_of("float", "0 0 0 0 0.501961 1\n1 0 0 0.2 nan 0.00392157\n").empty());
    EXPECT_TRUE(lost_of("float", "0 0 0 0 128 255\n1 0 0 1 2 3\n").empty());
    for (const std::string rows : {"0 0 0 0 0.5 1\n1 0 0 0 0 0\n", "0 0 0 0 0 1.2\n1 0 0 0 0 0\n",
                                   "0 0 0 0 128.5 255\n1 0 0 0 0 0\n"})
        EXPECT_EQ(lost_of("float", rows),
                  std::vector<std::string>{"what float colours have beyond 8 bits"})
            << rows;
}

TEST(PlyColumns, TakesAnExactNameBeforeOneInCapitals) {
    const PointCloud cloud =
        decode(ascii("element vertex 1\nproperty int X\nproperty int Y\nproperty int Z\n" + kXyz +
                         "property uchar r\nproperty uchar g\nproperty uchar b\nproperty float A\n",
                     "7 8 9 1 2 3 10 20 30 451.5\n"));
    EXPECT_EQ(cloud.positions.at(0), Vec3f(1, 2, 3));
    EXPECT_EQ(values<std::int32_t>(cloud, "X").at(0), 7);
    EXPECT_EQ(cloud.colors.at(0), (Rgba8{10, 20, 30, 255}));
    EXPECT_FALSE(cloud.has_alpha);
    EXPECT_EQ(values<float>(cloud, "A").at(0), 451.5F) << "no alpha of r, g and b";
}

TEST(PlyColumns, KeepsWholeNumbersThatMayBeLabelsAsThoseOfPoints) {
    const auto reduction_of = [](const std::string& type, const std::string& rows) {
        return decode(ascii("element vertex 2\n" + kXyz + "property " + type + " s\n", rows))
            .attributes.at(0)
            .reduction;
    };
    for (const std::string type : {"float", "double", "int64", "uint64", "int"})
        EXPECT_EQ(reduction_of(type, "0 0 0 2\n1 0 0 6\n"), Reduction::Nearest) << type;
    for (const std::string type : {"float", "double"}) {
        EXPECT_EQ(reduction_of(type, "0 0 0 2\n1 0 0 nan\n"), Reduction::Nearest) << type;
        EXPECT_EQ(reduction_of(type, "0 0 0 2\n1 0 0 6.5\n"), Reduction::Mean) << type;
    }
}

TEST(PlyColumns, TellsOf64BitIntegersThatNoDoubleHolds) {
    const auto lost = [](const std::string& property, const std::string& value) {
        DecodeReport report;
        decode(ascii("element vertex 2\n" + kXyz + "property " + property + "\n",
                     "0 0 0 " + value + "\n0 0 0 " + value + "\n"),
               &report);
        return report.skipped;
    };
    const std::vector<std::string> digits{"digits of id beyond 2^53"};
    EXPECT_EQ(lost("int64 id", "9007199254740993"), digits);
    EXPECT_EQ(lost("int64 id", "-9007199254740993"), digits);
    EXPECT_EQ(lost("uint64 id", "18446744073709551615"), digits);
    EXPECT_EQ(lost("list uchar int64 id", "1 9007199254740993"), digits);
    for (const std::string held : {"9007199254740992", "-9007199254740994", "-9223372036854775808"})
        EXPECT_TRUE(lost("int64 id", held).empty()) << held;
    EXPECT_TRUE(lost("double id", "9007199254740993").empty());

    std::string binary = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n" + kXyz +
                         "property int64 id\nend_header\n";
    binary += std::string(12, '\0');
    append(binary, (std::int64_t{1} << 53) + 1);
    DecodeReport report;
    decode(binary, &report);
    EXPECT_EQ(report.skipped, digits);
}

TEST(PlyColumns, TellsTheNamesThatHadToBeChanged) {
    DecodeReport report;
    const PointCloud cloud =
        decode(ascii("element vertex 1\n" + kXyz + "property float 强度\nproperty float h\n",
                     "0 0 0 1 2\n"),
               &report);
    EXPECT_EQ(cloud.attributes.at(0).name, "attribute");
    EXPECT_EQ(report.skipped, std::vector<std::string>{"name 强度 → attribute"});
}

TEST(PlyColumns, LeavesOutNothingOfAnElementThatIsEmpty) {
    DecodeReport report;
    decode(ascii("element vertex 1\n" + kXyz +
                     "element face 0\nproperty list uchar int vertex_indices\n",
                 "0 0 0\n"),
           &report);
    EXPECT_TRUE(report.skipped.empty());
}

TEST(PlyColumns, ReadsCoordinatesColorsNormalsAndScalarsByTheirUsualNames) {
    const PointCloud cloud =
        decode(ascii("element vertex 1\nproperty float nx\nproperty float ny\nproperty float "
                     "nz\nproperty double z\nproperty short x\n"
                     "property float y\nproperty uchar r\nproperty ushort g\nproperty float "
                     "b\nproperty uchar a\nproperty short k\n",
                     "0 0 1 3.5 -1 2 10 65535 0.5 77 -9\n"));
    ASSERT_EQ(cloud.size(), 1U);
    EXPECT_EQ((cloud.origin + cloud.positions[0].cast<double>()).eval(), Vec3d(-1, 2, 3.5));
    EXPECT_EQ(cloud.normals.at(0), Vec3f(0, 0, 1));
    EXPECT_EQ(cloud.colors.at(0), (Rgba8{10, 255, 128, 77}));
    EXPECT_TRUE(cloud.has_alpha);
    EXPECT_EQ(values<std::int16_t>(cloud, "k").at(0), -9);
}

TEST(PlyColumns, KnowsColoursByOtherUsualNames) {
    for (const auto& names : {std::array{"Red", "Green", "Blue"},
                              {"R", "G", "B"},
                              {"diffuse_r", "diffuse_g", "diffuse_b"}}) {
        std::string elements = "element vertex 1\n" + kXyz;
        for (const std::string name : names) elements += "property uchar " + name + "\n";
        EXPECT_EQ(decode(ascii(elements, "0 0 0 1 2 3\n")).colors,
                  (std::vector<Rgba8>{{1, 2, 3, 255}}))
            << names[0];
    }
}

TEST(PlyColumns, PrefersRedGreenBlueAndKeepsASecondFamilyAsAttributes) {
    const PointCloud cloud = decode(
        ascii("element vertex 1\n" + kXyz +
                  "property uchar diffuse_red\nproperty uchar diffuse_green\nproperty uchar "
                  "diffuse_blue\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n",
              "0 0 0 1 2 3 4 5 6\n"));
    EXPECT_EQ(cloud.colors.at(0), (Rgba8{4, 5, 6, 255}));
    EXPECT_FALSE(cloud.has_alpha);
    EXPECT_EQ(values<std::uint8_t>(cloud, "diffuse_blue").at(0), 3);
}

TEST(PlyColumns, KeepsAnIncompleteColorAsAttribute) {
    const PointCloud cloud =
        decode(ascii("element vertex 1\n" + kXyz + "property uchar red\n", "0 0 0 9\n"));
    EXPECT_TRUE(cloud.colors.empty());
    EXPECT_EQ(values<std::uint8_t>(cloud, "red").at(0), 9);
}

TEST(PlyColumns, KeepsListsOfOneLengthAndReportsTheOthers) {
    const std::string header = "element vertex 2\n" + kXyz + "property list uchar short w\n";
    DecodeReport report;
    const PointCloud even = decode(ascii(header, "0 0 0 2 1 2\n1 1 1 2 3 4\n"), &report);
    EXPECT_EQ(values<std::int16_t>(even, "w"), (std::vector<std::int16_t>{1, 2, 3, 4}));
    EXPECT_EQ(even.attributes[0].components, 2U);
    EXPECT_TRUE(report.skipped.empty());
    const PointCloud uneven = decode(ascii(header, "0 0 0 2 1 2\n1 1 1 1 3\n"), &report);
    EXPECT_TRUE(uneven.attributes.empty());
    EXPECT_EQ(uneven.positions[1], Vec3f(1, 1, 1));
    EXPECT_EQ(report.skipped, std::vector<std::string>{"vertex.w"});
}

}  // namespace
}  // namespace stipple
