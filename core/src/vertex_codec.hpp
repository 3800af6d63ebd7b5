#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace stipple {

/// Compresses vertices by version 0 of meshoptimizer's vertex codec (`EXT_meshopt_compression`,
/// mode ATTRIBUTES), for bytes that Brotli or gzip will pack once more: where packing bits saves
/// little, differences are left in whole bytes, which those count better. On the wire that is fewer
/// bytes than by meshoptimizer's own choice, which is the least before that.
///
/// @param raw  `stride` bytes for each vertex, a multiple of 4 and at most 256; at least one.
/// O(N), on the calling thread.
std::vector<std::byte> encode_vertices(std::span<const std::byte> raw, std::size_t stride);

}  // namespace stipple
