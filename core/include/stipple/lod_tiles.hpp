#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/surface_error.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace stipple {

/// How accurately the errors of levels and tiles are measured.
enum class LodErrors {
    Rough,  ///< at 2,048 places per level: its mean to 4 to 8 %, the largest is seldom met
    Sure,   ///< at enough places to know the mean of a level to 1.6 %
    Exact,  ///< at every point of the source (131,072 places for fewer than 40,000 points): the
            ///< mean of each single tile is known to a percent; takes three to six times as long
};

struct LodTileOptions {
    unsigned position_bits =
        14;  ///< 2..24 per axis, for the longest side (where strays lie far off, of the box around
             ///< most points): in the finest level, and the most that any
             ///< level uses; more if steps would otherwise exceed the spacing of the source
    std::optional<double>
        precision{};  ///< instead of position_bits: the largest error per axis of the finest level,
                      ///< input units, up to 29 bits; coarser levels use fewer
    std::uint64_t finest_points = 0;  ///< points of that level, if it should have the precision
                                      ///< although it is not the whole source
    double tolerance =
        0.16;  ///< a level uses about the longest steps that add no more than this fraction to its
               ///< mean error, at most half its spacing; >= 0. Steps twice as long save a fifth of
               ///< the bytes: more than it takes to make up for such an error by more points
    std::uint32_t max_points = 65'536;  ///< per tile, 1..65,536; a level with more is split; a
                                        ///< pyramid has at most 28,000 tiles
    bool attributes = false;            ///< include scalar attributes, besides normals and colours
    LodErrors errors = LodErrors::Sure;
    bool level_errors =
        false;  ///< also measure the error of each level before rounding: `LodTiler::level_error`
    bool additive = false;  ///< a tile has only the points that no coarser level has: a level is
                            ///< all tiles down to it. Levels are nested, and all use full precision
};

/// @throws Error(InvalidArgument) for an option out of range.
void validate(const LodTileOptions& options);

/// Distances from the surface of the source to that of decoded points (§4, linear basis), input
/// units.
struct TileError {
    double mean = 0, max = 0,
           p99 = 0;              ///< over the samples: places of the source, weighted by area
    double mean_confidence = 0;  ///< half width of the 95 % confidence interval of the mean
    std::uint64_t samples = 0;
};

/// Measurements of a tile, or of all tiles of a level, as decoded. Input units.
struct LodFigures {
    TileError error;     ///< over the part of the source in the cell of the tile
    double spacing = 0;  ///< mean distance to the nearest other decoded point of the level, or,
                         ///< where most points share places, from place to place; of a tile at most
                         ///< 8 times that of the level, or steps: points in the air are no surface
    double cover_radius = 0;  ///< largest distance, over the samples, from a place of the source in
                              ///< the cell to the nearest decoded point of the level
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
    static constexpr float kNoData = std::numeric_limits<float>::lowest();

    std::string name;  ///< `POSITION`, `NORMAL`, `COLOR_0` (linear light), `_COLOR_0_ALPHA`, or `_`
                       ///< and the name of an attribute
    Type type = Type::Uint16;
    unsigned components = 3;
    bool normalized = false;
    unsigned stride = 8;             ///< bytes per decoded point, with padding
    bool octahedral = false;         ///< unit vectors, packed before compression
    bool has_no_data = false;        ///< whether some values are `kNoData`: they were not finite,
                                     ///< which glTF forbids
    double offset = 0;               ///< of `Float`: was taken off the values, as of GPS times that
                                     ///< floats would not tell apart; the same in all tiles
    std::vector<std::byte> bytes{};  ///< vertex codec version 0 of meshoptimizer, for further
                                     ///< compression by Brotli or gzip
};

/// A part of a level: points on the grid of the level, sorted and compressed.
///
/// A point q of the stream `POSITION` (three unsigned 16-bit numbers) lies at offset + step * q,
/// relative to `LodTiler::center`. Offsets are whole multiples of the step, except for a common
/// part if a few points lie far off; and the step is that of the level: the same place has the same
/// coordinates in all its tiles.
struct LodTile : LodFigures {
    unsigned level = 0;
    std::optional<std::uint32_t> parent{};  ///< index of a tile of a coarser level, counted over
                                            ///< all levels in the order they were made
    std::uint64_t points = 0;               ///< at least 1
    Vec3d offset = Vec3d::Zero();
    double step = 1;                      ///< input units, > 0
    unsigned bits = 0;                    ///< per axis, for the longest side of the source
    std::array<std::uint16_t, 3> last{};  ///< largest number for each axis; the smallest is 0
    std::vector<TileStream> streams;
};

