#include "base/random.hpp"
#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <draco/compression/expert_encode.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <numeric>
#include <random>
#include <set>
#include <utility>

namespace stipple {
namespace {

/// A point with all its values, to compare clouds whose order the coding changed.
using Row = std::vector<double>;

std::vector<Row> rows_of(const PointCloud& cloud) {
    std::vector<Row> rows(cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        for (int axis = 0; axis < 3; ++axis) rows[i].push_back(cloud.positions[i][axis]);
        if (!cloud.colors.empty()) {
            const Rgba8 c = cloud.colors[i];
            rows[i].insert(rows[i].end(), {double(c.r), double(c.g), double(c.b), double(c.a)});
        }
        for (const Attribute& attribute : cloud.attributes) {
            std::visit(
                [&](const auto& v) {
                    for (unsigned c = 0; c < attribute.components; ++c)
                        rows[i].push_back(double(v[i * attribute.components + c]));
                },
                attribute.values);
        }
    }
    return rows;
}

std::vector<Row> sorted(std::vector<Row> rows) {
    std::ranges::sort(rows);
    return rows;
}

template <typename T>
void add(PointCloud& cloud, std::string name, std::vector<T> values, unsigned components = 1) {
    AttributeValues any = std::move(values);
    const Reduction reduction = default_reduction(any);
    cloud.attributes.push_back({std::move(name), std::move(any), components, reduction});
}

/// Every integer type from end to end of its range.
PointCloud cloud_of_integers(std::size_t n) {
    PointCloud cloud = test::cube(n);
    const auto ramp = [n]<typename T>(T) {
        std::vector<T> values(n);
        const double low = std::numeric_limits<T>::min(), high = std::numeric_limits<T>::max();
        for (std::size_t i = 0; i < n; ++i) {
            values[i] = static_cast<T>(
                std::floor(low + (high - low) * double((i * 7919) % n) / double(n - 1)));
        }
        return values;
    };
    add(cloud, "i8", ramp(std::int8_t{}));
    add(cloud, "u8", ramp(std::uint8_t{}));
    add(cloud, "i16", ramp(std::int16_t{}));
    add(cloud, "u16", ramp(std::uint16_t{}));
    add(cloud, "i32", ramp(std::int32_t{}));
    add(cloud, "u32", ramp(std::uint32_t{}));
    add(cloud, "small_u32", std::vector<std::uint32_t>(n, 5));
    return cloud;
}

PointCloud round_trip(const PointCloud& cloud, const DracoEncodeOptions& options,
                      DecodeReport* report = nullptr) {
    return decode_cloud(encode_draco(cloud, options), {}, {}, report);
}

TEST(Draco, KeepsEveryBitInOrderWhenNothingIsQuantized) {
    PointCloud cloud = cloud_of_integers(1000);
    std::vector<float> floats;
    std::vector<double> doubles;
    for (const Vec3f& p : cloud.positions) {
        floats.push_back(p.x() / 3);
        doubles.insert(doubles.end(), {p.x() / 3.0, 1e300 * p.y(), -p.z()});
    }
    floats[5] = std::numeric_limits<float>::quiet_NaN();
    floats[6] = std::numeric_limits<float>::infinity();
    add(cloud, "floats", floats);
    add(cloud, "doubles", doubles, 3);
    DecodeReport report;
    const PointCloud back = round_trip(cloud,
                                       {.coding = DracoCoding::Sequential,
                                        .position_bits = 0,
                                        .precision = {},
                                        .attribute_bits = 0},
                                       &report);
    EXPECT_EQ(report.encoding, "sequential");
    EXPECT_EQ(report.points, cloud.size());
    ASSERT_EQ(back.size(), cloud.size());
    EXPECT_EQ(
        std::memcmp(back.positions.data(), cloud.positions.data(), cloud.size() * sizeof(Vec3f)),
        0);
    ASSERT_EQ(back.attributes.size(), cloud.attributes.size());
    for (std::size_t i = 0; i < cloud.attributes.size(); ++i) {
        EXPECT_EQ(back.attributes[i].name, cloud.attributes[i].name);
        EXPECT_EQ(back.attributes[i].components, cloud.attributes[i].components);
        if (cloud.attributes[i].name == "floats") {
            const auto& got = std::get<std::vector<float>>(back.attributes[i].values);
            EXPECT_EQ(std::memcmp(got.data(), floats.data(), floats.size() * sizeof(float)), 0);
        } else {
            EXPECT_EQ(back.attributes[i].values, cloud.attributes[i].values)
                << cloud.attributes[i].name;
        }
    }
}

TEST(Draco, KeepsWholeNumbersThatAreWrittenAsFloats) {
    PointCloud cloud = test::sphere(100'000);
    std::vector<float> labels(cloud.size()), numbers(cloud.size()), shares(cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        labels[i] = static_cast<float>(i % 7);
        numbers[i] = static_cast<float>(i) - 5;
        shares[i] = static_cast<float>(i) / 3;
    }
    add(cloud, "labels", labels);
    add(cloud, "numbers", numbers);
    add(cloud, "shares", shares);
    add(cloud, "large", std::vector<float>(cloud.size(), 3e9F));
    std::vector<float> gaps = labels;
    gaps[77] = -99'999'999;
    add(cloud, "gaps", gaps);
    const PointCloud back = round_trip(cloud, {.coding = DracoCoding::Sequential, .precision = {}});
    for (const char* const name : {"labels", "numbers", "large", "gaps"})
        EXPECT_EQ(find_attribute(back, name)->values, find_attribute(cloud, name)->values) << name;
    const auto& coarse = std::get<std::vector<float>>(find_attribute(back, "shares")->values);
    EXPECT_NE(coarse, shares);
}

TEST(Draco, KeepsIntegersNearTheEndsOfTheirRange) {
    PointCloud cloud = test::sphere(3'000);
    using Int32 = std::numeric_limits<std::int32_t>;
    for (const std::int32_t spread : {1, 1'000, 65'535, (1 << 24) - 1}) {
        std::vector<std::int32_t> low(cloud.size()), high(cloud.size());
        std::vector<std::uint32_t> middle(cloud.size());
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            const auto at = static_cast<std::int32_t>(random_bits(5, i) %
                                                      (static_cast<std::uint64_t>(spread) + 1));
            low[i] = Int32::min() + at;
            high[i] = Int32::max() - at;
            middle[i] = static_cast<std::uint32_t>(Int32::max()) + static_cast<std::uint32_t>(at);
        }
        cloud.attributes.clear();
        add(cloud, "low", low);
        add(cloud, "high", high);
        add(cloud, "middle", middle);
        for (const DracoCoding coding : {DracoCoding::Sequential, DracoCoding::Auto}) {
            const PointCloud back = round_trip(cloud, {.coding = coding, .precision = {}});
            std::vector<Row> rows = rows_of(cloud), rows_back = rows_of(back);
            for (std::vector<Row>* const all : {&rows, &rows_back})
                for (Row& row : *all) row.erase(row.begin(), row.begin() + 3);
            EXPECT_EQ(sorted(rows_back), sorted(rows)) << spread;
        }
    }
}

TEST(Draco, KeepsFloatsThatSpreadTooLittleForItsSteps) {
    PointCloud cloud = test::sphere(1'000);
    for (const float scale : {1e-34F, 1e-36F, 1e-40F}) {
        std::vector<float> weights;
        for (const Vec3f& p : cloud.positions) weights.push_back(scale * (1 + p.x()));
        cloud.attributes.clear();
        add(cloud, "weights", weights);
        const PointCloud back =
            round_trip(cloud, {.coding = DracoCoding::Sequential, .precision = {}});
        EXPECT_EQ(back.attributes.at(0).values, cloud.attributes.at(0).values) << scale;
    }
    for (Vec3f& p : cloud.positions) p *= 1e-30F;
    EXPECT_EQ(round_trip(cloud, {.position_bits = 14, .precision = {}}).size(), cloud.size());
    test::expect_refused("position_bits 0 keeps them exactly",
                         [&] { encode_draco(cloud, {.position_bits = 30, .precision = {}}); });
}

TEST(Draco, KeepsEveryIntegerThroughTheKdTreeUpToTheOrder) {
    PointCloud cloud = cloud_of_integers(500);
    std::erase_if(cloud.attributes,
                  [](const Attribute& a) { return a.name == "u32" || a.name == "i32"; });
    for (const Vec3f& p : cloud.positions) {
        cloud.colors.push_back({std::uint8_t(p.x() * 255), std::uint8_t(p.y() * 255), 7, 255});
    }
    DecodeReport report;
    const PointCloud back = round_trip(
        cloud, {.coding = DracoCoding::KdTree, .position_bits = 16, .precision = {}}, &report);
    EXPECT_EQ(report.encoding, "kd-tree");
    // Positions are rounded, so rows are matched by everything else.
    const auto without_positions = [](const PointCloud& c) {
        std::vector<Row> rows = rows_of(c);
        for (Row& row : rows) row.erase(row.begin(), row.begin() + 3);
        return sorted(rows);
    };
    EXPECT_EQ(without_positions(back), without_positions(cloud));
}

TEST(Draco, KeepsColorsWithAndWithoutAlpha) {
    for (const bool alpha : {false, true}) {
        PointCloud cloud = test::with_attributes(test::sphere(100));
        cloud.has_alpha = alpha;
        if (alpha) cloud.colors[3].a = 17;
        const PointCloud back =
            round_trip(cloud, {.coding = DracoCoding::Sequential, .precision = {}});
        EXPECT_EQ(back.colors, cloud.colors);
        EXPECT_EQ(back.has_alpha, alpha);
    }
}

class DracoCodings : public testing::TestWithParam<DracoCoding> {};

TEST_P(DracoCodings, KeepsTenThousandIdenticalPoints) {
    PointCloud cloud;
    cloud.positions.assign(10'000, Vec3f(1.5F, -2.5F, 1e6F));
    EXPECT_EQ(round_trip(cloud, {.coding = GetParam(), .precision = {}}).positions,
              cloud.positions);
    EXPECT_EQ(round_trip(cloud, {.coding = GetParam(), .precision = 1.0}).positions,
              cloud.positions);
}

TEST_P(DracoCodings, KeepsTheCountOfEveryRepeatedPoint) {
    PointCloud cloud = test::cube(300);
    const std::vector<Vec3f> once = cloud.positions;
    for (int copy = 0; copy < 4; ++copy)
        cloud.positions.insert(cloud.positions.end(), once.begin(), once.end());
    std::map<Row, int> counts;
    for (const Row& row :
         rows_of(round_trip(cloud, {.coding = GetParam(), .position_bits = 20, .precision = {}})))
        ++counts[row];
    EXPECT_EQ(counts.size(), 300U);
    for (const auto& [row, count] : counts) EXPECT_EQ(count, 5);
}

TEST_P(DracoCodings, HoldsTheErrorBelowThePrecisionAskedFor) {
    // Far from zero, where single precision is coarse itself.
    for (const double offset : {0.0, 1000.0, -40.0}) {
        PointCloud cloud = test::sphere(2000);
        for (Vec3f& p : cloud.positions) p = 3 * p + Vec3f::Constant(float(offset));
        std::vector<std::int32_t> number(cloud.size());
        for (std::size_t i = 0; i < number.size(); ++i) number[i] = int(i);
        add(cloud, "number", number);
        for (const double precision : {1.0, 0.1, 0.011, 1e-3, 2.5e-4}) {
            const PointCloud back =
                round_trip(cloud, {.coding = GetParam(), .precision = precision});
            ASSERT_EQ(back.size(), cloud.size());
            const auto& order = std::get<std::vector<std::int32_t>>(back.attributes.at(0).values);
            double worst = 0;
            for (std::size_t i = 0; i < back.size(); ++i) {
                const Vec3d error =
                    (back.positions[i] - cloud.positions[std::size_t(order[i])]).cast<double>();
                worst = std::max(worst, error.cwiseAbs().maxCoeff());
            }
            EXPECT_LE(worst, precision) << "offset " << offset;
            EXPECT_GE(worst, precision / 8) << "far more bits than needed";
        }
    }
}

TEST_P(DracoCodings, KeepsTheOthersWhereTheyAreWhenAPointLiesFarOff) {
    PointCloud cloud = test::sphere(2000);
    std::vector<std::int32_t> number(cloud.size());
    std::iota(number.begin(), number.end(), 0);
    add(cloud, "number", number);
    for (const float far : {20.0F, 200.0F, 2e6F}) {
        cloud.positions.back() = Vec3f(-far, 0.1F * far, 0);
        const PointCloud back = round_trip(cloud, {.coding = GetParam(), .precision = {}});
        const auto& order = std::get<std::vector<std::int32_t>>(back.attributes.at(0).values);
        double worst = 0;
        for (std::size_t i = 0; i < back.size(); ++i) {
            const Vec3f error = back.positions[i] - cloud.positions[std::size_t(order[i])];
            worst = std::max(worst, double{error.cwiseAbs().maxCoeff()});
        }
        // The kd-tree holds no floats: what it gives then is rounded where the far point is.
        const bool rounded = GetParam() == DracoCoding::KdTree && far > 1e6F;
        EXPECT_LE(worst, rounded ? 0.5 : 7e-4) << far;
    }
}

TEST_P(DracoCodings, TellsThePointsOfPartsFarApartFromEachOther) {
    PointCloud cloud = test::sphere(2'000);
    const std::size_t half = cloud.size();
    for (std::size_t i = 0; i < half; ++i)
        cloud.positions.push_back(cloud.positions[i] + Vec3f(3e4F, 0, 0));
    DracoEncodeOptions options;
    options.coding = GetParam();
    options.position_bits = 11;
    const PointCloud back = round_trip(cloud, options);
    std::set<std::array<float, 3>> places;
    for (const Vec3f& p : back.positions) places.insert({p.x(), p.y(), p.z()});
    EXPECT_GT(places.size(), cloud.size() / 2);
}

TEST_P(DracoCodings, TellsThePointsOfALongPipeFromEachOtherUnlessFewBitsAreAskedFor) {
    constexpr std::size_t kPoints = 20'000;
    PointCloud cloud;
    for (std::size_t i = 0; i < kPoints; ++i) {
        const double angle = 6.2831853 * random_unit(1, i);
        cloud.positions.emplace_back(static_cast<float>(4'000 * random_unit(2, i)),
                                     static_cast<float>(0.3 * std::cos(angle)),
                                     static_cast<float>(0.3 * std::sin(angle)));
    }
    const auto places = [&](unsigned bits) {
        DracoEncodeOptions options;
        options.coding = GetParam();
        options.position_bits = bits;
        std::set<std::array<float, 3>> found;
        for (const Vec3f& p : round_trip(cloud, options).positions)
            found.insert({p.x(), p.y(), p.z()});
        return found.size();
    };
    EXPECT_GT(places(14), kPoints * 9 / 10);
    EXPECT_LT(places(12), kPoints * 6 / 10);
}

TEST_P(DracoCodings, TellsTheStepsOfItsGrid) {
    PointCloud cloud = test::sphere(2'000);
    for (const unsigned bits : {8U, 12U}) {
        double step = 0;
        const PointCloud back = decode_cloud(encode_draco(
            cloud, {.coding = GetParam(), .position_bits = bits, .precision = {}}, {}, &step));
        ASSERT_GT(step, 0);
        const Vec3d low = bounds(back).min;
        for (const Vec3f& p : back.positions) {
            const Vec3d steps = (p.cast<double>() - low) / step;
            EXPECT_LT((steps - steps.array().round().matrix()).cwiseAbs().maxCoeff(), 0.01);
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Codings, DracoCodings,
                         testing::Values(DracoCoding::Sequential, DracoCoding::KdTree),
                         [](const auto& which) {
                             return which.param == DracoCoding::KdTree ? "KdTree" : "Sequential";
                         });

TEST(Draco, KeepsNormalsWithinTheStepOfTheOctahedron) {
    const PointCloud cloud = test::with_attributes(test::sphere(3000));
    const PointCloud back = round_trip(cloud, {.coding = DracoCoding::Sequential, .precision = {}});
    ASSERT_EQ(back.normals.size(), cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        ASSERT_NEAR(back.normals[i].norm(), 1, 1e-5);
        ASSERT_LT((back.normals[i] - cloud.normals[i]).norm(), 4.0 / 1024) << i;
    }
}

TEST(Draco, HasNoNormalsWhereNoneHasADirection) {
    PointCloud cloud = test::sphere(500);
    cloud.normals.assign(cloud.size(), Vec3f::Zero());
    EXPECT_TRUE(decode_cloud(encode_draco(cloud)).normals.empty());
    cloud.normals[7] = Vec3f::UnitZ();
    EXPECT_EQ(decode_cloud(encode_draco(cloud)).normals.size(), cloud.size());
}

TEST(Draco, TakesNoMoreMemoryForManyBitsThanForFew) {
    // Draco's own table of symbols would have 2^31 entries, 8 GB.
    const auto encode_in_a_gigabyte = [] {
        const rlimit memory{rlim_t{1} << 30, rlim_t{1} << 30};
        if (!test::kSanitized) ::setrlimit(RLIMIT_AS, &memory);
        const PointCloud cloud = test::with_attributes(test::sphere(500));
        const PointCloud back = round_trip(cloud, {.coding = DracoCoding::Sequential,
                                                   .position_bits = 30,
                                                   .precision = {},
                                                   .normal_bits = 30,
                                                   .attribute_bits = 30});
        float largest = 0;
        for (std::size_t i = 0; i < cloud.size(); ++i)
            largest = std::max(largest, (back.positions[i] - cloud.positions[i]).norm());
        std::exit(largest < 1e-6F ? 0 : 1);
    };
    EXPECT_EXIT(encode_in_a_gigabyte(), testing::ExitedWithCode(0), "");
}

TEST(Draco, QuantizesFloatAttributesToTheBitsAskedFor) {
    const PointCloud cloud = test::with_attributes(test::sphere(1000));
    const PointCloud back = round_trip(
        cloud, {.coding = DracoCoding::Sequential, .precision = {}, .attribute_bits = 12});
    const auto& got = std::get<std::vector<float>>(back.attributes.at(0).values);
    const auto& sent = std::get<std::vector<float>>(cloud.attributes.at(0).values);
    for (std::size_t i = 0; i < sent.size(); ++i)
        ASSERT_NEAR(got[i], sent[i], 1.01 * 2.0 / 4095 / 2);
    EXPECT_EQ(back.attributes.at(1).values, cloud.attributes.at(1).values);
}

TEST(Draco, KeepsTheOriginOfGeoreferencedPoints) {
    PointCloud cloud = test::sphere(50);
    cloud.origin = Vec3d(635'616.25, 848'899.7, -0.1);
    cloud.double_precision = true;
    const PointCloud back = round_trip(cloud, {.position_bits = 0, .precision = {}});
    EXPECT_EQ(back.origin, cloud.origin);
    EXPECT_TRUE(back.double_precision);
    EXPECT_EQ(back.positions, cloud.positions);
}

TEST(Draco, ChoosesTheKdTreeForBarePositionsAlone) {
    DecodeReport report;
    round_trip(test::sphere(100), {}, &report);
    EXPECT_EQ(report.encoding, "kd-tree");
    round_trip(test::with_attributes(test::sphere(100)), {}, &report);
    EXPECT_EQ(report.encoding, "sequential");
    round_trip(test::sphere(100), {.position_bits = 0, .precision = {}}, &report);
    EXPECT_EQ(report.encoding, "sequential");
}

TEST(Draco, KeepsOnePointAndNone) {
    for (const std::size_t n : {0, 1}) {
        const PointCloud cloud = test::with_attributes(test::sphere(n));
        const PointCloud back = round_trip(cloud, {});
        EXPECT_EQ(back.size(), n);
        EXPECT_EQ(back.attributes.size(), 2 * n);
    }
    EXPECT_EQ(round_trip(test::sphere(1), {}).positions, test::sphere(1).positions);
    EXPECT_EQ(round_trip(test::sphere(0), {}).size(), 0U);
}

TEST(Draco, RefusesWhatItCannotHoldAndSaysWhy) {
    const auto message = [](const PointCloud& cloud,
                            const DracoEncodeOptions& options) -> std::string {
        try {
            encode_draco(cloud, options);
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ErrorCode::InvalidArgument) << error.what();
            return error.what();
        }
        return "no error";
    };
    const PointCloud cloud = test::sphere(10);
    EXPECT_EQ(message(cloud, {.position_bits = 31, .precision = {}}),
              "position_bits 31: expected 1..30, or 0 for unquantised");
    EXPECT_EQ(message(cloud, {.precision = {}, .normal_bits = 1}), "normal_bits 1: expected 2..30");
    EXPECT_EQ(message(cloud, {.precision = {}, .attribute_bits = 31}),
              "attribute_bits 31: expected 1..30, or 0 for unquantised");
    EXPECT_EQ(message(cloud, {.precision = {}, .compression_level = 11}),
              "compression_level 11: expected 0..10");
    for (const double precision : {0.0, -1.0, 1e-9, double(NAN)}) {
        EXPECT_EQ(message(cloud, {.precision = precision}).find("precision "), 0U);
    }
    PointCloud bad = cloud;
    bad.positions[7].y() = NAN;
    EXPECT_EQ(message(bad, {}).find("the position of point 7 is not finite"), 0U);
    bad = cloud;
    bad.normals.assign(10, Vec3f(0, 0, 1));
    bad.normals[3].x() = NAN;
    EXPECT_EQ(message(bad, {}),
              "the normal of point 3 is not finite, which Draco cannot quantise: make such normals "
              "zero (`clean` does)");
    bad = cloud;
    add(bad, "time", std::vector<double>(10, 0.5));
    EXPECT_EQ(message(bad, {.coding = DracoCoding::KdTree, .precision = {}}),
              "kd-tree coding: attribute 'time' has doubles, which it cannot hold; use sequential "
              "coding");
    bad.attributes[0].name = "two words";
    EXPECT_NE(message(bad, {}).find("two words"), std::string::npos);
}

TEST(Draco, RefusesMorePointsThanTheLimitBeforeItDecodesThem) {
    for (const DracoCoding coding : {DracoCoding::Sequential, DracoCoding::KdTree}) {
        const auto bytes = encode_draco(test::sphere(1000), {.coding = coding, .precision = {}});
        try {
            decode_cloud(bytes, {.max_points = 999});
            FAIL() << "accepted";
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ErrorCode::TooLarge);
            EXPECT_NE(std::string_view(error.what()).find("1000 points: expected at most 999"),
                      std::string::npos);
        }
    }
}

/// A file as other programs write it: integer positions, a named and a nameless attribute, texture
/// coordinates.
TEST(Draco, ReadsAttributesOfOtherPrograms) {
    draco::PointCloud geometry;
    geometry.set_num_points(2);
    const auto add_to = [&](draco::GeometryAttribute::Type type, draco::DataType data_type,
                            int components, const auto& values) {
        draco::GeometryAttribute attribute;
        attribute.Init(type, nullptr, std::uint8_t(components), data_type, false,
                       components * draco::DataTypeLength(data_type), 0);
        const int id = geometry.AddAttribute(attribute, true, 2);
        geometry.attribute(id)->buffer()->Write(0, values.data(),
                                                sizeof(values[0]) * values.size());
        return id;
    };
    using Type = draco::GeometryAttribute::Type;
    add_to(Type::POSITION, draco::DT_INT32, 3,
           std::array{1'000'000'001, 5, -7, 1'000'000'003, 5, -7});
    add_to(Type::TEX_COORD, draco::DT_FLOAT32, 2, std::array{0.1F, 0.2F, 0.3F, 0.4F});
    const int named = add_to(Type::GENERIC, draco::DT_FLOAT64, 1, std::array{0.1, 0.2});
    add_to(Type::GENERIC, draco::DT_INT64, 1, std::array{std::int64_t{1} << 40, std::int64_t{-3}});
    add_to(Type::COLOR, draco::DT_FLOAT32, 3, std::array{0.F, 0.5F, 1.F, 2.F, -1.F, 0.F});
    auto metadata = std::make_unique<draco::AttributeMetadata>();
    metadata->AddEntryString("name", "GpsTime");
    geometry.AddAttributeMetadata(named, std::move(metadata));
    add_to(Type::NORMAL, draco::DT_INT8, 3, std::array<std::int8_t, 6>{127, 0, 0, 0, -127, 0});
    const int odd = add_to(Type::GENERIC, draco::DT_FLOAT32, 1, std::array{7.F, 8.F});
    metadata = std::make_unique<draco::AttributeMetadata>();
    metadata->AddEntryString("name", "h\xc3\xb6he (m)");
    geometry.AddAttributeMetadata(odd, std::move(metadata));
    draco::ExpertEncoder encoder(geometry);
    encoder.SetEncodingMethod(draco::POINT_CLOUD_SEQUENTIAL_ENCODING);
    draco::EncoderBuffer buffer;
    ASSERT_TRUE(encoder.EncodeToBuffer(&buffer).ok());

    DecodeReport report;
    const PointCloud cloud =
        decode_cloud(std::as_bytes(std::span(buffer.data(), buffer.size())), {}, {}, &report);
    EXPECT_EQ(report.skipped, (std::vector<std::string>{"what float colours have beyond 8 bits",
                                                        "name h\xc3\xb6he (m) → h_he_(m)"}));
    ASSERT_EQ(cloud.size(), 2U);
    EXPECT_TRUE(cloud.double_precision);
    EXPECT_EQ((cloud.origin + cloud.positions[1].cast<double>()).eval(),
              Vec3d(1'000'000'003, 5, -7));
    EXPECT_EQ(cloud.colors.at(0), (Rgba8{0, 128, 255, 255}));
    EXPECT_EQ(cloud.colors.at(1), (Rgba8{255, 0, 0, 255}));
    EXPECT_EQ(cloud.normals, (std::vector<Vec3f>{{1, 0, 0}, {0, -1, 0}}));
    ASSERT_EQ(cloud.attributes.size(), 4U);
    EXPECT_EQ(cloud.attributes[3].name, "h_he_(m)");
    EXPECT_EQ(cloud.attributes[0].name, "texcoord");
    EXPECT_EQ(cloud.attributes[0].components, 2U);
    EXPECT_EQ(cloud.attributes[1].name, "GpsTime");
    EXPECT_EQ(cloud.attributes[1].values, AttributeValues(std::vector{0.1, 0.2}));
    EXPECT_EQ(cloud.attributes[2].name, "generic_3");
    EXPECT_EQ(cloud.attributes[2].values,
              AttributeValues(std::vector{double(std::int64_t{1} << 40), -3.0}));
}

TEST(Draco, TellsWhatWideColoursAndIntegersLose) {
    const auto lost = [](std::uint16_t red, std::int64_t id) {
        draco::PointCloud geometry;
        geometry.set_num_points(1);
        const auto add_to = [&](draco::GeometryAttribute::Type type, draco::DataType data_type,
                                const auto& values) {
            draco::GeometryAttribute attribute;
            attribute.Init(type, nullptr, std::uint8_t(values.size()), data_type, false,
                           sizeof(values), 0);
            const int at = geometry.AddAttribute(attribute, true, 1);
            geometry.attribute(at)->buffer()->Write(0, values.data(), sizeof(values));
        };
        using Type = draco::GeometryAttribute::Type;
        add_to(Type::POSITION, draco::DT_FLOAT32, std::array{0.F, 1.F, 2.F});
        add_to(Type::COLOR, draco::DT_UINT16, std::array<std::uint16_t, 3>{red, 0, 65'535});
        add_to(Type::GENERIC, draco::DT_INT64, std::array{id});
        draco::ExpertEncoder encoder(geometry);
        encoder.SetEncodingMethod(draco::POINT_CLOUD_SEQUENTIAL_ENCODING);
        draco::EncoderBuffer buffer;
        EXPECT_TRUE(encoder.EncodeToBuffer(&buffer).ok());
        DecodeReport report;
        decode_cloud(std::as_bytes(std::span(buffer.data(), buffer.size())), {}, {}, &report);
        return report.skipped;
    };
    constexpr std::int64_t kHeld = std::int64_t{1} << 53;
    EXPECT_EQ(lost(257, kHeld), std::vector<std::string>{});
    EXPECT_EQ(lost(258, kHeld + 1), (std::vector<std::string>{"lower 8 bits of 16-bit colours",
                                                              "digits of generic_2 beyond 2^53"}));
}

TEST(Draco, InItsOwnOrderIsSmallerAndHoldsTheSamePoints) {
    PointCloud cloud = test::with_attributes(test::sphere(20'000));
    std::mt19937 random(7);
    std::vector<Index> shuffled(cloud.size());
    std::iota(shuffled.begin(), shuffled.end(), Index{0});
    std::ranges::shuffle(shuffled, random);
    cloud = subset(cloud, shuffled);
    const DracoEncodeOptions options{.coding = DracoCoding::Sequential, .precision = {}};
    const DracoEncodeOptions chained{.precision = {}};
    EXPECT_LT(4 * encode_draco(cloud, chained).size(), 3 * encode_draco(cloud, options).size());
    EXPECT_EQ(sorted(rows_of(round_trip(cloud, chained))),
              sorted(rows_of(round_trip(cloud, options))));
    EXPECT_EQ(encode_draco(cloud, chained, {.threads = 1}),
              encode_draco(cloud, chained, {.threads = 4}));
}

TEST(Draco, KeepsExactFloatsThatSpreadBeyondSinglePrecision) {
    PointCloud cloud;
    constexpr float kFar = 3e38F;
    cloud.positions = {{-kFar, 0, 0}, {kFar, 1, 2}, {0, kFar, -kFar}};
    cloud.colors.assign(3, Rgba8{1, 2, 3, 255});
    const PointCloud back = round_trip(cloud, {.position_bits = 0, .precision = {}});
    EXPECT_EQ(sorted(rows_of(back)), sorted(rows_of(cloud)));
}

TEST(Draco, TellsNoStepsOfExactFloats) {
    PointCloud cloud = test::sphere(2'000);
    double step = 1;
    encode_draco(cloud, {.position_bits = 0, .precision = {}}, {}, &step);
    EXPECT_EQ(step, 0);
    cloud.positions.push_back({1e6F, 0, 0});  // by which they would have too many bits for floats
    cloud.colors.assign(cloud.size(), {1, 2, 3, 255});
    step = 1;
    encode_draco(cloud, {}, {}, &step);
    EXPECT_EQ(step, 0);
}

TEST(Draco, SpendsACloudForTheSameBytes) {
    for (const DracoCoding coding : {DracoCoding::Auto, DracoCoding::Sequential}) {
        PointCloud cloud = cloud_of_integers(500);
        cloud.normals.assign(cloud.size(), Vec3f::UnitX());
        cloud.colors.assign(cloud.size(), Rgba8{1, 2, 3, 255});
        DracoEncodeOptions options;
        options.coding = coding;
        const std::vector<std::byte> kept = encode_draco(cloud, options);
        const PointCloud& spent = cloud;
        EXPECT_EQ(encode_draco(std::move(cloud), options), kept);
        EXPECT_EQ(spent.positions.capacity() + spent.normals.capacity() + spent.colors.capacity(),
                  0U);
        for (const Attribute& attribute : spent.attributes)
            EXPECT_EQ(attribute.value_count(), 0U) << attribute.name;
    }
}

}  // namespace
}  // namespace stipple
