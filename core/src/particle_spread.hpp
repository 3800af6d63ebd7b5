#pragma once

#include "surface_samples.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace stipple {

/// How many particles each sample is worth (§3.3, Spreading Particles and Adaptive Simulation): its
/// area 1 / rho over the square of the spacing wanted there. They add up to about `count`.
///
/// A point far from all others stands for no large surface: none is worth more than one particle,
/// or more than eight times the mean.
std::vector<float> particle_shares(std::span<const float> areas, std::span<const float> spacing,
                                   std::size_t count, const RunContext& context = {});

/// Particles near a surface, and the sample nearest to each.
struct SpreadParticles {
    std::vector<Vec3f> positions;
    std::vector<Index> samples;
};

/// `count` particles, so many at each sample as its share says.
SpreadParticles spread_particles(const SurfaceSamples& samples, std::span<const float> shares,
                                 std::size_t count, std::uint64_t seed, const RunContext& context);

}  // namespace stipple
