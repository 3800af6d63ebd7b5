#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "support/expect_error.hpp"
#include "support/ply_text.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <bit>
#include <cmath>
#include <cstring>
#include <random>
#include <string_view>

namespace stipple {
namespace {

using namespace stipple::test;

std::string message_of(std::string_view text) {
    try {
        decode(text);
    } catch (const Error& error) {
        return error.what();
    }
    return "no error";
}

bool same_bits(std::span<const Vec3f> a, std::span<const Vec3f> b) {
    return a.size() == b.size() &&
           (a.empty() || std::memcmp(a.data(), b.data(), a.size_bytes()) == 0);
}

void expect_same(const PointCloud& a, const PointCloud& b) {
    EXPECT_EQ(a.origin, b.origin);
    EXPECT_TRUE(same_bits(a.positions, b.positions));
    EXPECT_TRUE(same_bits(a.normals, b.normals));
    EXPECT_EQ(a.colors, b.colors);
    EXPECT_EQ(a.has_alpha, b.has_alpha);
    EXPECT_EQ(a.double_precision, b.double_precision);
    ASSERT_EQ(a.attributes.size(), b.attributes.size());
    for (std::size_t i = 0; i < a.attributes.size(); ++i) {
        EXPECT_EQ(a.attributes[i].name, b.attributes[i].name);
        EXPECT_EQ(a.attributes[i].components, b.attributes[i].components);
        EXPECT_EQ(a.attributes[i].values, b.attributes[i].values) << a.attributes[i].name;
    }
}

/// Every type of attribute, with the ends of its range.
PointCloud cloud_of_every_type() {
    PointCloud cloud = test::with_attributes(test::sphere(3));
    const auto add = [&]<typename T>(std::string name, T low, T middle, T high) {
        AttributeValues values = std::vector<T>{low, middle, high};
        const Reduction reduction = default_reduction(values);
        cloud.attributes.push_back({std::move(name), std::move(values), 1, reduction});
    };
    add("i8", std::int8_t{-128}, std::int8_t{0}, std::int8_t{127});
    add("u8", std::uint8_t{0}, std::uint8_t{9}, std::uint8_t{255});
    add("i16", std::int16_t{-32768}, std::int16_t{1}, std::int16_t{32767});
    add("u16", std::uint16_t{0}, std::uint16_t{1}, std::uint16_t{65535});
    add("i32", std::numeric_limits<std::int32_t>::min(), 0,
        std::numeric_limits<std::int32_t>::max());
    add("u32", std::uint32_t{0}, std::uint32_t{7}, std::numeric_limits<std::uint32_t>::max());
    add("f32", -1.17549435e-38F, 0.1F, 3.4028235e38F);
    add("f64", -0.1, 1e300, 4.9e-324);
    cloud.attributes.push_back({"pair", std::vector<double>{1, 2, 3, 4, 5, 6}, 2, Reduction::Mean});
    return cloud;
}

class PlyRoundTrip : public testing::TestWithParam<PlyEncoding> {};

TEST_P(PlyRoundTrip, KeepsEveryBitOfEveryType) {
    const PointCloud cloud = cloud_of_every_type();
    expect_same(decode_cloud(encode_ply(cloud, {.encoding = GetParam(), .comments = {}})), cloud);
}

TEST_P(PlyRoundTrip, KeepsAnEmptyCloudAndItsProperties) {
    PointCloud cloud;
    cloud.attributes.push_back({"label", std::vector<std::int32_t>{}, 1, Reduction::Nearest});
    const PointCloud back =
        decode_cloud(encode_ply(cloud, {.encoding = GetParam(), .comments = {}}));
    EXPECT_EQ(back.size(), 0U);
    EXPECT_NE(find_attribute(back, "label"), nullptr);
}

std::string ply_of_doubles(std::span<const Vec3d> points) {
    std::string file = "ply\nformat binary_little_endian 1.0\nelement vertex " +
                       std::to_string(points.size()) +
                       "\nproperty double x\nproperty double y\nproperty double z\nend_header\n";
    for (const Vec3d& p : points)
        for (int axis = 0; axis < 3; ++axis) append(file, p[axis]);
    return file;
}

double largest_difference(const PointCloud& cloud, std::span<const Vec3d> points) {
    double largest = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
        const Vec3d back = cloud.origin + cloud.positions[i].cast<double>();
        largest = std::max(largest, (back - points[i]).cwiseAbs().maxCoeff());
    }
    return largest;
}

TEST_P(PlyRoundTrip, KeepsGeoreferencedCoordinatesWithinFloatPrecisionOfTheExtent) {
    std::mt19937_64 random(7);
    std::uniform_real_distribution<double> east(635'000.0, 637'000.0), north(848'000.0, 850'000.0),
        up(400, 600);
    std::vector<Vec3d> points(5'000);
    for (Vec3d& p : points) p = {east(random), north(random), up(random)};
    const PointCloud first = decode(ply_of_doubles(points));
    EXPECT_TRUE(first.double_precision);
    const auto once = encode_ply(first, {.encoding = GetParam(), .comments = {}});
    const PointCloud second = decode_cloud(once);
    ASSERT_EQ(second.size(), points.size());
    EXPECT_LE(largest_difference(second, points), 2048 * 0x1p-23);
    EXPECT_EQ(encode_ply(second, {.encoding = GetParam(), .comments = {}}), once)
        << "the second round trip changes bits";
}

TEST_P(PlyRoundTrip, KeepsThemThoughAPointOfNothingSeenLiesAtZero) {
    std::mt19937_64 random(7);
    std::uniform_real_distribution<double> off(0, 2);
    std::vector<Vec3d> points(2'000);
    for (Vec3d& p : points) p = Vec3d(635'000, 848'000, 400) + Vec3d(off(random), off(random), 0);
    points[77].setZero();
    const PointCloud first = decode(ply_of_doubles(points));
    const PointCloud second =
        decode_cloud(encode_ply(first, {.encoding = GetParam(), .comments = {}}));
    ASSERT_EQ(second.size(), points.size());
    points[77] = second.origin + second.positions[77].cast<double>();
    EXPECT_LE(points[77].norm(), 1e6 * 0x1p-23);
    EXPECT_LE(largest_difference(second, points), 4 * 0x1p-23);
}

std::string name_of_encoding(const testing::TestParamInfo<PlyEncoding>& encoding) {
    switch (encoding.param) {
        case PlyEncoding::BinaryLittleEndian:
            return "LittleEndian";
        case PlyEncoding::BinaryBigEndian:
            return "BigEndian";
        case PlyEncoding::Ascii:
            break;
    }
    return "Ascii";
}

INSTANTIATE_TEST_SUITE_P(Encodings, PlyRoundTrip,
                         testing::Values(PlyEncoding::Ascii, PlyEncoding::BinaryLittleEndian,
                                         PlyEncoding::BinaryBigEndian),
                         name_of_encoding);

TEST(PlyReader, SkipsElementsBeforeAndAfterTheVerticesExactly) {
    for (const bool big : {false, true}) {
        std::string file =
            std::string("ply\nformat binary_") + (big ? "big" : "little") +
            "_endian 1.0\ncomment  a remark \nobj_info by hand\nelement face 2\nproperty list "
            "ushort int i\n"
            "property uchar flag\nelement nothing 3\nelement vertex 2\n" +
            kXyz +
            "property int label\nelement edge 1\nproperty int a\nproperty int b\nend_header\n";
        for (const std::uint16_t length : {std::uint16_t{3}, std::uint16_t{0}}) {
            append(file, length, big);
            for (int i = 0; i < length; ++i) append(file, i, big);
            append(file, std::uint8_t{1});
        }
        for (int p = 0; p < 2; ++p) {
            for (int axis = 0; axis < 3; ++axis) append(file, float(10 * p + axis), big);
            append(file, 1000 + p, big);
        }
        append(file, std::int64_t{0});
        DecodeReport report;
        const PointCloud cloud = decode(file, &report);
        ASSERT_EQ(cloud.size(), 2U);
        EXPECT_EQ(cloud.positions[1], Vec3f(10, 11, 12));
        EXPECT_EQ(values<std::int32_t>(cloud, "label"), (std::vector<std::int32_t>{1000, 1001}));
        EXPECT_EQ(report.faces, 2U);
        EXPECT_EQ(report.comments, (std::vector<std::string>{"a remark", "by hand"}));
        EXPECT_EQ(report.skipped, (std::vector<std::string>{"face.i", "nothing", "edge"}));
    }
}

TEST(PlyReader, TakesCarriageReturnsTabsAndBlanksInTheHeader) {
    for (const std::string_view line_end : {"\n", "\r\n", "\r"}) {
        std::string file;
        for (const std::string_view line :
             {"ply", " format\tbinary_little_endian   1.0 ", "", "comment x", "\telement vertex 1",
              "property float  x", "property float y\t", "property float z", "end_header"}) {
            file.append(line).append(line_end);
        }
        // A body that starts like a line end must not be taken for one.
        append(file, std::bit_cast<float>(0x0a0d0a0dU));
        append(file, 2.0F);
        append(file, 3.0F);
        const PointCloud cloud = decode(file);
        ASSERT_EQ(cloud.size(), 1U);
        EXPECT_EQ(std::bit_cast<std::uint32_t>(cloud.positions[0].x()), 0x0a0d0a0dU);
        EXPECT_EQ(cloud.positions[0].z(), 3.0F);
    }
}

TEST(PlyReader, PassesAnEmptyLineBeforeABinaryBodyOnlyWhenTheFileFitsSo) {
    std::string header =
        "ply\nformat binary_little_endian 1.0\nelement vertex 1\n" + kXyz + "end_header\n";
    std::string body;
    append(body, std::bit_cast<float>(0x4000000aU));
    append(body, 2.0F);
    append(body, 3.0F);
    EXPECT_EQ(decode(header + body).positions.at(0).y(), 2.0F);
    EXPECT_EQ(decode(header + "\n" + body).positions.at(0).y(), 2.0F);
}

TEST(PlyReader, LetsUnknownLinesPassBeforeTheFirstElementAndReportsThem) {
    DecodeReport report;
    EXPECT_EQ(
        decode("ply\nformat ascii 1.0\nbye\nelement vertex 1\n" + kXyz + "end_header\n1 2 3\n",
               &report)
            .size(),
        1U);
    EXPECT_EQ(report.skipped, std::vector<std::string>{"header line 3: 'bye'"});
}

TEST(PlyReader, TakesTheOddNumbersThatProgramsPrint) {
    const PointCloud cloud =
        decode(ascii("element vertex 4\n" + kXyz + "property uchar c\n",
                     "+1 1e-3 -1.5E+2 255.0\nnan inf -inf 1\n1.#INF -1.#IND -1.#INF 2\n"
                     "1e60 -1e-60 .5 3"));
    EXPECT_EQ(cloud.positions[0], Vec3f(1, 1e-3F, -150));
    EXPECT_EQ(values<std::uint8_t>(cloud, "c"), (std::vector<std::uint8_t>{255, 1, 2, 3}));
    EXPECT_TRUE(std::isnan(cloud.positions[1].x()));
    EXPECT_EQ(cloud.positions[1].z(), -std::numeric_limits<float>::infinity());
    EXPECT_EQ(cloud.positions[2].x(), std::numeric_limits<float>::infinity());
    EXPECT_TRUE(std::isnan(cloud.positions[2].y()));
    EXPECT_EQ(cloud.positions[3], Vec3f(std::numeric_limits<float>::infinity(), 0, 0.5F));
}

TEST(PlyReader, ReadsTextThatIsNotOneVertexALine) {
    const std::string header =
        "element vertex 3\n" + kXyz + "element face 1\nproperty list uchar int i\n";
    const PointCloud expected = decode(ascii(header, "1 2 3\n4 5 6\n7 8 9\n3 0 1 2\n"));
    EXPECT_EQ(expected.positions[2], Vec3f(7, 8, 9));
    for (const std::string_view body :
         {"1 2 3 4 5 6 7 8 9 3 0 1 2", "1\n2\n3 4 5\n6 7 8 9\n\n3 0 1\n2",
          "\n1 2 3\n\n4 5 6\n \n7 8 9\n3 0 1 2\n"}) {
        expect_same(decode(ascii(header, body)), expected);
    }
}

TEST(PlyReader, RefusesLinesWithMoreValuesThanTheHeaderDeclares) {
    const std::string header = "element vertex 4\n" + kXyz;
    for (const std::string_view body : {"1 2 3 9\n4 5 6 9\n7 8 9 9\n1 1 1 9\n",
                                        "1 2 3 7 7 7\n4 5 6 7 7 7\n7 8 9 7 7 7\n1 1 1 7 7 7\n",
                                        "1 2 3 99\n4 5 6\n7 8 9\n1 1 1\n"}) {
        EXPECT_NE(message_of(ascii(header, body)).find("more values than the 3"),
                  std::string::npos);
    }
}

TEST(PlyReader, NamesWhatFollowsTheLastVertex) {
    const std::string header = "element vertex 2\n" + kXyz;
    const auto skipped = [&](const std::string& text) {
        DecodeReport report;
        decode(text, &report);
        return report.skipped;
    };
    EXPECT_EQ(skipped(ascii(header, "1 2 3\n4 5 6\n\n \n")), std::vector<std::string>{});
    EXPECT_EQ(skipped(ascii(header, "1 2 3\n4 5 6\n7 8 9\n\n1 1 1")),
              std::vector<std::string>{"2 lines after the last vertex"});
    EXPECT_EQ(skipped(ascii(header, "1 2 3\n\n4 5 6\n7 8 9\n")),
              std::vector<std::string>{"1 line after the last vertex"});
    std::string binary = text_of(encode_ply(test::sphere(5)));
    EXPECT_EQ(skipped(binary + "\n"), std::vector<std::string>{});
    EXPECT_EQ(skipped(binary + std::string(24, 'x')),
              std::vector<std::string>{"24 bytes after the last vertex"});
}

TEST(PlyReader, NamesWhatIsBeyondTheHeaderAlsoWhereFacesFollow) {
    const std::string header =
        "element vertex 2\n" + kXyz + "element face 2\nproperty list uchar int i\n";
    const auto skipped = [](const std::string& text) {
        DecodeReport report;
        decode(text, &report);
        return report.skipped;
    };
    const std::string list = "face.i";
    const std::vector<std::string> only{list};
    const std::string points = "1 2 3\n4 5 6\n", faces = "3 0 1 2\n3 2 1 0\n";
    EXPECT_EQ(skipped(ascii(header, points + faces + "\n")), only);
    EXPECT_EQ(skipped(ascii(header, points + "3 0 1\n2\n3 2 1 0")), only);
    EXPECT_EQ(skipped(ascii(header, points + ".7 .8 .9\n" + faces)),
              (std::vector<std::string>{list, "1 line beyond all that the header declares"}));
    EXPECT_EQ(skipped(ascii(header, points + faces + "\n" + faces)),
              (std::vector<std::string>{list, "2 lines beyond all that the header declares"}));
    EXPECT_EQ(skipped(ascii(header, "1 2 3\n\n4 5 6\n" + faces + faces)),
              (std::vector<std::string>{list, "2 lines beyond all that the header declares"}));

    std::string binary = "ply\nformat binary_little_endian 1.0\n" + header + "end_header\n";
    for (int i = 0; i < 6; ++i) append(binary, 1.0F);
    binary += std::string(2, '\0');  // faces without corners
    EXPECT_EQ(skipped(binary), only);
    EXPECT_EQ(skipped(binary + "\n"), only);
    EXPECT_EQ(skipped(binary + std::string(3, 'x')),
              (std::vector<std::string>{list, "3 bytes beyond all that the header declares"}));
}

TEST(PlyReader, ReadsLongTextAlikeOnAnyNumberOfThreads) {
    const PointCloud cloud = test::with_attributes(test::sphere(60'000, 0.1));
    std::string text = text_of(encode_ply(cloud, {.encoding = PlyEncoding::Ascii, .comments = {}}));
    for (const unsigned threads : {1U, 2U, 7U}) expect_same(decode(text, nullptr, threads), cloud);
    // A blank line anywhere sends the reader another way to the same cloud.
    text.insert(text.find('\n', text.size() / 2), "\n");
    expect_same(decode(text, nullptr, 2), cloud);
}

TEST(PlyReader, NamesTheFirstBadLineOnAnyNumberOfThreads) {
    std::string text =
        text_of(encode_ply(test::sphere(60'000), {.encoding = PlyEncoding::Ascii, .comments = {}}));
    const std::size_t middle = text.find('\n', text.size() / 2) + 1;
    text[middle + 3] = '?';
    text[text.find('\n', text.size() - 200) + 4] = '?';
    const auto line =
        1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(middle), '\n');
    for (const unsigned threads : {1U, 2U}) {
        try {
            decode(text, nullptr, threads);
            FAIL() << "accepted";
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ErrorCode::MalformedInput);
            EXPECT_NE(std::string_view(error.what()).find("line " + std::to_string(line) + " "),
                      std::string::npos)
                << error.what();
        }
    }
}

TEST(PlyReader, CountsLinesThatEndInCarriageReturnsAndKeepsCommentsOnOneLine) {
    std::string text = ascii("element vertex 2\n" + kXyz, "0 0 0\n1 zwei 3\n");
    std::ranges::replace(text, '\n', '\r');
    test::expect_error(ErrorCode::MalformedInput, "line 9 (vertex 1, property y)",
                       [&] { decode(text); });
    DecodeReport report;
    const PointCloud cloud =
        decode(ascii("comment a\rb\nelement vertex 1\n" + kXyz, "0 0 0\n"), &report);
    EXPECT_EQ(report.comments, std::vector<std::string>{"a b"});
    EXPECT_NO_THROW(encode_ply(cloud, {.encoding = {}, .comments = report.comments}));
}

TEST(PlyReader, PlacesCloudsByTheirFinitePointsAlone) {
    PointCloud cloud = test::sphere(101);
    cloud.double_precision = true;
    const std::vector<std::byte> file = encode_ply(cloud);
    std::string text = text_of(file);
    const std::size_t last = text.size() - 3 * sizeof(double);
    const double none[] = {std::numeric_limits<double>::quiet_NaN(), 1e300, 0};
    std::memcpy(&text[last], none, sizeof none);
    const PointCloud read = decode(text);
    EXPECT_EQ(read.size(), 101U);
    EXPECT_LT(read.positions[0].norm(), 10);
}

TEST(PlyReader, RefusesMoreElementsThanAnyFileHas) {
    std::string elements;
    for (int i = 0; i < 5000; ++i) elements += "element e" + std::to_string(i) + " 0\n";
    test::expect_error(ErrorCode::MalformedInput, "more than 4096 elements",
                       [&] { decode(ascii(elements, "")); });
}

TEST(PlyReader, RejectsAHeaderThatPromisesMorePointsThanTheFileHolds) {
    EXPECT_NE(
        message_of("ply\nformat binary_little_endian 1.0\nelement vertex 190000000\n" + kXyz +
                   "end_header\n123456789012")
            .find(
                "declares 190000000 of element 'vertex', 12 bytes each, but only 12 bytes follow"),
        std::string::npos);
}

TEST(PlyReader, RefusesCoordinatesThatSinglePrecisionTakesForOnePlace) {
    const std::string doubles =
        "element vertex 2\nproperty double x\nproperty double y\nproperty double z\n";
    EXPECT_NE(message_of(ascii(doubles, "1e-50 0 0\n0 1e-200 0\n")).find("spread over 1e-50"),
              std::string::npos);
    EXPECT_EQ(decode(ascii(doubles, "1e-50 1e9 0\n1e-50 1e9 0\n")).size(), 2U);
}

TEST(PlyReader, NamesTheLimitThatACloudIsOver) {
    const std::string file = ascii("element vertex 3\n" + kXyz + "property int a\nproperty int b\n",
                                   "0 0 0 1 2\n1 0 0 1 2\n2 0 0 1 2\n");
    const auto message_under = [&](const DecodeLimits& limits) -> std::string {
        try {
            decode_cloud(bytes_of(file), limits);
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ErrorCode::TooLarge);
            return error.what();
        }
        return "";
    };
    EXPECT_EQ(message_under({.max_points = 3, .max_attributes = 2}), "");
    EXPECT_NE(message_under({.max_points = 2, .max_attributes = 2})
                  .find("3 vertices: expected at most 2"),
              std::string::npos);
    EXPECT_NE(message_under({.max_points = 3, .max_attributes = 1}).find("expected at most 1"),
              std::string::npos);
}

TEST(PlyReader, StopsWhenAsked) {
    std::stop_source source;
    source.request_stop();
    RunContext context;
    context.stop = source.get_token();
    EXPECT_THROW(decode_cloud(encode_ply(test::sphere(10)), {}, context), Cancelled);
}

TEST(PlyReader, GivesACloudOrAnErrorForEveryTruncation) {
    PointCloud cloud = cloud_of_every_type();
    for (const PlyEncoding encoding :
         {PlyEncoding::Ascii, PlyEncoding::BinaryLittleEndian, PlyEncoding::BinaryBigEndian}) {
        for (const bool lists : {true, false}) {
            if (!lists)
                std::erase_if(cloud.attributes,
                              [](const Attribute& a) { return a.components > 1; });
            const auto whole = encode_ply(cloud, {.encoding = encoding, .comments = {}});
            for (std::size_t size = 0; size < whole.size(); ++size) {
                // A copy of its own, so that a sanitizer sees a read past the end.
                const std::vector<std::byte> cut(whole.begin(),
                                                 whole.begin() + static_cast<std::ptrdiff_t>(size));
                try {
                    const PointCloud got = decode_cloud(cut);
                    // Text may lose the end of its last number and no more.
                    EXPECT_EQ(encoding, PlyEncoding::Ascii);
                    EXPECT_EQ(got.size(), cloud.size());
                    EXPECT_GE(size + 7, whole.size());
                } catch (const Error& error) {
                    EXPECT_NE(error.code(), ErrorCode::Internal);
                }
            }
        }
        cloud = cloud_of_every_type();
    }
}

TEST(PlyWriter, RefusesNamesThatCannotBeReadBack) {
    PointCloud cloud = test::sphere(1);
    const auto refuses = [&](const std::string& name, std::string_view part) {
        cloud.attributes = {{name, std::vector<float>{1}, 1, Reduction::Mean}};
        test::expect_refused(part, [&] { encode_ply(cloud); });
    };
    for (const std::string name : {"", "two words", "line\nbreak"})
        refuses(name, "expected a name of");
    refuses("x", "attribute 'x': a PLY file would have two properties of this name");
    test::expect_refused("comment 'a\\x0aend_header': expected a single line", [&] {
        encode_ply(test::sphere(1),
                   {.encoding = PlyEncoding::Ascii, .comments = {"a\nend_header"}});
    });
}

TEST(PlyWriter, WritesTheSameBytesOnAnyNumberOfThreads) {
    const PointCloud cloud = test::with_attributes(test::sphere(50'000, 0.1));
    for (const PlyEncoding encoding : {PlyEncoding::Ascii, PlyEncoding::BinaryLittleEndian}) {
        RunContext one, three;
        one.threads = 1;
        three.threads = 3;
        EXPECT_EQ(encode_ply(cloud, {.encoding = encoding, .comments = {}}, one),
                  encode_ply(cloud, {.encoding = encoding, .comments = {}}, three));
    }
}

}  // namespace
}  // namespace stipple
