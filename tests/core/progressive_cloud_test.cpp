#include "stipple/progressive_cloud.hpp"

#include "contraction/nested_order.hpp"
#include "progressive/range_coder.hpp"
#include "stipple/cleaning.hpp"
#include "stipple/error.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/surface_error.hpp"
#include "support/expect_error.hpp"
#include "support/expect_same.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <random>
#include <set>

namespace stipple {
namespace {

using Bytes = std::vector<std::byte>;

PointCloud decode_first(const Bytes& stream, std::uint64_t points, std::size_t piece) {
    ProgressiveDecoder decoder({}, points);
    for (std::size_t at = 0; at < stream.size() && !decoder.done(); at += piece)
        decoder.feed(std::span(stream).subspan(at, std::min(piece, stream.size() - at)));
    return decoder.cloud();
}

/// A stream that says another sharpening of all of its batches.
Bytes with_sharpening(Bytes stream, unsigned char sharpening) {
    constexpr std::size_t kBatchBytes = 16, kSharpeningAt = 11;
    std::uint32_t header = 0;
    std::uint16_t batches = 0;
    std::memcpy(&header, stream.data() + 8, sizeof(header));
    std::memcpy(&batches, stream.data() + 18, sizeof(batches));
    for (std::size_t b = 0; b < batches; ++b)
        stream[header - kBatchBytes * (batches - b) + kSharpeningAt] = std::byte{sharpening};
    return stream;
}

/// Of each point of one cloud the largest coordinate of the way to the nearest of another, at most.
double farthest(const PointCloud& from, const PointCloud& to) {
    double most = 0;
    for (const Vec3f& p : from.positions) {
        float least = std::numeric_limits<float>::infinity();
        for (const Vec3f& q : to.positions) least = std::min(least, (p - q).cwiseAbs().maxCoeff());
        most = std::max<double>(most, least);
    }
    return most;
}

/// The point of `cloud` nearest to each of `decoded`.
std::vector<std::size_t> partners(const PointCloud& decoded, const PointCloud& cloud) {
    std::vector<std::size_t> found;
    for (const Vec3f& p : decoded.positions) {
        const auto nearest = std::ranges::min_element(
            cloud.positions, {}, [&](const Vec3f& q) { return (p - q).squaredNorm(); });
        found.push_back(static_cast<std::size_t>(nearest - cloud.positions.begin()));
    }
    return found;
}

// The range coder.

TEST(RangeCoder, GivesBackWhatWasWrittenAndTakesTheEntropyOfIt) {
    std::mt19937 random(1);
    std::vector<bool> bits;
    for (int i = 0; i < 20'000; ++i) bits.push_back(random() % 16 == 0);
    RangeEncoder encoder;
    AdaptiveBit model;
    for (const bool bit : bits) {
        encoder.bit(model, bit);
        encoder.direct(bit ? 0xBEEF : 5, 16);
    }
    const Bytes bytes = encoder.finish();
    // H(1/16) = 0.337 bits, and 2 bytes as they are.
    EXPECT_NEAR(static_cast<double>(bytes.size()), 20'000 * (0.337 / 8 + 2), 60);

    RangeDecoder decoder;
    decoder.start(bytes);
    AdaptiveBit same;
    for (const bool bit : bits) {
        ASSERT_EQ(decoder.bit(same), bit);
        ASSERT_EQ(decoder.direct(0, 16), bit ? 0xBEEFU : 5U);
    }
}

TEST(RangeCoder, CarriesThroughRunsOfOnes) {
    // Bits that the model expects the least push the low end up, which carries far.
    for (int length = 1; length < 300; ++length) {
        RangeEncoder encoder;
        AdaptiveBit model;
        for (int i = 0; i < length; ++i) {
            encoder.direct(0xFFFF, 16);
            encoder.bit(model, true);
        }
        const Bytes bytes = encoder.finish();
        RangeDecoder decoder;
        decoder.start(bytes);
        AdaptiveBit same;
        for (int i = 0; i < length; ++i) {
            ASSERT_EQ(decoder.direct(0, 16), 0xFFFFU);
            ASSERT_TRUE(decoder.bit(same));
        }
    }
}

// The order.

TEST(NestedOrder, NamesEveryPointOnce) {
    const PointCloud cloud = test::sphere(2'000);
    const std::vector<Index> order = nested_order(cloud.positions, {});
    EXPECT_EQ(order.size(), 2'000U);
    EXPECT_EQ(std::set(order.begin(), order.end()).size(), 2'000U);
}

// The stream.

TEST(ProgressiveCloud, HoldsEveryPointWithinHalfAStep) {
    const PointCloud cloud = test::sphere(3'000, 0.01);
    const Bytes stream = encode_progressive(cloud, {.position_bits = 12});
    const PointCloud decoded = decode_progressive(stream);
    ASSERT_EQ(decoded.size(), 3'000U);
    const double step = bounds(cloud).diagonal() / std::sqrt(3.0) / 4095;
    EXPECT_LE(farthest(decoded, cloud), 0.52 * step);
    EXPECT_LE(farthest(cloud, decoded), 0.52 * step);
}

TEST(ProgressiveCloud, RefusesACloudWhoseSquaresAreNothing) {
    PointCloud cloud = test::sphere(100);
    for (Vec3f& p : cloud.positions) p *= 1e-40F;
    try {
        encode_progressive(cloud);
        ADD_FAILURE() << "nothing was refused";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::MalformedInput);
        EXPECT_NE(std::string(error.what()).find("1e-15 to 1e+15"), std::string::npos);
    }
}

TEST(ProgressiveCloud, KeepsThePrecisionAskedFor) {
    for (const float away : {0.0F, 900.0F, 30'000.0F}) {
        PointCloud cloud = test::cube(1'000);
        for (Vec3f& p : cloud.positions) p += Vec3f::Constant(away);
        const PointCloud decoded =
            decode_progressive(encode_progressive(cloud, {.precision = 1e-3}));
        EXPECT_LE(farthest(cloud, decoded), 1e-3);
        EXPECT_LE(farthest(decoded, cloud), 1e-3);
        cloud.double_precision = true;
        const auto encode = [&] { encode_progressive(cloud, {.precision = 1e-3}); };
        if (away > 20'000)
            test::expect_refused("in single precision", encode);
        else
            EXPECT_NO_THROW(encode());
    }
}

TEST(ProgressiveCloud, KeepsAllAttributesWithThePoint) {
    PointCloud cloud = test::with_attributes(test::sphere(2'000));
    std::vector<double> times;
    std::vector<std::int32_t> wide;
    std::vector<float> gaps, classes, numbers;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        times.push_back(1.7e9 + 1e-6 * static_cast<double>(i));
        wide.push_back(i % 2 == 0 ? std::numeric_limits<std::int32_t>::min()
                                  : std::numeric_limits<std::int32_t>::max());
        gaps.push_back(i % 3 == 0 ? std::numeric_limits<float>::infinity() : 0.1F);
        classes.push_back(i % 3 == 0 ? 2.0F : 5.0F);  // whole: they stay as they are
        numbers.push_back(i % 3 == 0 ? -3e9F : static_cast<float>(i));
    }
    set_attribute(cloud, {"time", times, 1, Reduction::Mean});
    set_attribute(cloud, {"wide", wide, 1, Reduction::Nearest});
    set_attribute(cloud, {"gaps", gaps, 1, Reduction::Max});
    set_attribute(cloud, {"classes", classes, 1, Reduction::Nearest});
    set_attribute(cloud, {"numbers", numbers, 1, Reduction::Nearest});
    cloud.origin = {4e6, 5e5, 100};
    cloud.double_precision = true;
    const PointCloud decoded =
        decode_progressive(encode_progressive(cloud, {.position_bits = 20, .normal_bits = 12}));

    EXPECT_EQ(decoded.origin, cloud.origin);
    EXPECT_TRUE(decoded.double_precision);
    EXPECT_EQ(decoded.has_alpha, cloud.has_alpha);
    ASSERT_EQ(decoded.attributes.size(), cloud.attributes.size());
    const std::vector<std::size_t> from = partners(decoded, cloud);
    for (std::size_t i = 0; i < decoded.size(); ++i) {
        EXPECT_LT((decoded.normals[i] - cloud.normals[from[i]]).norm(), 2e-3);
        EXPECT_EQ(decoded.colors[i], cloud.colors[from[i]]);
    }
    for (std::size_t a = 0; a < cloud.attributes.size(); ++a) {
        const Attribute& was = cloud.attributes[a];
        EXPECT_EQ(decoded.attributes[a].name, was.name);
        EXPECT_EQ(decoded.attributes[a].reduction, was.reduction);
        std::visit(
            [&]<typename T>(const std::vector<T>& values) {
                const auto& now = std::get<std::vector<T>>(decoded.attributes[a].values);
                const bool lossy = was.name == "height";
                const auto [low, high] = std::ranges::minmax(values);
                const double step =
                    lossy ? (static_cast<double>(high) - static_cast<double>(low)) / 65'535 : 0;
                for (std::size_t i = 0; i < now.size(); ++i) {
                    if (lossy) {
                        EXPECT_NEAR(now[i], values[from[i]], 0.501 * step + 1e-7) << was.name;
                    } else {
                        EXPECT_EQ(now[i], values[from[i]]) << was.name;
                    }
                }
            },
            was.values);
    }
}

TEST(ProgressiveCloud, IsTheSameHoweverTheBytesCome) {
    const PointCloud cloud = test::with_attributes(test::sphere(3'000, 0.01));
    const Bytes stream = encode_progressive(cloud);
    for (const std::uint64_t points :
         {1ULL, 2ULL, 187ULL, 188ULL, 189ULL, 375ULL, 1'000ULL, 2'999ULL, 3'000ULL}) {
        const PointCloud whole = decode_first(stream, points, stream.size());
        ASSERT_EQ(whole.size(), points);
        for (const std::size_t piece : {1U, 7U, 1000U})
            test::expect_same(decode_first(stream, points, piece), whole);
    }
}

TEST(ProgressiveCloud, HasMorePointsTheMoreBytesThereAre) {
    const PointCloud cloud = test::sphere(5'000);
    const Bytes stream = encode_progressive(cloud);
    ProgressiveDecoder decoder;
    std::uint64_t before = 0;
    for (std::size_t at = 0; at < stream.size(); ++at) {
        decoder.feed(std::span(stream).subspan(at, 1));
        EXPECT_GE(decoder.size(), before);
        before = decoder.size();
        // A batch ends where the header says.
        for (const ProgressiveBatch& batch : decoder.batches())
            if (batch.bytes == at + 1) {
                EXPECT_EQ(decoder.size(), batch.points);
            }
    }
    EXPECT_TRUE(decoder.done());
    EXPECT_EQ(before, 5'000U);
}

TEST(ProgressiveCloud, PrefixesAreGoodCloudsAndTellTheirError) {
    const PointCloud cloud = test::sphere(10'000);
    const Bytes stream = encode_progressive(cloud);
    const Bytes unsharpened = with_sharpening(stream, 0);
    ProgressiveDecoder header;
    header.feed(stream);
    SurfaceErrorOptions options;
    options.sampling = ErrorSampling::Surface;
    options.samples = 4'000;
    double before = std::numeric_limits<double>::infinity();
    for (const ProgressiveBatch& batch : header.batches()) {
        if (batch.points < 600 || batch.points == cloud.size()) continue;
        const PointCloud prefix = decode_progressive(std::span(stream).first(batch.bytes));
        ASSERT_EQ(prefix.size(), batch.points);
        const double error = measure_error(cloud, prefix, options).mean();
        EXPECT_NEAR(batch.mean_error, error, 0.1 * error);
        const PointCloud plain = decode_progressive(std::span(unsharpened).first(batch.bytes));
        // Half of the points gain less than fewer ones.
        const double gain = 2 * batch.points < cloud.size() ? 0.75 : 1;
        EXPECT_LT(error, gain * before);
        EXPECT_LT(error, gain * measure_error(cloud, plain, options).mean());
        before = error;
        // No hole: on the sphere a point of n has 4 pi / n to itself.
        EXPECT_LT(farthest(cloud, prefix),
                  3 * std::sqrt(4 * std::numbers::pi / static_cast<double>(batch.points)));
    }
}

TEST(ProgressiveCloud, TheErrorOfTheWholeIsThatOfItsRounding) {
    const PointCloud cloud = test::sphere(40'000, 0.01);
    ProgressiveDecoder decoder;
    decoder.feed(encode_progressive(cloud));
    const double told = decoder.batches().back().mean_error;
    const double error =
        measure_error(cloud, decoder.cloud(), {.sampling = ErrorSampling::Surface}).mean();
    EXPECT_LT(told, decoder.batches().back().step);
    EXPECT_NEAR(told, error, 0.5 * error);
}

TEST(ProgressiveCloud, PutsPrefixesOutOfWhatIsBentAndTheWholeNowhere) {
    const PointCloud cloud = test::sphere(8'000);
    const Bytes stream = encode_progressive(cloud);
    const auto mean_radius = [&](std::uint64_t points) {
        const PointCloud prefix = decode_first(stream, points, stream.size());
        double sum = 0;
        for (const Vec3f& p : prefix.positions) sum += p.norm();
        return sum / static_cast<double>(points);
    };
    // By half of what neighbours lie lower, which is half of what a point of n has to itself.
    const auto expected = [](double points) { return 0.5 * 2 * std::numbers::pi / points; };
    EXPECT_NEAR(mean_radius(1'000) - 1, expected(1'000), 0.5 * expected(1'000));
    EXPECT_NEAR(mean_radius(2'000) - 1, expected(2'000), 0.5 * expected(2'000));
    // Among the last ones less and less.
    EXPECT_GT(mean_radius(5'000), mean_radius(7'000));
    EXPECT_GT(mean_radius(7'000), mean_radius(7'900));
    EXPECT_NEAR(mean_radius(8'000), 1, 1e-6);
}

TEST(ProgressiveCloud, RefusesToPutTheWholeOut) {
    const Bytes stream = encode_progressive(test::sphere(600));
    EXPECT_NO_THROW(decode_progressive(with_sharpening(stream, 0)));
    test::expect_error(ErrorCode::MalformedInput, "the batches do not add up to the whole",
                       [&] { decode_progressive(with_sharpening(stream, 1)); });
}

TEST(ProgressiveCloud, TakesFewBitsForASmoothSurface) {
    const PointCloud cloud = test::sphere(4'000);
    const double bits = 8.0 * static_cast<double>(encode_progressive(cloud).size()) / 4'000;
    EXPECT_LT(bits, 32);  // 14 bits an axis are 42
    const PointCloud flat = test::plane(4'000);
    EXPECT_LT(encode_progressive(flat).size(), encode_progressive(cloud).size());
}

TEST(ProgressiveCloud, GivesTheSameBytesForAnyNumberOfThreads) {
    const PointCloud cloud = test::with_attributes(test::sphere(4'000, 0.01));
    EXPECT_EQ(encode_progressive(cloud, {}, {.threads = 1}),
              encode_progressive(cloud, {}, {.threads = 3}));
}

TEST(ProgressiveCloud, DecodesTheSameOnAnyNumberOfThreads) {
    const Bytes stream = encode_progressive(test::with_attributes(test::sphere(12'000, 0.01)));
    const auto decoded = [&](unsigned threads) {
        ProgressiveDecoder decoder({}, 9'000);
        decoder.feed(stream, {.threads = threads});
        return decoder.cloud({.threads = threads});
    };
    test::expect_same(decoded(1), decoded(3));
}

TEST(ProgressiveCloud, HoldsDegenerateClouds) {
    PointCloud one;
    one.positions = {{3, 4, 5}};
    PointCloud two = one;
    two.positions.push_back({3, 4, 6});
    PointCloud far = test::cube(500);
    for (std::size_t i = 0; i < 250; ++i) far.positions[i].x() += 1e6F;
    for (const PointCloud& cloud : {one, two, test::line(1'000), test::plane(1'000), far}) {
        const PointCloud decoded = decode_progressive(encode_progressive(cloud));
        ASSERT_EQ(decoded.size(), cloud.size());
        EXPECT_LE(farthest(decoded, cloud), 1e-4 * (1 + bounds(cloud).diagonal()));
    }
    for (const auto precision : {std::optional<double>(), std::optional(1e-60)})
        EXPECT_EQ(decode_progressive(encode_progressive(one, {.precision = precision})).positions,
                  one.positions);
}

TEST(ProgressiveCloud, KeepsPointsApartThoughOneIsFarOff) {
    PointCloud cloud = test::sphere(2'000);
    cloud.positions.push_back({0, 0, 20'000});
    const PointCloud decoded = decode_progressive(encode_progressive(cloud));
    EXPECT_LT(farthest(decoded, cloud), mean_spacing(cloud.positions));
}

TEST(ProgressiveCloud, PadsBatchesOfCoincidentPoints) {
    PointCloud cloud = test::cube(2'000);
    for (Vec3f& p : cloud.positions) p = p.array().round();
    const PointCloud decoded = decode_progressive(encode_progressive(cloud, {.position_bits = 1}));
    EXPECT_EQ(decoded.size(), 2'000U);
    EXPECT_EQ(farthest(decoded, cloud), 0);
}

TEST(ProgressiveCloud, PadsBatchesOfManyChannelsThatAreTheSame) {
    PointCloud cloud = test::sphere(2'000);
    cloud.attributes.push_back({"same", std::vector<std::uint8_t>(200 * cloud.size(), 7), 200});
    const PointCloud decoded = decode_progressive(encode_progressive(cloud));
    EXPECT_EQ(decoded.attributes.at(0).values, cloud.attributes[0].values);
}

TEST(ProgressiveCloud, RefusesWhatItCannotHold) {
    const auto refused = [](const PointCloud& cloud, const ProgressiveOptions& options) {
        try {
            encode_progressive(cloud, options);
        } catch (const Error& error) {
            return error.code() == ErrorCode::InvalidArgument;
        }
        return false;
    };
    const PointCloud cloud = test::cube(10);
    EXPECT_TRUE(refused({}, {}));
    EXPECT_TRUE(refused(cloud, {.position_bits = 0}));
    EXPECT_TRUE(refused(cloud, {.position_bits = 25}));
    PointCloud far = test::sphere(2000);
    far.positions[7] = Vec3f(1e9F, 0, 0);
    EXPECT_TRUE(refused(far, {}));
    EXPECT_FALSE(refused(far, {.precision = 100.0}));
    EXPECT_TRUE(refused(cloud, {.precision = 0.0}));
    EXPECT_TRUE(refused(cloud, {.precision = 1.2e308}));
    EXPECT_TRUE(refused(cloud, {.precision = 1e-9}));
    EXPECT_TRUE(refused(cloud, {.normal_bits = 1}));
    EXPECT_TRUE(refused(cloud, {.attribute_bits = 33}));
    EXPECT_TRUE(refused(cloud, {.coarseness = -1}));
    PointCloud endless = cloud;
    endless.positions[3].x() = std::numeric_limits<float>::quiet_NaN();
    EXPECT_TRUE(refused(endless, {}));
}

TEST(ProgressiveCloud, RefusesGridsThatReachFartherThanCloudsMay) {
    constexpr std::size_t kStepAt = 20, kCornerAt = 28;
    const Bytes stream = encode_progressive(test::cube(100));
    for (const std::size_t at : {kStepAt, kCornerAt}) {
        for (const double value : {1e308, 4e38}) {
            Bytes far = stream;
            std::memcpy(far.data() + at, &value, sizeof(value));
            try {
                decode_progressive(far);
                ADD_FAILURE() << value << " at " << at;
            } catch (const Error& error) {
                EXPECT_EQ(error.code(), ErrorCode::MalformedInput);
                EXPECT_NE(std::string(error.what()).find("expected at most"), std::string::npos);
            }
        }
    }
    // What is written is read, however far off.
    PointCloud one;
    one.positions = {{std::numeric_limits<float>::max(), -1e38F, 0}};
    for (const auto precision : {std::optional<double>(), std::optional(1e15)})
        EXPECT_EQ(decode_progressive(encode_progressive(one, {.precision = precision})).positions,
                  one.positions);
    test::expect_refused("the grid is 2e+16 across: expected at most 4e+15",
                         [&] { encode_progressive(one, {.precision = 1e16}); });
    PointCloud wide = one;
    wide.positions = {{0, 0, 0}, {9.9e14F, 0, 0}};
    EXPECT_EQ(decode_progressive(encode_progressive(wide, {.position_bits = 1})).size(), 2U);
    EXPECT_NO_THROW(decode_progressive(encode_progressive(wide, {.precision = 4.9e14})));
}

TEST(ProgressiveCloud, SurvivesHostileBytes) {
    const Bytes stream = encode_progressive(test::with_attributes(test::sphere(600, 0.01)));
    std::mt19937 random(7);
    for (int i = 0; i < 1'000; ++i) {
        Bytes bytes = stream;
        const std::size_t from = i % 2 == 0 ? bytes.size() : 400;  // the header more often
        for (unsigned n = random() % 4 + 1; n > 0; --n)
            bytes[random() % from] = static_cast<std::byte>(random());
        bytes.resize(random() % 8 == 0 ? random() % bytes.size() : bytes.size());
        try {
            const PointCloud cloud = decode_progressive(bytes, {.max_points = 100'000});
            EXPECT_LE(cloud.size(), 100'000U);
            validate(cloud);
        } catch (const Error& error) {
            EXPECT_NE(error.code(), ErrorCode::Internal);
        }
    }
}

TEST(ProgressiveCloud, ChecksLimitsBeforeAnythingElse) {
    const Bytes stream = encode_progressive(test::with_attributes(test::cube(100)));
    const auto code = [&](const DecodeLimits& limits) {
        try {
            decode_progressive(stream, limits);
        } catch (const Error& error) {
            return error.code();
        }
        return ErrorCode::Internal;
    };
    EXPECT_EQ(code({.max_points = 99}), ErrorCode::TooLarge);
    EXPECT_EQ(code({.max_attributes = 1}), ErrorCode::TooLarge);
    test::expect_error(ErrorCode::MalformedInput, "20 bytes do not reach the first point",
                       [&] { decode_progressive(std::span(stream).first(20)); });
    Bytes later = stream;
    later[4] = std::byte{4};
    test::expect_error(ErrorCode::UnsupportedFormat, "progressive stream of version 4: expected 3",
                       [&] { decode_progressive(later); });
}

TEST(ProgressiveCloud, StopsWhenAsked) {
    std::stop_source stop;
    stop.request_stop();
    EXPECT_THROW(encode_progressive(test::cube(1'000), {}, {.stop = stop.get_token()}), Cancelled);
}

TEST(ProgressiveCloud, IsSmallerThanDracoOnIgea) {
    const auto file = test::shared_file("models/igea.ply");
    if (!file) GTEST_SKIP() << "no shared test data";
    PointCloud cloud;
    cloud.positions = read_cloud(*file).positions;
    clean(cloud);
    DracoEncodeOptions draco;
    draco.coding = DracoCoding::KdTree;
    EXPECT_LT(encode_progressive(cloud).size(), encode_draco(cloud, draco).size());
}

}  // namespace
}  // namespace stipple
