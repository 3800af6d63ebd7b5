#include "pyramid/vertex_codec.hpp"

#include "base/random.hpp"
#include "stipple/lod_tiles.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cstring>
#include <vector>

namespace stipple {
namespace {

std::vector<std::byte> of_numbers(const std::vector<unsigned>& numbers) {
    std::vector<std::byte> bytes;
    for (const unsigned number : numbers) bytes.push_back(static_cast<std::byte>(number));
    return bytes;
}

TEST(VertexCodec, PacksWhereThatSavesMuch) {
    // A counter, two constants and a number that moves once; 1 upwards is 2 in zigzag.
    std::vector<unsigned> raw;
    for (unsigned i = 0; i < 16; ++i) raw.insert(raw.end(), {i, 7, 9, i < 8 ? 1U : 2U});
    std::vector<unsigned> expected = {0xA0};
    expected.insert(expected.end(), {1, 0x2A, 0xAA, 0xAA, 0xAA});  // two bits for each
    expected.insert(expected.end(), {0, 0});                       // nothing changes
    expected.insert(expected.end(), {1, 0, 0, 2U << 6U, 0});
    expected.insert(expected.end(), 28, 0);
    expected.insert(expected.end(), {0, 7, 9, 1});
    EXPECT_EQ(encode_vertices(of_numbers(raw), 4), of_numbers(expected));
}

TEST(VertexCodec, WritesWholeBytesWherePackingSavesLittle) {
    // Differences of 10, for which four bits do, but for five of sixteen, or four.
    for (const bool many : {true, false}) {
        std::vector<unsigned> raw = {0, 0, 0, 0};
        for (unsigned i = 1; i < 16; ++i) {
            const bool large = i % 3 == 0 && (many || i < 15);
            raw.insert(raw.end(), {(raw[4 * i - 4] + (large ? 20 : 5)) % 256, 0, 0, 0});
        }
        const std::vector<std::byte> bytes = encode_vertices(of_numbers(raw), 4);
        EXPECT_EQ(bytes[1], static_cast<std::byte>(many ? 3 : 2));
        EXPECT_EQ(bytes.size(), 1U + 1 + (many ? 16 : 12) + 3 + 32);
    }
}

TEST(VertexCodec, KeepsNothingOfWhatWasEncodedBefore) {
    VertexEncoder encoder;
    for (const unsigned count : {600U, 3U, 300U}) {
        std::vector<unsigned> raw;
        for (unsigned i = 0; i < 8 * count; ++i) raw.push_back(i * i * count % 256);
        const std::vector<std::byte> vertices = of_numbers(raw);
        const auto write = [&](std::size_t begin, std::size_t end, std::byte* to) {
            std::copy_n(vertices.data() + 8 * begin, 8 * (end - begin), to);
        };
        EXPECT_EQ(encoder.encode(count, 8, write), encode_vertices(vertices, 8));
    }
}

/// Numbers of all sizes, so that groups of all kinds occur.
template <typename T>
std::vector<T> some_numbers(std::size_t count) {
    std::vector<T> numbers;
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint64_t bits = random_bits(5, i);
        numbers.push_back(static_cast<T>(bits >> (8 + random_bits(6, i / 100) % 56)));
    }
    return numbers;
}

template <typename T>
TileStream stream_of(const char* name, TileStream::Type type, unsigned stride,
                     const std::vector<T>& numbers) {
    const unsigned components = name[0] == '_' ? 1 : 3;
    std::vector<std::byte> raw(numbers.size() / components * stride);
    for (std::size_t i = 0; i < numbers.size(); ++i)
        std::memcpy(raw.data() + i / components * stride + i % components * sizeof(T), &numbers[i],
                    sizeof(T));
    return {.name = name,
            .type = type,
            .components = components,
            .stride = stride,
            .bytes = encode_vertices(raw, stride)};
}

TEST(VertexCodec, IsReadByMeshoptimizer) {
    for (const std::size_t count : {1, 15, 16, 17, 255, 256, 257, 3'000}) {
        const auto places = some_numbers<std::uint16_t>(3 * count);
        const auto bytes = some_numbers<std::uint8_t>(count);
        const auto floats = some_numbers<float>(count);
        LodTile tile;
        tile.points = count;
        tile.streams = {stream_of("POSITION", TileStream::Type::Uint16, 8, places),
                        stream_of("_wide", TileStream::Type::Uint8, 252, bytes),
                        stream_of("_float", TileStream::Type::Float, 4, floats)};
        const PointCloud decoded = decode_tile(tile);
        for (std::size_t i = 0; i < 3 * count; ++i)
            ASSERT_EQ(decoded.positions[i / 3][static_cast<Eigen::Index>(i % 3)], places[i]);
        EXPECT_EQ(std::get<std::vector<std::uint8_t>>(find_attribute(decoded, "wide")->values),
                  bytes);
        EXPECT_EQ(std::get<std::vector<float>>(find_attribute(decoded, "float")->values), floats);
    }
}

}  // namespace
}  // namespace stipple
