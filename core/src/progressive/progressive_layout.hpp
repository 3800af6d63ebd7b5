#pragma once

#include "progressive/progressive_model.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/progressive_cloud.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace stipple {

inline constexpr unsigned kMostGridBits = 24;

/// An attribute in a progressive stream.
struct ProgressiveAttribute {
    std::string name;
    std::uint8_t type = 0;  ///< index of `AttributeValues`
    std::uint8_t components = 1;
    Reduction reduction = Reduction::Nearest;
    std::uint8_t bits = 0;  ///< of floats on a grid; 0: without loss
    double low = 0, step = 1;

    /// Channels of a component.
    unsigned channels() const noexcept { return type == 7 ? 2 : 1; }
};

/// What the header of a progressive stream says.
struct ProgressiveLayout {
    struct Batch {
        std::uint32_t points = 0;     ///< up to its end, the earlier ones included
        std::uint32_t bytes = 0;      ///< of itself
        std::uint8_t shift = 0;       ///< bits of the grid that are not there yet at its end
        std::uint8_t lift = 0;        ///< bits that cells which are asked for new points lack, more
        std::uint8_t block_bits = 0;  ///< of the blocks in which neighbours are looked for
        std::uint8_t sharpening = 0;  ///< of the points at its end, in `kSharpeningUnit`ths
        float mean_error = 0;         ///< of them as they are shown, input units
    };

    static constexpr int kSharpeningUnit = 64;

    bool normals = false, colors = false, alpha = false, double_precision = false;
    std::uint8_t grid_bits = 0;
    std::uint8_t normal_bits = 0;
    std::uint32_t points = 0;
    double step = 1;            ///< of the grid
    Vec3d low = Vec3d::Zero();  ///< point 0 of the grid, relative to the origin
    Vec3d origin = Vec3d::Zero();
    std::vector<ProgressiveAttribute> attributes;
    std::vector<Batch> batches;

    /// The middle of a cell of the grid that lacks `shift` bits, in half steps of the whole grid.
    static Cell place(const Cell& cell, unsigned shift) noexcept {
        return {(2 * cell[0] + 1) << shift, (2 * cell[1] + 1) << shift, (2 * cell[2] + 1) << shift};
    }
    /// Where a place is, or what is so far from it, in half steps.
    Vec3d position(const Cell& place, const Vec3d& way = Vec3d::Zero()) const noexcept {
        return low + step * 0.5 * (Vec3d(place[0] - 1, place[1] - 1, place[2] - 1) + way);
    }
    /// Of points on the way in or before batch `number`, how much they are put out.
    double sharpening(std::size_t number, std::size_t count) const noexcept;
    /// Of the blocks in which their places are looked for, in half steps of the whole grid.
    unsigned sharpening_block_bits(std::size_t number) const noexcept;
    std::vector<Channel> channels() const;
    /// As many points as a batch of so many bytes may have: a bound for what a decoder allocates.
    static std::uint64_t most_points(std::uint64_t bytes, std::size_t channels) noexcept {
        constexpr std::size_t kFew = 16;
        return 64 + 8 * bytes * kFew / std::max(channels, kFew);
    }
};

std::vector<std::byte> write_header(const ProgressiveLayout& layout);

/// The header's length, once its first bytes are there.
/// @throws Error(MalformedInput) for other bytes, Error(UnsupportedFormat) for another version.
std::optional<std::size_t> header_length(std::span<const std::byte> bytes);

/// @param bytes  as many as `header_length` says. @throws Error(MalformedInput), Error(TooLarge).
ProgressiveLayout parse_header(std::span<const std::byte> bytes, const DecodeLimits& limits);

}  // namespace stipple
