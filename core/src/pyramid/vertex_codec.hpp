#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace stipple {

/// Compresses vertices by version 0 of meshoptimizer's vertex codec (`EXT_meshopt_compression`,
/// mode ATTRIBUTES), for bytes that Brotli or gzip will pack once more: where packing bits saves
/// little, differences are left in whole bytes, which those count better. On the wire that is fewer
/// bytes than by meshoptimizer's own choice, which is the least before that.
///
/// Keeps its memory from one array to the next: one for each thread.
class VertexEncoder {
public:
    /// Writes the vertices begin..end, `stride` bytes each, to `vertices`: a few at a time.
    using Write = std::function<void(std::size_t begin, std::size_t end, std::byte* vertices)>;
    using Column = std::array<std::uint8_t, 256>;  ///< one byte of each vertex of a block

    /// @param count  at least 1.
    /// @param stride  a multiple of 4 and at most 256.
    /// @param write  called for all vertices in order, for each once.
    /// O(N), on the calling thread.
    std::vector<std::byte> encode(std::size_t count, std::size_t stride, const Write& write);

private:
    std::vector<std::byte> vertices_;   ///< of a block, after the last of the one before
    std::vector<Column> columns_;       ///< of a block
    std::vector<std::uint8_t> packed_;  ///< all blocks
};

/// Of vertices that lie side by side already.
std::vector<std::byte> encode_vertices(std::span<const std::byte> raw, std::size_t stride);

}  // namespace stipple
