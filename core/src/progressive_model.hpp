#pragma once

#include "range_coder.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <utility>
#include <vector>

// What the two sides of a progressive cloud know, and the probabilities that follow from it. One
// text for both: `Coder` is `RangeEncoder` or `RangeDecoder`, and every value goes through it.

namespace stipple {

using Cell = std::array<std::int32_t, 3>;

/// A signed number is coded as how many bits it has, its sign, the bit below the highest, and the
/// rest as it is.
struct SizeModel {
    std::array<AdaptiveBit, 16> nodes;  ///< of up to 14 bits; 15 says more
};
struct DetailModel {
    std::array<AdaptiveBit, 32> larger;  ///< bits beyond 15
    std::array<AdaptiveBit, 33> second;  ///< by size
};

template <typename Coder, std::size_t N>
unsigned code_tree(Coder& coder, std::array<AdaptiveBit, N>& nodes, unsigned value) {
    unsigned node = 1;
    for (unsigned bit = N / 2; bit > 0; bit /= 2)
        node = 2 * node + (coder.bit(nodes[node], (value & bit) != 0) ? 1 : 0);
    return node - N;
}

template <typename Coder>
std::uint32_t code_direct(Coder& coder, std::uint32_t value, unsigned count) {
    std::uint32_t high = 0;
    if (count > kMostDirectBits) {
        high = coder.direct(value >> kMostDirectBits, count - kMostDirectBits) << kMostDirectBits;
        count = kMostDirectBits;
    }
    return count == 0 ? high : high | coder.direct(value & ((1U << count) - 1U), count);
}

/// A number of up to `most` bits, at most 32, and its sign.
template <typename Coder>
std::int64_t code_signed(Coder& coder, SizeModel& sizes, DetailModel& details, AdaptiveBit& sign,
                         std::int64_t value, unsigned most) {
    constexpr unsigned kMore = 15;
    const auto magnitude = static_cast<std::uint64_t>(std::abs(value));
    auto size = static_cast<unsigned>(std::bit_width(magnitude));
    const unsigned more = size < kMore ? 0 : size - kMore;
    size = code_tree(coder, sizes.nodes, std::min(size, kMore));
    if (size == kMore) size = std::min(kMore + code_tree(coder, details.larger, more), most);
    if (size == 0) return 0;
    const bool negative = coder.bit(sign, value < 0);
    std::int64_t result = 1;
    if (size >= 2) {
        const unsigned rest = size - 2;
        const bool second = coder.bit(details.second[size], (magnitude >> rest & 1U) != 0);
        const auto below = static_cast<std::uint32_t>(magnitude & ((std::uint64_t{1} << rest) - 1));
        result = std::int64_t{second ? 3 : 2} << rest | code_direct(coder, below, rest);
    }
    return negative ? -result : result;
}

/// What is known of a point that is there.
struct TracedPoint {
    Cell cell;    ///< on the grid of the batch
    Cell toward;  ///< from it to the point that was last attached to it, or to its
                  ///< parent
    std::array<float, 3> normal = {0, 0, 1};  ///< of the surface, as far as offsets tell; unit
    std::uint8_t roughness;                   ///< bits of the last miss of the tangent plane
    std::int8_t bend;                         ///< sign of that miss along the normal
    std::uint8_t idle;  ///< 0: new in this batch; 1: something was attached last time; else how
                        ///< many batches ago, plus 1
};

/// A further number of each point: a channel of a colour, one of the two of a normal, a component
/// of an attribute.
struct Channel {
    unsigned bits;  ///< 1..32; differences wrap
    bool follows;   ///< belongs to the channel before it
};

/// Probabilities of everything that a stream says, learned on the way.
class ProgressiveModel {
public:
    explicit ProgressiveModel(std::vector<Channel> channels)
        : channels_(std::move(channels)), of_channel_(channels_.size()) {}

    std::size_t channel_count() const noexcept { return channels_.size(); }

