#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <filesystem>
#include <string>

namespace stipple::proto {

struct PotreeOptions {
    std::string name = "stipple";
    unsigned grid = 128;  ///< 2..1024: an inner node keeps one point for each cell that it cuts its
                          ///< cube into along each axis
    std::uint32_t max_points = 20'000;  ///< of a leaf, >= 1
};

/// Writes a cloud as a folder of Potree 2 (`metadata.json`, `hierarchy.bin`, `octree.bin`; encoding
/// DEFAULT): an additive octree, in which every point stands in one node, and the nodes down to any
/// depth are an even subset. A node with more than `max_points` below it keeps the point of each
/// cell of its grid that is nearest to the middle of the cell; the rest goes to its children.
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
