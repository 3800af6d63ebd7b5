#pragma once

#include "stipple/point_cloud.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace stipple {

/// A point on the grid of a file.
using LazPosition = std::array<std::int32_t, 3>;

/// Which of the returns of its pulse a point is: 1 <= number <= count <= 15.
struct LazReturn {
    std::uint8_t number = 1, count = 1;
};

/// Bits of a point that LAS has room for; the others of their byte are the scanner channel, 0.
enum LasFlag : std::uint8_t {
    kLasSynthetic = 1,
    kLasKeyPoint = 2,
    kLasWithheld = 4,
    kLasOverlap = 8,
    kLasScanDirection = 64,
    kLasEdgeOfFlightLine = 128,
};

/// Points as LAS 1.4 has them, in point data record format 6 or, with colours, 7; of all that its
/// records hold, what a cloud has. Each array has N entries or none, for a field that is 0 (of the
/// returns: the only one).
struct LazPoints {
    std::vector<LazPosition> positions;  ///< N >= 1
    std::vector<std::uint16_t> intensities{};
    std::vector<LazReturn> returns{};
    std::vector<std::uint8_t> classifications{}, user_data{};
    std::vector<std::uint8_t> flags{};     ///< `LasFlag`s
    std::vector<std::uint16_t> sources{};  ///< point source IDs
    std::vector<double> times{};           ///< GPS times, finite
    std::vector<Rgba8> colors{};
    std::size_t extra_size = 0;       ///< bytes a point beyond those of its format
    std::vector<std::byte> extras{};  ///< N * extra_size
};

/// Bytes of a point in a format without colours, and of a colour.
inline constexpr std::size_t kLazPointSize = 30, kLazColorSize = 6;

/// A chunk of a LAZ file: the first point as it is, and the others compressed, each field as a
/// layer of its own (the layered scheme of LASzip 3, items POINT14, RGB14 and BYTE14 in version 3).
/// The points come in their order, each expected near those before it.
std::vector<std::byte> encode_laz_chunk(const LazPoints& points);

/// The numbers of points and of bytes of all chunks of a file, as it has them behind the last.
struct LazChunkSize {
    std::uint32_t points, bytes;
};
std::vector<std::byte> encode_laz_chunk_table(const std::vector<LazChunkSize>& chunks);

}  // namespace stipple
