#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/surface_error.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace stipple {

/// How well the errors of levels and tiles are known.
enum class LodErrors {
    Rough,  ///< at 2,048 places a level: its mean to 4 to 8 %, the largest is seldom met
    Sure,   ///< at so many that the mean of a level is known to 1.6 %
    Exact,  ///< at every point of the source (131,072 places of fewer than 40,000 points): the
            ///< means of single tiles, too, to a percent; takes three to six times as long
};

struct LodTileOptions {
    unsigned position_bits = 14;  ///< 2..24 for each axis of the longest side: of the finest level,
                                  ///< and the most that any level takes; more where steps would
                                  ///< else be longer than the spacing of the source
    std::optional<double>
        precision{};  ///< instead of position_bits: the largest error per axis of the finest level,
                      ///< input units, as far as 29 bits go; coarser levels take fewer
    std::uint64_t finest_points = 0;  ///< of that level, if it is to have the precision though it
                                      ///< is not the whole source
    double tolerance = 0.16;  ///< a level takes about the longest steps by which its mean error
                              ///< grows by no more than this part, of at most half its spacing; >=
                              ///< 0. Steps twice as long save a fifth of the bytes: more than it
                              ///< takes to make up for such an error by more points
    std::uint32_t max_points = 65'536;  ///< of a tile, 1..65,536; a level with more is cut;
                                        ///< a pyramid has at most 28,000 tiles
    bool attributes = false;            ///< scalar attributes too, beside normals and colours
    LodErrors errors = LodErrors::Sure;
    bool level_errors = false;  ///< the error of each level as it is before it is rounded, too:
                                ///< `LodTiler::level_error`
    bool additive = false;  ///< a tile has only the points that no coarser level has: a level is
                            ///< all tiles down to it. Levels are nested, and all take all bits
};

/// @throws Error(InvalidArgument) for an option out of range.
void validate(const LodTileOptions& options);

/// Distances from the surface of the source to that of decoded points (§4, linear basis), input
/// units.
struct TileError {
    double mean = 0, max = 0, p99 = 0;  ///< over the samples: places of the source, by their area
    double mean_confidence = 0;         ///< the mean is within so much of that for infinitely many
                                        ///< samples, in 95 of 100 cases
    std::uint64_t samples = 0;
};

/// What is measured of a tile, or of all tiles of a level, as they decode. Input units.
struct LodFigures {
    TileError error;          ///< over the part of the source in the cell of the tile
    double spacing = 0;       ///< mean distance to the nearest other decoded point of the level
    double cover_radius = 0;  ///< from a point of the source in the cell to the nearest decoded
                              ///< point of the level: at most, over the samples
};

/// One array of a tile, compressed.
struct TileStream {
    enum class Type : std::uint16_t {  ///< as glTF numbers them
        Int8 = 5120,
        Uint8 = 5121,
        Int16 = 5122,
        Uint16 = 5123,
        Float = 5126,
    };
    std::string name;  ///< `POSITION`, `NORMAL`, `COLOR_0` (linear light), `_COLOR_0_ALPHA`, or `_`
                       ///< and the name of an attribute
    Type type = Type::Uint16;
    unsigned components = 3;
    bool normalized = false;
    unsigned stride = 8;             ///< bytes of a decoded point, with padding
    bool octahedral = false;         ///< unit vectors, packed once more before compression
    std::vector<std::byte> bytes{};  ///< vertex codec version 0 of meshoptimizer, for Brotli or
                                     ///< gzip to pack once more
};

/// A piece of a level: points on the grid of the level, sorted and compressed.
///
/// A point q of the stream `POSITION` (three unsigned 16-bit numbers) lies at offset + step * q,
/// relative to `LodTiler::center`. Offsets are whole multiples of the step, but for what all have
/// in common where a few points lie far off; and the step is that of the level: the same place has
/// the same coordinates in all its tiles.
struct LodTile : LodFigures {
    unsigned level = 0;
    std::optional<std::uint32_t> parent{};  ///< number of a tile of a coarser level, counted over
                                            ///< all levels in the order they were made
    std::uint64_t points = 0;               ///< at least 1
    Vec3d offset = Vec3d::Zero();
    double step = 1;                      ///< input units, > 0
    unsigned bits = 0;                    ///< for each axis of the longest side of the source
    std::array<std::uint16_t, 3> last{};  ///< largest number for each axis; the least is 0
    std::vector<TileStream> streams;
};

