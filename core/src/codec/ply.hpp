#pragma once

#include "stipple/codec.hpp"

namespace stipple {

/// `decode_cloud` for bytes that start with `ply`.
PointCloud decode_ply(std::span<const std::byte> file, const DecodeLimits& limits,
                      const RunContext& context, DecodeReport& report);

/// What `check_head` promises for bytes that start with `ply`.
void check_ply_head(std::span<const std::byte> head, std::uint64_t file_bytes,
                    const DecodeLimits& limits);

}  // namespace stipple
