#pragma once

#include "progressive/cell_surface.hpp"
#include "progressive/range_coder.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <utility>
#include <vector>

// Probabilities of everything that a progressive stream says, learned on the way. One text for both
// sides: `Coder` is `RangeEncoder` or `RangeDecoder`, and every value goes through it.

namespace stipple {

/// A signed number is coded as how many bits it has, its sign, the bit below the highest, and the
/// rest as it is.
struct SizeModel {
    std::array<AdaptiveBit, 16> nodes;  ///< of up to 14 bits; 15 says more
};
struct DetailModel {
    std::array<AdaptiveBit, 32> larger;  ///< bits beyond 15
    std::array<AdaptiveBit, 33> second;  ///< by size
    AdaptiveBit sign;
};

template <typename Coder, std::size_t N>
unsigned code_tree(Coder& coder, std::array<AdaptiveBit, N>& nodes, unsigned value) {
    unsigned node = 1;
    for (unsigned bit = N / 2; bit > 0; bit /= 2)
        node = 2 * node + (coder.bit(nodes[node], (value & bit) != 0) ? 1 : 0);
    return node - static_cast<unsigned>(N);
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
std::int64_t code_signed(Coder& coder, SizeModel& sizes, DetailModel& details, std::int64_t value,
                         unsigned most) {
    constexpr unsigned kMore = 15;
    const auto magnitude = static_cast<std::uint64_t>(std::abs(value));
    auto size = static_cast<unsigned>(std::bit_width(magnitude));
    const unsigned more = size < kMore ? 0 : size - kMore;
    size = code_tree(coder, sizes.nodes, std::min(size, kMore));
    if (size == kMore) size = std::min(kMore + code_tree(coder, details.larger, more), most);
    if (size == 0) return 0;
    const bool negative = coder.bit(details.sign, value < 0);
    std::int64_t result = 1;
    if (size >= 2) {
        const unsigned rest = size - 2;
        const bool second = coder.bit(details.second[size], (magnitude >> rest & 1U) != 0);
        const auto below = static_cast<std::uint32_t>(magnitude & ((std::uint64_t{1} << rest) - 1));
        result = std::int64_t{second ? 3 : 2} << rest | code_direct(coder, below, rest);
    }
    return negative ? -result : result;
}

/// A further number of each point: a channel of a colour, one of the two of a normal, a component
/// of an attribute.
struct Channel {
    unsigned bits;  ///< 1..32; differences wrap
    bool follows;   ///< belongs to the channel before it
};

/// A cell of some steps of the grid a side that may hold points, and what their probability goes
/// by.
struct Candidate {
    Cell middle;      ///< in half steps
    CellPlane plane;  ///< of the surface, from the middle
    std::uint16_t context;
};

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

    /// Which cells around a point are asked for others: those of 2^lift steps a side near its plane
    /// that are nearer to it than to its neighbours.
    /// @param places  of the points, in half steps.
    static void find_candidates(Index number, const CellNeighbors& neighbors,
                                const CellTangent& tangent, std::span<const Cell> places,
                                unsigned lift, std::vector<Candidate>& found);

    /// Whether one more point lies in a cell that has got `found`.
    /// @param nearest  how far from its middle the nearest lies that came in this round, in its
    /// sides.
    template <typename Coder>
    bool code_candidate(Coder& coder, const Candidate& candidate, double nearest, unsigned found,
                        bool there) {
        if (found > 0)
            return coder.bit(
                more_[candidate.context / (kDistances * kHeights)][std::min(found, 2U) - 1], there);
        const unsigned near = nearest < 0.7 ? 0 : nearest < 1.0 ? 1 : nearest < 1.5 ? 2 : 3;
        return coder.bit(candidate_[candidate.context][near], there);
    }

    /// Whether one more point is told by its offset from one that has got `told` so.
    template <typename Coder>
    bool code_far(Coder& coder, const CellTangent& tangent, unsigned told, bool more) {
        return coder.bit(far_[std::min(told, 2U)][spacing_scale(tangent)]
                             [bin(16 * tangent.plane.roughness / tangent.spacing, 4)],
                         more);
    }

    /// The offset of a point, in steps: in the tangent plane, then from it.
    template <typename Coder>
    Cell code_offset(Coder& coder, const CellTangent& tangent, Cell offset) {
        const auto& [n, height, roughness, a] = tangent.plane;
        const unsigned b = (a + 1) % 3, c = (a + 2) % 3, scale = spacing_scale(tangent);
        const auto code = [&](SizeModel& sizes, DetailModel& details, std::int32_t value) {
            return static_cast<std::int32_t>(
                code_signed(coder, sizes, details, value, kPositionBits));
        };
        offset[b] = code(first_[scale], detail_[0], offset[b]);
        const unsigned relative = std::clamp<int>(
            static_cast<int>(scale_of(offset[b])) - static_cast<int>(scale) + 5, 0, kRelative - 1);
        offset[c] = code(second_[scale][relative], detail_[1], offset[c]);
        const double along = 0.5 * height - (n[b] * offset[b] + n[c] * offset[c]);
        const auto expected = static_cast<std::int32_t>(std::floor(0.5 + along / n[a]));
        const unsigned distance =
            std::min(scale_of(std::max(std::abs(offset[b]), std::abs(offset[c]))), kAcross - 1);
        offset[a] = expected + code(across_[bin(2 * roughness, kAcross)][distance], detail_[2],
                                    offset[a] - expected);
        return offset;
    }

    /// The bits of a point whose cell is split, `planes` for each axis.
    /// @param plane  of the surface, from the middle of the cell, in half steps of the finer grid.
    /// @param fine  the cell on that grid.
    template <typename Coder>
    Cell split(Coder& coder, const CellPlane& plane, unsigned planes, const Cell& fine) {
        return code_bits(
            coder, plane, planes, fine, across_split_, [&](unsigned, double, double size) -> auto& {
                return along_split_[rough_class(plane, size) / 2];
            });
    }

    /// The same of a point that came in a candidate.
    /// @param parent  the place around which it was asked for.
    template <typename Coder>
    Cell place_within(Coder& coder, const Candidate& candidate, const Cell& parent, unsigned planes,
                      const Cell& fine) {
        return code_bits(
            coder, candidate.plane, planes, fine,
            across_new_, [&](unsigned axis, double moved, double size) -> auto& {
                const double way = parent[axis] - candidate.middle[axis];
                return along_new_[bin(4 + 4 * (way - moved) / size, kToward)];
            });
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
                code_signed(coder, model.sizes[before], model.detail, wrapped, 32);
            values[c] = (parent[c] + static_cast<std::uint32_t>(difference)) << unused >> unused;
            before = std::min(7U, static_cast<unsigned>(std::bit_width(
                                      static_cast<std::uint64_t>(std::abs(difference)))));
        }
    }

private:
    static constexpr unsigned kScales = 32, kRelative = 8, kAcross = 16;
    static constexpr unsigned kPositionBits = 25;  // no sum of what it gives overflows
    static constexpr unsigned kSpacingClasses = 6, kDistances = 11, kHeights = 6;
    static constexpr unsigned kAcrossPlane = 24, kRough = 8, kAlong = 8, kToward = 8;

