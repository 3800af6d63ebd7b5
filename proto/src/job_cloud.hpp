#pragma once

#include "stipple/cleaning.hpp"
#include "stipple/particle_simulation.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/proto/job_request.hpp"

#include <cstdint>
#include <optional>

namespace stipple::proto {

/// After cleaning. @param points  in the file. @param box  of what is left.
/// @throws Error(MalformedInput) for a cloud without points, or one of a size that single precision
/// has no squares for.
void require_usable(const PointCloud& cloud, std::uint64_t points, const CleaningReport& removed,
                    const Aabb& box);

/// What a job removes as outliers, if it does.
std::optional<OutlierOptions> outliers_of(const JobRequest& request);

bool wants_source_index(const JobRequest& request);
/// Numbers the points as they stand in the file.
void add_source_index(PointCloud& cloud);

/// A job's coordinates are those of the file, core's are relative to the origin of the cloud.
void to_frame_of(const PointCloud& cloud, ParticleSimulationOptions& options);

}  // namespace stipple::proto
