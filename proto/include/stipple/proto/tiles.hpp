#pragma once

#include "stipple/lod_tiles.hpp"
#include "stipple/proto/results.hpp"

#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stipple::proto {

/// A tile as a binary glTF 2.0 file of points: `KHR_mesh_quantization`, `EXT_meshopt_compression`
/// and `KHR_materials_unlit`. glTF has y up, and 3D Tiles rotate it so that z is up: the matrix of
/// the node takes the grid to the place of the tile, and undoes that rotation.
std::vector<std::byte> encode_glb(const LodTile& tile);

/// Decodes what `encode_glb` wrote: grid and streams, without level, error and spacing.
/// @throws Error(MalformedInput) for other bytes.
LodTile decode_glb(std::span<const std::byte> bytes);

/// One file of a tileset.
struct TilesetFile {
    std::string name;  ///< `tileset.json`, or `tileset-17.json` for the part from tile 17 on
    std::string json;
};

/// The measure behind the geometric error of a tile.
enum class TilesetError {
    Max,      ///< the larger of its maximum error and its spacing; for a leaf its spacing
    Mean,     ///< `avg`: its mean error
    P99,      ///< its error at 99 % of the surface
    Spacing,  ///< its spacing
};
std::string_view to_string(TilesetError error) noexcept;
/// @throws Error(InvalidArgument) for a name other than `max`, `avg`, `p99`, `spacing`.
TilesetError tileset_error_from_name(std::string_view name);

/// How a tileset is written.
struct TilesetOptions {
    static constexpr double kLeastScale = 1e-6, kMostScale = 1e6;

    std::size_t max_tiles = 5'000;  ///< per file, at least 1
    TilesetError error = TilesetError::Max;
    double error_scale = 1;  ///< factor on the measure, kLeastScale..kMostScale: above 1 viewers
                             ///< load more

    friend bool operator==(const TilesetOptions&, const TilesetOptions&) = default;
};
/// @throws Error(InvalidArgument) naming the field, its value and the limit.
void validate(const TilesetOptions& options);

/// The options as a query, such as `?error=avg&errorScale=2`; empty for the defaults. Omits
/// `max_tiles`.
std::string tileset_query(const TilesetOptions& options);

/// The pyramid as a 3D Tiles 1.1 tileset: an explicit tree of the tiles of `results.levels`, with
/// REPLACE refinement, or ADD for additive tiles; also while levels are still to come. Addresses of
/// tiles are relative, by their hash, or the `data:` URI in their `href`. A tree of more than
/// `max_tiles` continues in further files, which the first references, with `tileset_query`:
/// siblings share a file as long as all below them fits. What references several has no content,
/// but the box and the geometric error of their parent.
///
/// The geometric error of a tile is the measure chosen by `options`, and no less than those of the
/// tiles below. By default that of a leaf is its spacing, and none is less than a step; with the
/// other measures none is less than a quarter of a step, by which rounding alone moves a point on
/// average. That of the whole is at least the diagonal of the box. Boxes contain the tile's points
/// and those of the tiles below, rotated by the transform of the root: on the globe they are
/// upright and fit as tightly as elsewhere. A tile's `extras` hold its error (mean, max, p99),
/// spacing, cover radius, points, bits and bytes; all but the bytes are also metadata of the class
/// `lod` of the schema in each file. The root has the transform from the tiles' coordinates to
/// those of the file, or to where `PyramidJob::transform` or `epsg` takes these.
/// @return no files if no level has tiles.
std::vector<TilesetFile> tileset_files(const Results& results, const TilesetOptions& options = {});

}  // namespace stipple::proto
