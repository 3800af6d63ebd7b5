#include "pyramid/vertex_codec.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <tuple>

// Follows: A. Kapoulkine, meshoptimizer, and the Khronos extension EXT_meshopt_compression (mode
// 0). Vertices are cut into blocks; in each, one byte of all its vertices after the other: as
// differences to the vertex before, in groups of sixteen, each with 0, 2, 4 or 8 bits to a byte.
// Not by the library, which packs for the fewest bytes before Brotli: see the header.

namespace stipple {

namespace {

constexpr std::size_t kGroup = 16;
constexpr std::size_t kBlockBytes = 8'192, kMostInBlock = std::tuple_size_v<VertexEncoder::Column>;
constexpr std::size_t kLeastTail = 32;
constexpr std::byte kVersion0{0xA0};

using Column = VertexEncoder::Column;

/// How a group is written.
struct Packing {
    unsigned code;   ///< the logarithm of its bits, 0 for none
    unsigned bytes;  ///< that it takes
};

using Bytes = std::uint8_t __attribute__((vector_size(16)));

Bytes low_pairs(Bytes a, Bytes b) noexcept {
    return __builtin_shufflevector(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
}
Bytes high_pairs(Bytes a, Bytes b) noexcept {
    return __builtin_shufflevector(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15,
                                   31);
}

/// The columns of a block of vertices of `kStride` bytes, sixteen vertices at a time: the number of
/// a byte is that of its vertex, four bits, and of its column; each round moves the first bit
/// behind the last, until the vertex stands last.
template <std::size_t kStride>
void to_columns(const std::byte* vertices, std::size_t size, Column* columns) noexcept {
    for (std::size_t begin = 0; begin < size; begin += kGroup) {
        std::array<Bytes, kStride> rows, shuffled;
        std::memcpy(rows.data(), vertices + begin * kStride, sizeof rows);
        for (unsigned round = 0; round < 4; ++round) {
            for (std::size_t i = 0; i < kStride / 2; ++i) {
                shuffled[2 * i] = low_pairs(rows[i], rows[i + kStride / 2]);
                shuffled[2 * i + 1] = high_pairs(rows[i], rows[i + kStride / 2]);
            }
            rows = shuffled;
        }
        for (std::size_t k = 0; k < kStride; ++k)
            std::memcpy(&columns[k][begin], &rows[k], sizeof rows[k]);
    }
}

/// The same of any stride.
void to_columns(const std::byte* vertices, std::size_t stride, std::size_t size,
                Column* columns) noexcept {
    if (stride == 4) return to_columns<4>(vertices, size, columns);
    if (stride == 8) return to_columns<8>(vertices, size, columns);
    for (std::size_t k = 0; k < stride; ++k)
        for (std::size_t i = 0; i < size; ++i)
            columns[k][i] = static_cast<std::uint8_t>(vertices[i * stride + k]);
}

/// To the vertex before, the sign in the lowest bit; zeros up to a whole group.
void to_differences(Column& column, std::uint8_t last, std::size_t size) noexcept {
    const Column values = column;
    const auto zigzag = [](unsigned now, unsigned before) {
        const auto difference = static_cast<std::uint8_t>(now - before);
        const auto doubled = static_cast<std::uint8_t>(difference + difference);
        const auto sign = static_cast<std::uint8_t>(difference >= 0x80U ? 0xFFU : 0U);
        return static_cast<std::uint8_t>(doubled ^ sign);
    };
    column[0] = zigzag(values[0], last);
    for (std::size_t i = 1; i < kMostInBlock; ++i) column[i] = zigzag(values[i], values[i - 1]);
    std::fill(column.begin() + static_cast<std::ptrdiff_t>(size), column.end(), std::uint8_t{0});
}

/// How many lanes are set, given 255 for each.
unsigned count_of(Bytes set) noexcept {
    Bytes sums = -set;
    sums +=
        __builtin_shufflevector(sums, sums, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7);
    sums +=
        __builtin_shufflevector(sums, sums, 4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15, 8, 9, 10, 11);
    sums +=
        __builtin_shufflevector(sums, sums, 2, 3, 0, 1, 6, 7, 4, 5, 10, 11, 8, 9, 14, 15, 12, 13);
    return static_cast<std::uint8_t>(sums[0] + sums[1]);
}

Packing least_packing(const std::uint8_t* group) noexcept {
    Bytes values;
    std::memcpy(&values, group, sizeof values);
    const unsigned some = count_of(reinterpret_cast<Bytes>(values >= 1));
    if (some == 0) return {0, 0};
    const unsigned by_2 = 4U + count_of(reinterpret_cast<Bytes>(values >= 3)),
                   by_4 = 8U + count_of(reinterpret_cast<Bytes>(values >= 15));
    if (std::min(by_2, by_4) >= kGroup) return {3, kGroup};
    return by_2 <= by_4 ? Packing{1, by_2} : Packing{2, by_4};
}

/// Of each two bytes side by side one, the first `kBits` higher than the second; the last eight are
/// of no use.
template <unsigned kBits>
Bytes pairs_in_one(Bytes v) noexcept {
    const Bytes first = __builtin_shufflevector(v, v, 0, 2, 4, 6, 8, 10, 12, 14, 0, 2, 4, 6, 8, 10,
                                                12, 14),
                second = __builtin_shufflevector(v, v, 1, 3, 5, 7, 9, 11, 13, 15, 1, 3, 5, 7, 9, 11,
                                                 13, 15);
    return (first << kBits) | second;
}

/// What does not fit into the bits follows in whole bytes. @return  the end; a few bytes behind it
/// may be written to, never more than whole bytes would take.
template <unsigned kBits>
std::uint8_t* write_packed(const std::uint8_t* group, std::uint8_t* to) noexcept {
    constexpr std::uint8_t kMost = (1U << kBits) - 1;
    Bytes values;
    std::memcpy(&values, group, sizeof values);
    Bytes packed = pairs_in_one<kBits>(values < kMost ? values : Bytes{} + kMost);
    if constexpr (kBits == 2) packed = pairs_in_one<4>(packed);
    std::memcpy(to, &packed, kGroup / 2);
    to += kGroup * kBits / 8;
    for (std::size_t i = 0; i < kGroup; ++i) {
        *to = group[i];
        to += group[i] >= kMost ? 1 : 0;
    }
    return to;
}

std::uint8_t* write_group(const std::uint8_t* group, unsigned code, std::uint8_t* to) noexcept {
    if (code == 1) return write_packed<2>(group, to);
    if (code == 2) return write_packed<4>(group, to);
    return code == 3 ? std::copy_n(group, kGroup, to) : to;
}

/// One byte of each vertex of a block: in whole bytes where packing them would save little.
std::uint8_t* write_column(const Column& differences, std::size_t groups,
                           std::uint8_t* to) noexcept {
    constexpr double kWorth = 0.75;  // of whole bytes
    if (differences == Column{}) return std::fill_n(to, (groups + 3) / 4, std::uint8_t{0});
    std::array<Packing, kMostInBlock / kGroup> packings;
    unsigned packed = 0;
    for (std::size_t g = 0; g < groups; ++g) {
        packings[g] = least_packing(differences.data() + g * kGroup);
        packed += packings[g].bytes;
    }
    const bool whole = packed > kWorth * static_cast<double>(groups * kGroup);
    std::uint8_t* const codes = to;
    to = std::fill_n(to, (groups + 3) / 4, std::uint8_t{0});
    for (std::size_t g = 0; g < groups; ++g) {
        const unsigned least = packings[g].code, code = whole && least > 0 ? 3 : least;
        codes[g / 4] = static_cast<std::uint8_t>(codes[g / 4] | code << (2 * (g % 4)));
        to = write_group(differences.data() + g * kGroup, code, to);
    }
    return to;
}

}  // namespace

std::vector<std::byte> VertexEncoder::encode(std::size_t count, std::size_t stride,
                                             const Write& write) {
    const std::size_t in_block = std::min(kMostInBlock, kBlockBytes / stride / kGroup * kGroup);
    // Column by column no more than whole bytes, a code for each group and a byte behind.
    const std::size_t most = stride * (in_block + in_block / kGroup / 4 + 1);
    vertices_.resize((in_block + 1) * stride);
    columns_.resize(stride);
    packed_.resize((count + in_block - 1) / in_block * most);
    std::byte *const first = vertices_.data(), *const block = first + stride;
    std::vector<std::byte> at_the_end;
    std::uint8_t* end = packed_.data();
    for (std::size_t begin = 0; begin < count; begin += in_block) {
        const std::size_t size = std::min(in_block, count - begin);
        write(begin, begin + size, block);
        if (begin == 0) {
            std::copy_n(block, stride, first);
            at_the_end.assign(first, block);
        }
        to_columns(block, stride, size, columns_.data());
        for (std::size_t k = 0; k < stride; ++k) {
            to_differences(columns_[k], static_cast<std::uint8_t>(first[k]), size);
            end = write_column(columns_[k], (size + kGroup - 1) / kGroup, end);
        }
        std::copy_n(block + (size - 1) * stride, stride, first);
    }
    // At the end the first vertex, and room that decoders may read beyond what they need.
    const auto written = static_cast<std::size_t>(end - packed_.data());
    const std::size_t room = std::max(kLeastTail, stride) - stride;
    std::vector<std::byte> bytes(1 + written + room + stride);
    bytes.front() = kVersion0;
    std::copy_n(reinterpret_cast<const std::byte*>(packed_.data()), written, bytes.begin() + 1);
    std::ranges::copy(at_the_end, bytes.end() - static_cast<std::ptrdiff_t>(stride));
    return bytes;
}

std::vector<std::byte> encode_vertices(std::span<const std::byte> raw, std::size_t stride) {
    return VertexEncoder().encode(
        raw.size() / stride, stride, [&](std::size_t begin, std::size_t end, std::byte* to) {
            std::copy_n(raw.data() + begin * stride, (end - begin) * stride, to);
        });
}

}  // namespace stipple
