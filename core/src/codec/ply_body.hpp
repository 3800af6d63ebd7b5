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

/// Where more is than the header declares, for the report. If other elements follow the vertices,
/// of which kind it is cannot be told: it may be points.
constexpr const char* surplus_place(bool after_vertices) noexcept {
    return after_vertices ? " after the last vertex" : " beyond all that the header declares";
}

}  // namespace stipple
