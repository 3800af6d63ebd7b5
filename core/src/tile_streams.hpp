#pragma once

#include "chain_order.hpp"
#include "stipple/lod_tiles.hpp"
#include "vertex_codec.hpp"

#include <span>
#include <vector>

namespace stipple {

/// The streams of a tile: the grid points at `POSITION`, and what `cloud` has for its points
/// `members`, which stand beside them. Normals take 8 bits for each axis of an octahedron, colours
/// are kept, integers of 32 bits and doubles become floats. Where an attribute has more than four
/// components each is a stream of its own.
std::vector<TileStream> encode_streams(const PointCloud& cloud, std::span<const Index> members,
                                       std::span<const GridPoint> points, bool attributes,
                                       VertexEncoder& encoder);

}  // namespace stipple
