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

/// Writes a cloud as a Potree 2 folder (`metadata.json`, `hierarchy.bin`, `octree.bin`; encoding
/// DEFAULT): the additive octree of `SampledOctree`.
///
/// Positions become 32-bit integers on a grid of 2^-30 of the cube's side. Normals are written as
/// `NormalX`, `NormalY`, `NormalZ`, colours as `rgb` and `alpha`, every other attribute under its
/// name in its own type, with an underscore behind a name that loaders take for another column; an
/// attribute with several components becomes several. Coincident points are split no deeper than 21
/// levels. O(N log N); the same bytes for the same cloud.
///
/// @throws Error(InvalidArgument) for a cloud without points or options out of range,
/// Error(Internal) if the folder, which must exist, cannot be written to.
void write_potree(const PointCloud& cloud, const std::filesystem::path& folder,
                  const PotreeOptions& options = {}, const RunContext& context = {});

}  // namespace stipple::proto
