#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/sampled_octree.hpp"

#include <cstdint>
#include <filesystem>
#include <string>

namespace stipple::proto {

struct PotreeOptions {
    std::string name = "stipple";
    SampledOctreeOptions octree{};
};

/// Writes a cloud as a folder of Potree 2 (`metadata.json`, `hierarchy.bin`, `octree.bin`; encoding
/// DEFAULT): the additive octree of `SampledOctree`.
///
/// Positions become 32-bit integers on a grid of 2^-30 of the cube's side. Normals are written as
/// `NormalX`, `NormalY`, `NormalZ`, colours as `rgb`, every other attribute under its name in its
/// own type, one with several components as several. Points that coincide are cut no further than
/// 21 levels deep. O(N log N); the same bytes for the same cloud.
///
/// @throws Error(InvalidArgument) for a cloud without points or options out of range,
/// Error(Internal) when the folder, which exists, cannot be written to.
void write_potree(const PointCloud& cloud, const std::filesystem::path& folder,
                  const PotreeOptions& options = {}, const RunContext& context = {});

}  // namespace stipple::proto