    template <typename Coder>
    void code_root(Coder& coder, Cell& cell, unsigned bits) {
        for (std::int32_t& c : cell)
            c = static_cast<std::int32_t>(code_direct(coder, static_cast<std::uint32_t>(c), bits));
    }

    /// Splits the cell of a point: `below` is where it lies within, in 2^bits parts for each axis.
    template <typename Coder>
    void refine(Coder& coder, TracedPoint& point, unsigned bits, const Cell& below) {
        for (unsigned plane = bits; plane-- > 0;) {
            std::uint32_t octant = 0;
            for (int axis = 0; axis < 3; ++axis)
                octant = 2 * octant + (static_cast<std::uint32_t>(below[axis]) >> plane & 1U);
            octant = coder.direct(octant, 3);
            for (int axis = 0; axis < 3; ++axis) {
                point.cell[axis] =
                    2 * point.cell[axis] + static_cast<std::int32_t>(octant >> (2 - axis) & 1U);
            }
        }
        for (std::int32_t& t : point.toward) t *= 1 << bits;
        point.roughness = static_cast<std::uint8_t>(std::min(point.roughness + bits, kRoughest));
    }

    /// Whether one more is attached to the point, which has got `attached` in this batch.
    template <typename Coder>
    bool code_more(Coder& coder, const TracedPoint& point, unsigned attached, bool more) {
        return coder.bit(more_[std::min(attached, 2U)][point.idle][scale_of(longest(point.toward))],
                         more);
    }

    /// What a point remembers of a batch.
    static void visited(TracedPoint& point, unsigned attached) noexcept {
        point.idle = static_cast<std::uint8_t>(attached > 0 ? 1 : std::clamp(point.idle + 1, 2, 4));
    }

    /// A point attached to `parent`, `offset` away.
    template <typename Coder>
    TracedPoint attach(Coder& coder, TracedPoint& parent, Cell offset) {
        const std::array<float, 3> n = parent.normal;
        const int a = main_axis(n), b = (a + 1) % 3, c = (a + 2) % 3;
        const std::int32_t reach = longest(parent.toward);
        const unsigned scale = scale_of(reach);

        offset[b] = static_cast<std::int32_t>(
            code_signed(coder, first_[scale], detail_[0],
                        first_sign_[side_of(parent.toward[b], reach)], offset[b], kPositionBits));
        const unsigned ratio = std::min(scale_of(std::abs(offset[b])), kScales - 1);
        const unsigned relative =
            std::clamp<int>(static_cast<int>(ratio) - static_cast<int>(scale) + 5, 0, 7);
        offset[c] = static_cast<std::int32_t>(
            code_signed(coder, second_[scale][relative], detail_[1],
                        second_sign_[side_of(parent.toward[c], reach)], offset[c], kPositionBits));
        // Where the tangent plane is, and how far from it the point.
        const double along = double{n[b]} * offset[b] + double{n[c]} * offset[c];
        const auto expected = static_cast<std::int32_t>(std::floor(0.5 - along / double{n[a]}));
        const unsigned distance = scale_of(std::max(std::abs(offset[b]), std::abs(offset[c])));
        const bool upward = n[a] > 0;
        const auto miss = static_cast<std::int32_t>(code_signed(
            coder, across_[parent.roughness][std::min(distance, 15U)], detail_[2],
            bend_[parent.bend + 1][upward ? 1 : 0], offset[a] - expected, kPositionBits));
        offset[a] = expected + miss;

        TracedPoint child{};
        for (int axis = 0; axis < 3; ++axis) {
            child.cell[axis] = parent.cell[axis] + offset[axis];
            child.toward[axis] = -offset[axis];
        }
        parent.toward = offset;
        parent.roughness = static_cast<std::uint8_t>(
            std::min(static_cast<unsigned>(std::bit_width(static_cast<unsigned>(std::abs(miss)))),
                     kRoughest));
        parent.bend = static_cast<std::int8_t>(miss == 0 ? 0 : (miss > 0) == upward ? 1 : -1);
        turn(parent.normal, offset);
        child.normal = parent.normal;
        child.roughness = parent.roughness;
        child.bend = parent.bend;
        return child;
    }

