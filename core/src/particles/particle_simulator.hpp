#pragma once

#include "stipple/particle_simulation.hpp"

#include <cstdint>
#include <memory>

namespace stipple {

/// The ranges of the options, but for the target, that hold whatever the cloud.
/// @throws Error(InvalidArgument).
void check_ranges(const ParticleSimulationOptions& options);

/// Particle simulations of one cloud, each of as many particles as it is asked for. What they have
/// in common is made once: the order of the points, their moving least squares surface, and, where
/// a run needs as many of them as the one before, or both nearly all, the samples that stand for
/// it.
class ParticleSimulator {
public:
    /// @param options  whose `target_size` is not read.
    /// @throws Error(InvalidArgument) as `particle_simulation`. Both stay and do not change.
    ParticleSimulator(const PointCloud& cloud, const ParticleSimulationOptions& options,
                      const RunContext& context);
    ~ParticleSimulator();
    ParticleSimulator(const ParticleSimulator&) = delete;
    ParticleSimulator& operator=(const ParticleSimulator&) = delete;

    /// The cloud that `particle_simulation` makes of `particles`.
    /// @throws Error(InvalidArgument) for none, or 2^32 and more.
    PointCloud run(std::uint64_t particles, const RunContext& context);

private:
    struct Implementation;
    std::unique_ptr<Implementation> implementation_;
};

}  // namespace stipple
