#pragma once

#include "particles/surface_samples.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace stipple {

/// How many particles each sample is worth (§3.3, Spreading Particles and Adaptive Simulation): its
/// area 1 / rho over the square of the spacing wanted there. They add up to about `count`.
///
/// Samples that lie all around stand for no surface as large as they are far apart: where `rough`
/// is not 0, a sample is worth four times the mean at most.
std::vector<float> particle_shares(std::span<const float> areas, std::span<const float> spacing,
                                   std::span<const std::uint8_t> rough, std::size_t count,
                                   const RunContext& context = {});

/// Areas of samples, none much larger than those of its neighbours: a point far from all others
/// stands for no large surface.
std::vector<float> sample_areas(const SurfaceSamples& samples, const RunContext& context);

/// Whether each sample has neighbours that lie about no plane.
std::vector<std::uint8_t> rough_samples(const SurfaceSamples& samples, const RunContext& context);

/// Particles near a surface, and the sample nearest to each.
struct SpreadParticles {
    std::vector<Vec3f> positions;
    std::vector<Index> samples;
};

/// `count` particles, so many at each sample as its share says.
SpreadParticles spread_particles(const SurfaceSamples& samples, std::span<const float> shares,
                                 std::size_t count, std::uint64_t seed, const RunContext& context);

}  // namespace stipple
