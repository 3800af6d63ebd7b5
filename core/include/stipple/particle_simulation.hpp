#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <map>
#include <string>
#include <variant>
#include <vector>

namespace stipple {

/// A part of the surface where particles are denser or sparser (Fig. 11).
struct DensityRegion {
    /// Positions are relative to the origin of the cloud, in input units.
    struct Sphere {
        Vec3d center = Vec3d::Zero();
        double radius = 1;  ///< > 0
    };
    struct Box {
        Vec3d min = Vec3d::Zero();
        Vec3d max = Vec3d::Ones();  ///< at least min
    };
    /// Where the value of an attribute of one component is within low..high.
    struct Scalar {
        std::string attribute;
        double low = 0;
        double high = 1;  ///< at least low
    };
    std::variant<Sphere, Box, Scalar> where;
    double density = 1;  ///< 1e-6..1e6: particles per area inside, as a multiple of that far
                         ///< outside; Fig. 11's radius of 10 % is a density of 100
    double transition =
        0;  ///< >= 0, input units (units of the attribute): width of the transition zone around the
            ///< region, in which the density changes smoothly; 0: half the radius, a quarter of the
            ///< box's longest side or of high - low
};

struct ParticleSimulationOptions {
    std::uint64_t target_size = 0;  ///< N: exactly this many particles, 1..2^32 - 1; as many as the
                                    ///< input has, or more, is upsampling
    double adaptivity = 0;   ///< 0: uniform; up to 1: the repulsion radius is divided by sigma_n to
                             ///< this power (1 is §3.3)
    double max_grading = 4;  ///< largest ratio of repulsion radii that `adaptivity` may cause, >= 1
    std::vector<DensityRegion> regions{};  ///< densities of overlapping regions multiply
    unsigned max_iterations =
        40;  ///< >= 1, in each stage: until convergence, until none are too close, and (a quarter
             ///< as many, up to twice) again on the final surface
    double tolerance = 0.01;  ///< particles have converged when their mean step is below this
                              ///< fraction of their spacing; in (0, 1)
    std::map<std::string, Reduction>
        reductions{};        ///< by attribute name, overriding the attribute's own
    std::uint64_t seed = 0;  ///< where the spreading begins; other seeds give other particles
};

/// Particle simulation (§3.3): particles are spread over the surface by its sampling density, repel
/// each other (Eq. 7 with p - p_i normalised, Eq. 8) on its tangent planes until they are evenly
/// spaced, and are projected onto its moving least squares surface (`MlsSurface`, degree 2), within
/// the box of the cloud enlarged by a twentieth of the radius of 16 neighbours.
///
/// The result has exactly N points for every N, on the surface between and beside the input points.
/// Nearest neighbours are about equally far apart (deviation over mean about 0.03, smallest over
/// mean about 0.9 for a uniform simulation of a scanned surface), however unevenly the input lies;
/// pairs stay closer where particles cannot escape: on stray points and in foliage. Upsampling (N
/// above the input's size) does the same, coarse to fine (§5.1). Attributes are taken from the
/// nearest input points by their policy (`Reduction`): averaged over as many as there are per
/// particle, up to 16, or, for more than a quarter of the input's size, interpolated between the
/// four nearest. The points follow a space-filling curve.
///
/// Upsampling a cloud of a few points is defined but not useful: all particles of coincident points
/// coincide; those of two points, or of collinear ones, lie on the line; those of three lie around
/// them in their plane.
///
/// The cloud must hold finite, distinct positions (`clean`).
/// @throws Error(InvalidArgument) for an empty cloud, an option out of range, or an attribute that
/// the cloud does not have.
///
/// O(n log n + N iterations), parallel, the same bytes for any number of threads. Beyond the clouds
/// about 60 bytes per input point, 160 for each that represents the surface (at most 16 per
/// particle for a uniform simulation, otherwise all) and 260 per particle.
PointCloud particle_simulation(const PointCloud& cloud, const ParticleSimulationOptions& options,
                               const RunContext& context = {});

}  // namespace stipple
