#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <map>
#include <string>
#include <variant>
#include <vector>

namespace stipple {

/// A part of space where particles lie denser or thinner (Fig. 11).
struct DensityRegion {
    struct Sphere {
        Vec3d center = Vec3d::Zero();
        double radius = 1;
    };  ///< relative to the origin of the cloud
    struct Box {
        Vec3d min = Vec3d::Zero();
        Vec3d max = Vec3d::Ones();
    };
    struct Scalar {
        std::string attribute;
        double low = 0;
        double high = 1;
    };  ///< where the value is within low..high
    std::variant<Sphere, Box, Scalar> where;
    double density = 1;     ///< > 0: points an area here, as a multiple of that elsewhere
    double transition = 0;  ///< input units (units of the attribute): width of the smooth passage
                            ///< around it; 0: chosen
};

struct ParticleSimulationOptions {
    std::uint64_t target_size =
        0;  ///< exactly so many particles, >= 1; more than the input has is upsampling
    double adaptivity =
        0;  ///< 0: uniform; 1: repulsion radius scaled by 1 / sigma_n (§3.3); in between: its power
    double max_grading =
        4;  ///< the largest repulsion radius over the smallest, >= 1, when adaptive
    std::vector<DensityRegion> regions{};
    unsigned max_iterations = 40;  ///< of a stage
    double tolerance =
        0.01;  ///< a stage ends when the mean step is below this part of the repulsion radius
    std::map<std::string, Reduction> reductions{};
    std::uint64_t seed = 0;
};

/// Particle simulation (§3.3): particles repel each other on the surface until they lie evenly.
PointCloud particle_simulation(const PointCloud& cloud, const ParticleSimulationOptions& options,
                               const RunContext& context = {});

}  // namespace stipple
