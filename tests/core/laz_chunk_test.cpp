#include "codec/laz_chunk.hpp"
#include "base/random.hpp"
#include "codec/laz_coder.hpp"

#include <gtest/gtest.h>
#include <cstring>
#include <span>

namespace stipple {
namespace {

/// The other side of `LazEncoder`, as simple as can be, with its models.
class LazDecoder {
public:
    explicit LazDecoder(std::span<const std::byte> bytes) : bytes_(bytes) {
        for (int i = 0; i < 4; ++i) code_ = code_ << 8U | next();
    }
    bool bit(LazBit& model) {
        const std::uint32_t zero = model.zero_of(length_);
        const bool value = code_ >= zero;
        narrow(value ? zero : 0, value ? length_ - zero : zero);
        model.count(value);
        return value;
    }
    unsigned symbol(LazSymbols& model, unsigned symbols) {
        unsigned value = symbols - 1;
        while (value > 0 && model.share_of(value, length_).before > code_) --value;
        const auto [before, own] = model.share_of(value, length_);
        narrow(before, own);
        model.count(value);
        return value;
    }
    std::uint32_t direct(unsigned count) {
        if (count > 19) {
            const std::uint32_t low = direct(16);
            return direct(count - 16) << 16U | low;
        }
        const std::uint32_t unit = length_ >> count, value = code_ / unit;
        narrow(value * unit, unit);
        return value;
    }
    std::size_t read() const { return at_; }

private:
    std::uint32_t next() {
        EXPECT_LT(at_, bytes_.size()) << "more is read than was written";
        return at_ < bytes_.size() ? std::to_integer<std::uint32_t>(bytes_[at_++]) : 0;
    }
    void narrow(std::uint32_t before, std::uint32_t length) {
        code_ -= before;
        length_ = length;
        while (length_ < 1U << 24U) {
            code_ = code_ << 8U | next();
            length_ <<= 8U;
        }
    }
    std::span<const std::byte> bytes_;
    std::size_t at_ = 0;
    std::uint32_t code_ = 0, length_ = 0xFFFFFFFF;
};

TEST(LazEncoder, GivesBackWhatWasWrittenInFewBytesWhereItIsForeseen) {
    const auto drawn = [](std::uint32_t i) {  // of so many bits
        return static_cast<std::uint32_t>(random_bits(2, i) % (std::uint64_t{1} << (i % 33)));
    };
    LazEncoder encoder;
    {
        LazBit bit;
        LazSymbols few(3), many(256);
        for (std::uint32_t i = 0; i < 20'000; ++i) {
            encoder.bit(bit, i % 50 == 0);
            encoder.symbol(few, i % 100 == 0 ? i / 100 % 3 : 2);
            encoder.symbol(many, static_cast<unsigned>(random_bits(1, i) % 256));
            encoder.direct(drawn(i), i % 33);
        }
    }
    const std::vector<std::byte> bytes = std::move(encoder).finish();
    EXPECT_NEAR(static_cast<double>(bytes.size()), 20'000 * (1 + 16 / 8.0 + 0.25 / 8), 1'000);
    LazDecoder decoder(bytes);
    LazBit bit;
    LazSymbols few(3), many(256);
    for (std::uint32_t i = 0; i < 20'000; ++i) {
        ASSERT_EQ(decoder.bit(bit), i % 50 == 0);
        ASSERT_EQ(decoder.symbol(few, 3), i % 100 == 0 ? i / 100 % 3 : 2);
        ASSERT_EQ(decoder.symbol(many, 256), random_bits(1, i) % 256);
        ASSERT_EQ(decoder.direct(i % 33), drawn(i));
    }
    EXPECT_LE(decoder.read(), bytes.size());
}

std::int32_t decode_integer(LazDecoder& from, std::vector<LazSymbols>& widths,
                            std::vector<LazSymbols>& corrections, LazBit& sign,
                            std::int32_t expected, unsigned bits, std::size_t context) {
    const unsigned width = from.symbol(widths[context], bits + 1);
    std::int64_t off = 0;
    if (width == 0) {
        off = from.bit(sign) ? 1 : 0;
    } else if (width == 32) {
        off = std::numeric_limits<std::int32_t>::min();
    } else {
        const unsigned high = std::min(width, 8U), low = width - high;
        std::int64_t place = from.symbol(corrections[width - 1], 1U << high);
        if (low > 0) place = place << low | from.direct(low);
        off = place >= std::int64_t{1} << (width - 1) ? place + 1
                                                      : place - ((std::int64_t{1} << width) - 1);
    }
    const std::uint32_t value =
        static_cast<std::uint32_t>(expected) + static_cast<std::uint32_t>(off);
    return bits == 16 ? static_cast<std::uint16_t>(value) : static_cast<std::int32_t>(value);
}

void expect_integers_back(unsigned bits, const std::vector<std::int32_t>& values) {
    LazEncoder encoder;
    LazIntegers model(bits, 2);
    for (std::size_t i = 0; i < values.size(); ++i)
        model.encode(encoder, i == 0 ? 0 : values[i - 1], values[i], i % 2);
    const std::vector<std::byte> bytes = std::move(encoder).finish();
    LazDecoder decoder(bytes);
    std::vector<LazSymbols> widths(2, LazSymbols(bits + 1)), corrections;
    for (unsigned w = 1; w <= bits; ++w) corrections.emplace_back(1U << std::min(w, 8U));
    LazBit sign;
    std::int32_t before = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
        before = decode_integer(decoder, widths, corrections, sign, before, bits, i % 2);
        ASSERT_EQ(before, values[i]) << i;
    }
}

TEST(LazIntegers, GiveBackEveryWidthAndSign) {
    std::vector<std::int32_t> values = {0,
                                        1,
                                        0,
                                        std::numeric_limits<std::int32_t>::min(),
                                        std::numeric_limits<std::int32_t>::max(),
                                        -1,
                                        0};
    for (unsigned shift = 0; shift < 31; ++shift)
        for (const std::int32_t sign : {1, -1})
            for (const std::int32_t beside : {-1, 0, 1})
                values.push_back(sign * ((1 << shift) + beside));
    for (std::uint64_t i = 0; i < 3'000; ++i)
        values.push_back(static_cast<std::int32_t>(random_bits(5, i)) >> (i % 32));
    expect_integers_back(32, values);
    for (std::int32_t& value : values) value = static_cast<std::uint16_t>(value);
    expect_integers_back(16, values);
}

TEST(LazMedian, IsThatOfTheLastFiveOfAConstantOrASteadyRow) {
    LazMedian median;
    for (int i = 0; i < 20; ++i) median.add(7);
    EXPECT_EQ(median.value(), 7);
    median.add(-1000);
    median.add(1000);
    EXPECT_EQ(median.value(), 7);
}

std::uint32_t word_at(const std::vector<std::byte>& bytes, std::size_t at) {
    std::uint32_t word = 0;
    std::memcpy(&word, bytes.data() + at, sizeof word);
    return word;
}

TEST(LazChunk, LeavesOutTheLayersOfFieldsThatDoNotChange) {
    LazPoints points;
    for (std::int32_t i = 0; i < 1000; ++i) {
        points.positions.push_back({i, 2 * i, i % 17});
        points.colors.push_back({9, 8, 7});
        points.intensities.push_back(40);
        points.classifications.push_back(static_cast<std::uint8_t>(i % 3));
        points.extras.insert(points.extras.end(), {std::byte{5}, static_cast<std::byte>(i)});
    }
    points.extra_size = 2;
    const std::vector<std::byte> bytes = encode_laz_chunk(points);
    const std::size_t first = kLazPointSize + kLazColorSize + 2;
    EXPECT_EQ(word_at(bytes, first), 1000U);
    // xy, z, classification, flags, intensity, angle, user, source, time; colour; two bytes
    const std::array<bool, 12> has = {true,  true,  true,  false, false, false,
                                      false, false, false, false, false, true};
    std::size_t total = first + 4 + 4 * has.size();
    for (std::size_t layer = 0; layer < has.size(); ++layer) {
        const std::uint32_t size = word_at(bytes, first + 4 + 4 * layer);
        EXPECT_EQ(size > 0, has[layer]) << layer;
        total += size;
    }
    EXPECT_EQ(bytes.size(), total);
}

TEST(LazChunk, HasALayerForEachFieldThatChanges) {
    LazPoints points;
    for (std::int32_t i = 0; i < 1000; ++i) {
        const auto n = static_cast<std::uint8_t>(1 + i % 15);
        points.positions.push_back({i, 2 * i, i % 17});
        points.returns.push_back({static_cast<std::uint8_t>(1 + i % n), n});
        points.user_data.push_back(static_cast<std::uint8_t>(i));
        points.flags.push_back(i % 3 == 0 ? kLasWithheld : kLasEdgeOfFlightLine);
        points.sources.push_back(static_cast<std::uint16_t>(100 * i));
        points.times.push_back(-1e9 * i);
    }
    const std::vector<std::byte> bytes = encode_laz_chunk(points);
    const std::array<bool, 9> has = {true, true, false, true, false, false, true, true, true};
    for (std::size_t layer = 0; layer < has.size(); ++layer)
        EXPECT_EQ(word_at(bytes, kLazPointSize + 4 + 4 * layer) > 0, has[layer]) << layer;
}

TEST(LazChunk, OfOnePointIsThatPoint) {
    const std::vector<std::byte> bytes = encode_laz_chunk({.positions = {{-3, 1 << 29, 7}}});
    EXPECT_EQ(static_cast<std::int32_t>(word_at(bytes, 0)), -3);
    EXPECT_EQ(word_at(bytes, 4), 1U << 29U);
    EXPECT_EQ(word_at(bytes, kLazPointSize), 1U);
}

}  // namespace
}  // namespace stipple