/// Splits the levels of a pyramid into tiles and encodes them, level by level, coarsest first.
///
/// Space is split once for all levels: a tile's points lie in the cell of its parent. A cell of a
/// level is split at the median while it has more than `max_points`, so that tiles have between
/// half of that and all of it if levels grow evenly. Tiles whose points all coincide are not split;
/// tiles wider than 65,535 steps are.
///
/// A point moves by no more than half a step along each axis; in a level of up to 131,072 points
/// that is not the whole, by no more than a step and a half: it moves to the nearby place of the
/// grid that is nearest to the surface, which saves one bit for the same error.
///
/// In an additive pyramid a level is drawn by its tiles and all those above them; each added level
/// must begin with the points of the one before (`LodPyramidOptions::nested`). Measurements of a
/// tile then refer to all points down to its level.
///
/// Errors are measured on the decoded points. With `LodErrors::Sure`, at one place per 128 points
/// of the level, at least 8,192 (32,768 for a source of fewer than 40,000 points), and at more, up
/// to 131,072, if these do not determine the level's mean to 1.6 %: at about 8,000 to 20,000 for
/// scans of surfaces, up to 40,000 for noisy ones and trees in LiDAR scans. A tile has the places
/// in its cell, a few hundred; it reports how many, and how well they determine its mean. A tile
/// without any, which rarely has many points, gets the figures of its level. If a projection onto
/// the surface does not converge, the distance is at most the way to the nearest point and from
/// there to the plane of its neighbourhood.
///
/// O(N log N), parallel, the same bytes for any number of threads; about 60 bytes per point of the
/// source.
class LodTiler {
public:
    static constexpr std::uint32_t kMostTiles =
        28'000;  ///< of a pyramid, whose list would else be too long to pass on

    /// @param source  a cleaned cloud of at least one point; not needed afterwards.
    LodTiler(const PointCloud& source, const LodTileOptions& options,
             const RunContext& context = {});
    ~LodTiler();
    LodTiler(const LodTiler&) = delete;
    LodTiler& operator=(const LodTiler&) = delete;

    /// The place to which tiles are relative, in the coordinates of the source's file: the centre
    /// of the source's bounds.
    const Vec3d& center() const noexcept;

    /// The numbers of the source's points in the order of a curve; valid as long as the tiler
    /// lives.
    std::span<const Index> order() const noexcept;

    /// @param cloud  the next finer level, of at least one point.
    /// @param whole  whether it is the source itself, which uses full precision. Ignored if tiles
    /// are additive.
    /// @param order  of its points along a curve, if known (`LodLevel::order`); empty: it is
    /// computed.
    /// @throws Error(InvalidArgument) for a cloud without points; for additive tiles, for one with
    /// no more points than the level before; for an order of another number of points;
    /// Error(TooLarge) for more tiles than a pyramid may have.
    std::vector<LodTile> add_level(const PointCloud& cloud, bool whole,
                                   const RunContext& context = {},
                                   std::span<const Index> order = {});

    /// Forgets all levels: the next is the coarsest again.
    void restart();

    /// Of the level added last, over all its tiles; if tiles are additive, over those above, too.
    const LodFigures& figures() const noexcept;

    /// Mean distance between the points of the level added last and their nearest others before
    /// rounding, input units. An estimate from 512 of them, in which no few far-off ones count for
    /// much: within 6 % of `mean_spacing` where there are none.
    double level_spacing() const noexcept;

    /// How far the level added last is from the source before rounding, as by `estimate_error`, but
    /// more accurate, from 4,096 places on the source (2,048 with `LodErrors::Rough`), and in a
    /// small part of the time, since its tree exists and half of the places are evaluated for
    /// rounding anyway. Zero for the source itself; nothing unless requested.
    const std::optional<SurfaceError>& level_error() const noexcept;

private:
    struct State;
    std::unique_ptr<State> state_;
};

/// The decoded points of a tile, relative to `center`: positions, normals, colours, attributes.
/// Values of attributes that were not finite are NaN; those with an offset are doubles.
/// @throws Error(MalformedInput) for streams that cannot be decoded.
PointCloud decode_tile(const LodTile& tile, const Vec3d& center = Vec3d::Zero());

}  // namespace stipple
