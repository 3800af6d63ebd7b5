#pragma once

#include "stipple/codec.hpp"

namespace stipple {

/// `decode_cloud` for bytes that start with `DRACO`.
PointCloud decode_draco(std::span<const std::byte> file, const DecodeLimits& limits,
                        const RunContext& context, DecodeReport& report);

}  // namespace stipple