/// Cuts the levels of a pyramid into tiles and encodes them, level by level, coarsest first.
///
/// Space is cut once for all levels: a tile's points lie in the cell of its parent. A cell of a
/// level is cut at the median while it has more than `max_points`, so that tiles have between half
/// of that and all of it where levels grow evenly. Tiles that coincide in one place are not cut;
/// tiles wider than 65,535 steps are.
///
/// A point moves by no more than half a step along each axis; in a level of up to 131,072 points
/// that is not the whole, by no more than a step and a half: it goes to the place of the grid
/// nearby that is nearest to the surface, which takes one bit less for the same error.
///
/// Of an additive pyramid a level is drawn by its tiles and all those above them; each level that
/// is added must begin with the points of the one before (`LodPyramidOptions::nested`). What is
/// said of a tile is then said of all points that are there down to its level.
///
/// Errors are measured on the decoded points; if they are to be sure, at one place for 128 points
/// of the level, at least 8,192 (32,768 of a source of fewer than 40,000 points), and at more, up
/// to 131,072, for a level whose mean is not known to 1.6 % by them: at some 8,000 to 20,000 for
/// scans of surfaces, at up to 40,000 for noisy ones and trees in LiDAR scans. A tile has the
/// places in its cell, a few hundred: each says how many, and how well its mean is known by them. A
/// tile without any, which is hardly one with many points, has the figures of its level. Where no
/// walk to the surface comes to an end, what counts is at most the way to the nearest point and
/// from there to the plane of its neighbourhood.
///
/// O(N log N), parallel, the same bytes for any number of threads; about 60 bytes a point of the
/// source.
class LodTiler {
public:
    /// @param source  a cleaned cloud of at least one point; not needed afterwards.
    LodTiler(const PointCloud& source, const LodTileOptions& options,
             const RunContext& context = {});
    ~LodTiler();
    LodTiler(const LodTiler&) = delete;
    LodTiler& operator=(const LodTiler&) = delete;

    /// The place to which tiles are relative, in the coordinates of the source's file: the middle
    /// of the source's bounds.
    const Vec3d& center() const noexcept;

    /// The numbers of the source's points in the order of a curve, as long as the tiler lives.
    std::span<const Index> order() const noexcept;

    /// @param cloud  the next finer level, of at least one point.
    /// @param whole  it is the source itself: it takes all bits. Does not matter where tiles are
    /// additive.
    /// @param order  of its points along a curve, where it is known (`LodLevel::order`); empty: it
    /// is found.
    /// @throws Error(InvalidArgument) for a cloud without points, for one that has no more than the
    /// level before where tiles are additive, and for an order of another number of points;
    /// Error(TooLarge) where the tiles become more than a pyramid has.
    std::vector<LodTile> add_level(const PointCloud& cloud, bool whole,
                                   const RunContext& context = {},
                                   std::span<const Index> order = {});

    /// Forgets all levels: the next is the coarsest again.
    void restart();

    /// Of the level added last, over all its tiles.
    const LodFigures& figures() const noexcept;

    /// How far the level added last, as it is before it is rounded, is from the source, as
    /// `estimate_error` tells it; better, by 4,096 places on the source (2,048 where errors may be
    /// rough), and in a small part of the time, since its tree is at hand and half of the places
    /// are asked to round it anyway. Zero for the source itself; nothing unless asked for.
    const std::optional<SurfaceError>& level_error() const noexcept;

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// The decoded points of a tile, relative to `center`: positions, normals, colours, attributes.
/// @throws Error(MalformedInput) for streams that do not decode.
PointCloud decode_tile(const LodTile& tile, const Vec3d& center = Vec3d::Zero());

}  // namespace stipple
