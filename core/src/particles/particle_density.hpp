#pragma once

#include "particles/surface_samples.hpp"
#include "stipple/particle_simulation.hpp"

#include <span>
#include <vector>

namespace stipple {

/// @throws Error(InvalidArgument) for a region out of range.
void check_ranges(const std::vector<DensityRegion>& regions);
/// @throws Error(InvalidArgument) for an attribute that the cloud has not, or of several
/// components.
void check_attributes(const std::vector<DensityRegion>& regions, const PointCloud& cloud);

/// By how much regions scale the repulsion radius at point i of the cloud: density^(-1/2) inside,
/// 1 far away, and between them a smooth step of its logarithm (Fig. 11).
float region_spacing(const std::vector<DensityRegion>& regions, const PointCloud& cloud, Index i);

/// By how much the surface variation sigma_n of each sample scales the repulsion radius there
/// (§3.3, Adaptive Simulation): (mean / sigma_n)^adaptivity, between 1 / sqrt(max_grading) and its
/// inverse, smoothed over neighbours.
/// @param areas  of the surface that each sample stands for, any unit.
std::vector<float> adaptive_spacing(const SurfaceSamples& samples, std::span<const float> areas,
                                    double adaptivity, double max_grading,
                                    const RunContext& context);

}  // namespace stipple
