#pragma once

#include "stipple/lod_tiles.hpp"
#include "stipple/proto/results.hpp"

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace stipple::proto {

/// A tile as a binary glTF 2.0 file of points: `KHR_mesh_quantization`, `EXT_meshopt_compression`
/// and `KHR_materials_unlit`. glTF has y up, 3D Tiles turn it so that z is up: the matrix of the
/// node takes the grid to where the tile lies, and that turn back.
std::vector<std::byte> encode_glb(const LodTile& tile);

/// What `encode_glb` wrote: grid and streams, without level, error and spacing.
/// @throws Error(MalformedInput) for other bytes.
LodTile decode_glb(std::span<const std::byte> bytes);

/// One file of a tileset.
struct TilesetFile {
    std::string name;  ///< `tileset.json`, or `tileset-17.json` for what lies below tile 17
    std::string json;
};

/// The pyramid as a 3D Tiles 1.1 tileset: an explicit tree of the tiles of `results.levels`, with
/// REPLACE refinement, or ADD where its tiles are additive; the same while levels are still to
/// come. Addresses of tiles are relative, by their hash, or the `data:` URI that is their `href`. A
/// tree of more than `max_tiles` goes on in files of its own, which the first names.
///
/// The geometric error of a tile is the larger of its maximum error and its spacing, and no less
/// than those of the tiles below; that of a leaf is its spacing, and that of the whole the diagonal
/// of the box; none is less than a step. Boxes are those of the tile's points and of the tiles below, turned by the transform
/// of the root: on the globe they stand upright and fit as they do elsewhere. Error (mean, max, p99),
/// spacing, cover radius, points, bits and bytes of a tile stand in its `extras`. The root has the
/// transform from the tiles' coordinates to those of the file, or to where
/// `PyramidJob::transform` or `epsg` takes these.
/// @return none where no level has tiles.
std::vector<TilesetFile> tileset_files(const Results& results, std::size_t max_tiles = 5'000);

}  // namespace stipple::proto
