#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

namespace stipple {

/// What the first bytes of a Draco file say.
struct DracoHeader {
    bool mesh = false;
    std::string_view encoding;  ///< `sequential`, `kd-tree`, `edgebreaker`
    std::optional<std::uint64_t>
        declared_points;  ///< when it stands at the start: of edgebreaker meshes only the vertices
};

/// Reads the header, and the count behind the metadata, without Google's decoder: that one
/// allocates what a count asks for.
/// @throws Error(MalformedInput), Error(UnsupportedFormat).
DracoHeader parse_draco_header(std::span<const std::byte> file);

}  // namespace stipple
