#pragma once

#include "stipple/codec.hpp"

namespace stipple {

/// `decode_cloud` for bytes that start with `ply`.
PointCloud decode_ply(std::span<const std::byte> file, const DecodeLimits& limits,
                      const RunContext& context, DecodeReport& report);

}  // namespace stipple
