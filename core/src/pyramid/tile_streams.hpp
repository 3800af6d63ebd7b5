#pragma once

#include "cloud/chain_order.hpp"
#include "pyramid/vertex_codec.hpp"
#include "stipple/lod_tiles.hpp"

#include <functional>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace stipple {

/// What all tiles of a pyramid have of their points, beside places and colours.
struct TileContents {
    bool normals = true;  ///< where the level has some
    bool attributes = false;
    /// By the names of attributes: what to take off 32-bit integers and doubles before they become
    /// floats, where these would tell few of them apart, since they lie much farther from zero than
    /// from each other: the whole number below the least.
    std::map<std::string, double, std::less<>> offsets{};

    TileContents() = default;
    /// Without normals if none has a direction.
    TileContents(const PointCloud& source, bool attributes);
};

/// The streams of a tile: the grid points at `POSITION`, and what `cloud` has for its points
/// `members`, which stand beside them. Normals take 8 bits for each axis of an octahedron, colours
/// are kept, integers of 32 bits and doubles become floats, less their offsets. Where an attribute
/// has more than four components each is a stream of its own.
std::vector<TileStream> encode_streams(const PointCloud& cloud, std::span<const Index> members,
                                       std::span<const GridPoint> points,
                                       const TileContents& contents, VertexEncoder& encoder);

}  // namespace stipple