    /// Of bits along the surface and across it, by how far it is from the middle.
    using AlongModel = std::array<AdaptiveBit, kAlong>;
    using AcrossModel = std::array<std::array<AdaptiveBit, kAcrossPlane>, kRough>;

    struct ChannelModel {
        std::array<SizeModel, 8> sizes;  ///< by the size of the channel before
        DetailModel detail;
    };

    /// The whole part of a number, 0 for negative ones and what is none, at most count - 1.
    static unsigned bin(double value, unsigned count) noexcept {
        if (!(value > 0)) return 0;
        return value < count ? static_cast<unsigned>(value) : count - 1;
    }

    /// Of a mean distance of neighbours, in sides of the cells that are asked.
    static unsigned spacing_class(double spacing) noexcept {
        constexpr std::array<double, kSpacingClasses - 1> kFrom = {0.9, 1.2, 1.6, 2.2, 3};
        unsigned from = 0;
        while (from < kFrom.size() && spacing >= kFrom[from]) ++from;
        return from;
    }

    static unsigned rough_class(const CellPlane& plane, double size) noexcept {
        return bin(8 * plane.roughness / size, kRough);
    }

    /// One plane after the other, of each the axes along the surface first.
    template <typename Coder>
    static Cell code_bits(Coder& coder, const CellPlane& plane, unsigned planes, const Cell& fine,
                          AcrossModel& across, auto&& along);

    /// Two to an octave.
    static unsigned scale_of(std::int32_t length) noexcept {
        const auto l = static_cast<unsigned>(std::abs(length));
        if (l < 2) return l;
        const auto size = static_cast<unsigned>(std::bit_width(l));
        return std::min(2 * size - 2 + (l >> (size - 2) & 1U), kScales - 1);
    }
    static unsigned spacing_scale(const CellTangent& tangent) noexcept {
        return scale_of(static_cast<std::int32_t>(0.5 * tangent.spacing));
    }

    std::vector<Channel> channels_;
    std::array<std::array<AdaptiveBit, 2>, kSpacingClasses> more_;
    std::array<std::array<AdaptiveBit, 4>, kSpacingClasses * kDistances * kHeights> candidate_;
    std::array<std::array<std::array<AdaptiveBit, 4>, kScales>, 3> far_;
    std::array<SizeModel, kScales> first_;
    std::array<std::array<SizeModel, kRelative>, kScales> second_;
    std::array<std::array<SizeModel, kAcross>, kAcross> across_;
    std::array<DetailModel, 3> detail_;
    AlongModel along_split_[kRough / 2], along_new_[kToward];
    AcrossModel across_split_, across_new_;
    std::vector<ChannelModel> of_channel_;
};

template <typename Coder>
Cell ProgressiveModel::code_bits(Coder& coder, const CellPlane& plane, unsigned planes,
                                 const Cell& fine, AcrossModel& across, auto&& along) {
    const std::array<double, 3>& n = plane.normal;
    std::array<double, 3> moved{};  // from the middle of the first cell to that of the present one
    Cell bits{};
    for (unsigned p = planes; p-- > 0;) {
        const auto quarter = static_cast<double>(1U << p), size = 4 * quarter;
        for (unsigned turn = 1; turn <= 3; ++turn) {
            const unsigned axis = (plane.axis + turn) % 3;
            const double height =
                (plane.offset - (n[0] * moved[0] + n[1] * moved[1] + n[2] * moved[2])) / size;
            AdaptiveBit& model =
                axis == plane.axis
                    ? across[rough_class(plane, size)]
                            [bin(12 + 12 * height / n[axis], kAcrossPlane)]
                    : along(axis, moved[axis], size)[bin(4 + 6 * height * n[axis], kAlong)];
            const bool bit = coder.bit(model, (fine[axis] >> p & 1) != 0);
            bits[axis] = 2 * bits[axis] + (bit ? 1 : 0);
            moved[axis] += bit ? quarter : -quarter;
        }
    }
    return bits;
}

}  // namespace stipple
