#include "vertex_codec.hpp"

#include "kernel_sets.hpp"

#include <meshoptimizer.h>
#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cstdint>
#include <cstring>

// Follows: Kapoulkine, meshoptimizer (vertex codec), and its description in Khronos'
// EXT_meshopt_compression, mode 0. Values come in blocks of up to 256; in a block the first bytes
// of all values, then the second ones, each less the one before, in groups of 16 that take 0, 2, 4
// or 8 bits for each byte; those that do not fit follow their group.

namespace stipple {

namespace {

#if defined(__SSSE3__)

constexpr std::size_t kGroup = 16, kBlockBytes = 8'192, kMostValues = 256, kLeastTail = 32;
constexpr std::byte kHeader{0xA0};

/// The four columns of bytes of 16 words.
struct Columns {
    __m128i of[4];
};

Columns columns_of(const std::array<std::uint32_t, kGroup>& words) noexcept {
    const __m128i by_byte = _mm_setr_epi8(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
    __m128i rows[4];
    for (std::size_t i = 0; i < 4; ++i)
        rows[i] = _mm_shuffle_epi8(_mm_loadu_si128(reinterpret_cast<const __m128i*>(&words[4 * i])),
                                   by_byte);
    const __m128i low01 = _mm_unpacklo_epi32(rows[0], rows[1]),
                  low23 = _mm_unpacklo_epi32(rows[2], rows[3]),
                  high01 = _mm_unpackhi_epi32(rows[0], rows[1]),
                  high23 = _mm_unpackhi_epi32(rows[2], rows[3]);
    return {{_mm_unpacklo_epi64(low01, low23), _mm_unpackhi_epi64(low01, low23),
             _mm_unpacklo_epi64(high01, high23), _mm_unpackhi_epi64(high01, high23)}};
}

/// Which of 16 bytes are at least as large as `least`, a bit each.
unsigned at_least(__m128i bytes, __m128i least) noexcept {
    return static_cast<unsigned>(
        _mm_movemask_epi8(_mm_cmpeq_epi8(_mm_max_epu8(bytes, least), bytes)));
}

/// Those of eight bytes that are chosen, in order; what is left of the eight places becomes
/// anything.
std::byte* put_chosen(std::byte* to, __m128i bytes, unsigned chosen) noexcept {
    const auto places = static_cast<long long>(kPackedLanes.of[chosen]);
    _mm_storel_epi64(reinterpret_cast<__m128i*>(to),
                     _mm_shuffle_epi8(bytes, _mm_cvtsi64_si128(places)));
    return to + std::popcount(chosen);
}

std::byte* put_chosen_of_group(std::byte* to, __m128i bytes, unsigned chosen) noexcept {
    to = put_chosen(to, bytes, chosen & 0xFFU);
    return put_chosen(to, _mm_srli_si128(bytes, 8), chosen >> 8U);
}

/// Writes a group in the way that takes the fewest bytes. @return  which: 0, 1, 2, 3 for 0, 2, 4, 8
/// bits.
unsigned put_group(std::byte*& to, __m128i bytes) noexcept {
    if (_mm_movemask_epi8(_mm_cmpeq_epi8(bytes, _mm_setzero_si128())) == 0xFFFF) return 0;
    const __m128i most2 = _mm_set1_epi8(3), most4 = _mm_set1_epi8(15);
    const unsigned beyond2 = at_least(bytes, most2), beyond4 = at_least(bytes, most4);
    const int size2 = 4 + std::popcount(beyond2), size4 = 8 + std::popcount(beyond4);
    if (size2 < static_cast<int>(kGroup) && size2 <= size4) {
        // The first of four in the highest bits.
        const __m128i pairs = _mm_maddubs_epi16(_mm_min_epu8(bytes, most2), _mm_set1_epi16(0x0104));
        const __m128i fours = _mm_madd_epi16(pairs, _mm_set1_epi32(0x00010010));
        const __m128i packed = _mm_shuffle_epi8(fours, _mm_set1_epi32(0x0C080400));
        const int word = _mm_cvtsi128_si32(packed);
        std::memcpy(to, &word, sizeof word);
        to = put_chosen_of_group(to + sizeof word, bytes, beyond2);
        return 1;
    }
    if (size4 < static_cast<int>(kGroup)) {
        const __m128i pairs = _mm_maddubs_epi16(_mm_min_epu8(bytes, most4), _mm_set1_epi16(0x0110));
        _mm_storel_epi64(reinterpret_cast<__m128i*>(to), _mm_packus_epi16(pairs, pairs));
        to = put_chosen_of_group(to + 8, bytes, beyond4);
        return 2;
    }
    _mm_storeu_si128(reinterpret_cast<__m128i*>(to), bytes);
    to += kGroup;
    return 3;
}

/// The differences of the bytes of up to 256 values, column by column.
class Block {
public:
    /// @param last  the value before the first.
    Block(const std::byte* values, std::size_t count, std::size_t stride, const std::byte* last)
        : groups_((count + kGroup - 1) / kGroup), stride_(stride) {
        for (std::size_t at = 0; at < stride; at += 4) {
            Columns before;
            for (std::size_t c = 0; c < 4; ++c)
                before.of[c] = _mm_set1_epi8(static_cast<char>(last[at + c]));
            for (std::size_t g = 0; g < groups_; ++g) {
                // What is missing in the last group is like its last value: no difference.
                std::array<std::uint32_t, kGroup> words;
                for (std::size_t i = 0; i < kGroup; ++i) {
                    const std::size_t value = std::min(g * kGroup + i, count - 1);
                    std::memcpy(&words[i], values + value * stride + at, sizeof words[i]);
                }
                const Columns columns = columns_of(words);
                for (std::size_t c = 0; c < 4; ++c) {
                    const __m128i column = columns.of[c];
                    const __m128i step =
                        _mm_sub_epi8(column, _mm_alignr_epi8(column, before.of[c], 15));
                    const __m128i sign = _mm_cmpgt_epi8(_mm_setzero_si128(), step);
                    steps_[(at + c) * groups_ + g] = _mm_xor_si128(_mm_add_epi8(step, step), sign);
                }
                before = columns;
            }
        }
    }

    std::byte* put(std::byte* to) const noexcept {
        for (std::size_t column = 0; column < stride_; ++column) {
            std::byte* const header = to;
            to += (groups_ + 3) / 4;
            std::fill(header, to, std::byte{0});
            for (std::size_t g = 0; g < groups_; ++g) {
                const unsigned way = put_group(to, steps_[column * groups_ + g]);
                header[g / 4] |= static_cast<std::byte>(way << (2 * (g % 4)));
            }
        }
        return to;
    }

private:
    std::size_t groups_, stride_;
    __m128i steps_[kBlockBytes / kGroup];
};

#endif

}  // namespace

std::vector<std::byte> encode_vertices(std::span<const std::byte> raw, std::size_t stride) {
    assert(stride > 0 && stride % 4 == 0 && stride <= 256 && raw.size() % stride == 0);
    const std::size_t count = raw.size() / stride;
    std::vector<std::byte> bytes(meshopt_encodeVertexBufferBound(count, stride));
#if defined(__SSSE3__)
    std::vector<std::byte> first(std::max(kLeastTail, stride));  // it stands at the end
    const std::span<std::byte> last = std::span(first).last(stride);
    if (count > 0) std::copy_n(raw.data(), stride, last.data());
    const std::size_t room = std::min(kBlockBytes / stride / kGroup * kGroup, kMostValues);
    bytes.resize(bytes.size() + kGroup);  // groups are written whole
    bytes[0] = kHeader;
    std::byte* to = bytes.data() + 1;
    for (std::size_t begin = 0; begin < count; begin += room) {
        const std::byte* const values = raw.data() + begin * stride;
        const std::byte* const before = begin == 0 ? values : values - stride;
        to = Block(values, std::min(room, count - begin), stride, before).put(to);
    }
    to = std::ranges::copy(first, to).out;
    bytes.resize(static_cast<std::size_t>(to - bytes.data()));
#else
    bytes.resize(meshopt_encodeVertexBuffer(reinterpret_cast<unsigned char*>(bytes.data()),
                                            bytes.size(), raw.data(), count, stride));
#endif
    bytes.shrink_to_fit();
    return bytes;
}

}  // namespace stipple
