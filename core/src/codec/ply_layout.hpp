#pragma once

#include "codec/ply_header.hpp"
#include "stipple/codec.hpp"

#include <cstddef>
#include <span>
#include <vector>

namespace stipple {

/// What a property of a vertex means.
struct PlyRole {
    enum Kind { Position, Normal, Color, Attribute } kind = Attribute;
    unsigned component = 0;
};

/// What the header says of the points, and the file it is of.
struct PlyLayout {
    std::span<const std::byte> file;
    PlyHeader header;
    const PlyElement* vertex = nullptr;
    std::vector<PlyRole> roles;

    bool has(PlyRole::Kind kind, unsigned component = 0) const;
    /// Coordinates that a float does not hold, which are kept relative to an origin.
    bool wide_coordinates() const;
};

/// Reads the header of a PLY file. @throws Error(MalformedInput) where it is none, or has no
/// points.
PlyLayout ply_layout_of(std::span<const std::byte> file);

/// @throws Error(TooLarge) for more points or attributes than the limits allow, and
/// Error(MalformedInput) for a property whose name cannot be that of an attribute.
void check_against(const DecodeLimits& limits, const PlyLayout& layout);

/// What the header tells of the file, and what of it will not be read.
void describe(const PlyLayout& layout, DecodeReport& report);

}  // namespace stipple