    /// The channels of a point, by those of its parent.
    template <typename Coder>
    void code_channels(Coder& coder, std::span<const std::uint32_t> parent,
                       std::span<std::uint32_t> values) {
        unsigned before = 0;
        for (std::size_t c = 0; c < channels_.size(); ++c) {
            if (!channels_[c].follows) before = 0;
            ChannelModel& model = of_channel_[c];
            const unsigned unused = 32 - channels_[c].bits;
            const auto wrapped =
                static_cast<std::int32_t>((values[c] - parent[c]) << unused) >> unused;
            const std::int64_t difference =
                code_signed(coder, model.sizes[before], model.detail, model.sign, wrapped, 32);
            values[c] = (parent[c] + static_cast<std::uint32_t>(difference)) << unused >> unused;
            before = std::min(7U, static_cast<unsigned>(std::bit_width(
                                      static_cast<std::uint64_t>(std::abs(difference)))));
        }
    }

private:
    static constexpr unsigned kScales = 32;
    static constexpr unsigned kRoughest = 7;
    static constexpr unsigned kPositionBits = 25;  // no sum of what it gives overflows

    struct ChannelModel {
        std::array<SizeModel, 8> sizes;  ///< by the size of the channel before
        DetailModel detail;
        AdaptiveBit sign;
    };

    static std::int32_t longest(const Cell& v) noexcept {
        return std::max({std::abs(v[0]), std::abs(v[1]), std::abs(v[2])});
    }

    /// Two to an octave.
    static unsigned scale_of(std::int32_t length) noexcept {
        if (length < 2) return static_cast<unsigned>(length);
        const auto l = static_cast<unsigned>(length);
        const auto size = static_cast<unsigned>(std::bit_width(l));
        return std::min(2 * size - 2 + (l >> (size - 2) & 1U), kScales - 1);
    }

    static unsigned side_of(std::int32_t component, std::int32_t reach) noexcept {
        if (2 * std::int64_t{std::abs(component)} <= reach) return 1;
        return component > 0 ? 2 : 0;
    }

    static int main_axis(const std::array<float, 3>& n) noexcept {
        const float x = std::abs(n[0]), y = std::abs(n[1]), z = std::abs(n[2]);
        if (z >= x && z >= y) return 2;
        return y >= x ? 1 : 0;
    }

    /// Turns a normal so that it is across an offset, less for short ones, which say little.
    static void turn(std::array<float, 3>& normal, const Cell& offset) noexcept {
        const double x = offset[0], y = offset[1], z = offset[2];
        constexpr double kRounding = 2;
        const double t =
            (normal[0] * x + normal[1] * y + normal[2] * z) / (x * x + y * y + z * z + kRounding);
        const double nx = normal[0] - t * x, ny = normal[1] - t * y, nz = normal[2] - t * z;
        const double length_sq = nx * nx + ny * ny + nz * nz;
        if (!(length_sq > 1e-6)) return;  // the offset went along the normal
        const double scale = 1 / std::sqrt(length_sq);
        normal = {static_cast<float>(nx * scale), static_cast<float>(ny * scale),
                  static_cast<float>(nz * scale)};
    }

    std::vector<Channel> channels_;
    std::array<std::array<std::array<AdaptiveBit, kScales>, 5>, 3> more_;
    std::array<SizeModel, kScales> first_;
    std::array<std::array<SizeModel, 8>, kScales> second_;
    std::array<std::array<SizeModel, 16>, kRoughest + 1> across_;
    std::array<DetailModel, 3> detail_;
    std::array<AdaptiveBit, 3> first_sign_, second_sign_;
    std::array<std::array<AdaptiveBit, 2>, 3> bend_;
    std::vector<ChannelModel> of_channel_;
};

}  // namespace stipple
