#include "vertex_codec.hpp"

#include <algorithm>
#include <array>
#include <cstdint>

// Follows: A. Kapoulkine, meshoptimizer, and the Khronos extension EXT_meshopt_compression (mode
// 0). Vertices are cut into blocks; in each, one byte of all its vertices after the other: as
// differences to the vertex before, in groups of sixteen, each with 0, 2, 4 or 8 bits to a byte.

namespace stipple {

namespace {

constexpr std::size_t kGroup = 16;
constexpr std::size_t kBlockBytes = 8'192, kMostInBlock = 256;
constexpr std::size_t kLeastTail = 32;
constexpr std::byte kVersion0{0xA0};

using Differences = std::array<std::uint8_t, kMostInBlock>;

/// The sign in the lowest bit.
std::uint8_t zigzag(std::uint8_t difference) noexcept {
    return static_cast<std::uint8_t>((difference << 1U) ^ (difference >= 0x80U ? 0xFFU : 0U));
}

/// How a group is written.
struct Packing {
    unsigned code;   ///< the logarithm of its bits, 0 for none
    unsigned bytes;  ///< that it takes
};

Packing least_packing(const std::uint8_t* group) noexcept {
    unsigned any = 0, above_2_bits = 0, above_4_bits = 0;
    for (std::size_t i = 0; i < kGroup; ++i) {
        any |= group[i];
        above_2_bits += group[i] >= 3 ? 1U : 0U;
        above_4_bits += group[i] >= 15 ? 1U : 0U;
    }
    if (any == 0) return {0, 0};
    const unsigned by_2 = 4 + above_2_bits, by_4 = 8 + above_4_bits;
    if (std::min(by_2, by_4) >= kGroup) return {3, kGroup};
    return by_2 <= by_4 ? Packing{1, by_2} : Packing{2, by_4};
}

/// What does not fit into the bits follows in whole bytes. @return  the end.
std::uint8_t* write_group(const std::uint8_t* group, unsigned code, std::uint8_t* to) noexcept {
    if (code == 3) return std::copy_n(group, kGroup, to);
    const unsigned bits = 1U << code, most = (1U << bits) - 1;
    for (std::size_t i = 0; i < kGroup;) {
        unsigned packed = 0;
        for (unsigned filled = 0; filled < 8; filled += bits)
            packed = packed << bits | std::min<unsigned>(group[i++], most);
        *to++ = static_cast<std::uint8_t>(packed);
    }
    return std::copy_if(group, group + kGroup, to, [most](unsigned d) { return d >= most; });
}

/// One byte of each vertex of a block: in whole bytes where packing them would save little.
std::uint8_t* write_column(const Differences& differences, std::size_t groups,
                           std::uint8_t* to) noexcept {
    constexpr double kWorth = 0.75;  // of whole bytes
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
        if (code > 0) to = write_group(differences.data() + g * kGroup, code, to);
    }
    return to;
}

}  // namespace

std::vector<std::byte> encode_vertices(std::span<const std::byte> raw, std::size_t stride) {
    const std::size_t count = raw.size() / stride;
    const std::size_t in_block = std::min(kMostInBlock, kBlockBytes / stride / kGroup * kGroup);
    std::vector<std::byte> bytes{kVersion0};
    std::vector<std::uint8_t> block(stride * (kMostInBlock + kMostInBlock / kGroup / 4));
    for (std::size_t begin = 0; begin < count; begin += in_block) {
        const std::size_t size_now = std::min(in_block, count - begin);
        std::uint8_t* end = block.data();
        for (std::size_t k = 0; k < stride; ++k) {
            const std::byte* const column = raw.data() + begin * stride + k;
            Differences differences{};
            auto last = static_cast<std::uint8_t>(begin > 0 ? *(column - stride) : *column);
            for (std::size_t i = 0; i < size_now; ++i) {
                const auto value = static_cast<std::uint8_t>(column[i * stride]);
                differences[i] = zigzag(static_cast<std::uint8_t>(value - last));
                last = value;
            }
            end = write_column(differences, (size_now + kGroup - 1) / kGroup, end);
        }
        const auto* const written = reinterpret_cast<const std::byte*>(block.data());
        bytes.insert(bytes.end(), written, written + (end - block.data()));
    }
    // At the end the first vertex, and room that decoders may read beyond what they need.
    bytes.resize(bytes.size() + std::max(kLeastTail, stride) - stride);
    bytes.insert(bytes.end(), raw.begin(), raw.begin() + static_cast<std::ptrdiff_t>(stride));
    bytes.shrink_to_fit();
    return bytes;
}

}  // namespace stipple
