#pragma once

#include "codec/ply_columns.hpp"
#include "codec/ply_layout.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

namespace stipple {

// Decode what follows the header. @throws Error(MalformedInput) with the place that is wrong.

PointCloud decode_ascii_ply(const PlyLayout& layout, const RunContext& context,
                            DecodeReport& report);
PointCloud decode_binary_ply(const PlyLayout& layout, const RunContext& context,
                             DecodeReport& report);

}  // namespace stipple
