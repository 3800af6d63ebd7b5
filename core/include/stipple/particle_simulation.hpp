#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <map>
#include <string>
#include <variant>
#include <vector>

namespace stipple {

/// A part of the surface where particles lie denser or thinner (Fig. 11).
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
    double density = 1;     ///< 1e-6..1e6: particles an area inside, as a multiple of that far outside;
                            ///< Fig. 11's radius of 10 % is a density of 100
    double transition = 0;  ///< >= 0, input units (units of the attribute): width of the passage
                            ///< around the region, in which the density changes smoothly; 0: half
                            ///< the radius, a quarter of the box's longest side or of high - low
};

struct ParticleSimulationOptions {
    std::uint64_t target_size = 0;  ///< N: exactly so many particles, 1..2^32 - 1; as many as the
                                    ///< input has, or more, is upsampling
    double adaptivity = 0;   ///< 0: uniform; up to 1: the repulsion radius is scaled by sigma_n to
                             ///< this power, inverted (1 is §3.3)
    double max_grading = 4;  ///< the largest repulsion radius over the smallest that `adaptivity`
                             ///< may lead to, >= 1
    std::vector<DensityRegion> regions{};  ///< where several overlap, their densities multiply
    unsigned max_iterations = 40;  ///< >= 1, of each stage: to rest, until none are too close, and
                                   ///< (a quarter as many, up to twice) that again on the
                                   ///< final surface
    double tolerance = 0.01;  ///< particles are at rest when their mean step, over their spacing,
                              ///< is shorter; above 0, below 1
    std::map<std::string, Reduction>
        reductions{};        ///< by attribute name, instead of the attribute's own
    std::uint64_t seed = 0;  ///< where the spreading begins; other seeds, other particles
};

/// Particle simulation (§3.3): particles are spread over the surface by its sampling density, repel
/// each other (Eq. 7 with p - p_i normalised, Eq. 8) on its tangent planes until they lie evenly,
/// and are projected onto its moving least squares surface (`MlsSurface`, degree 2), within the box
/// of the cloud but for a twentieth of the radius of 16 neighbours.
///
/// The result has exactly N points for every N, on the surface between and beside the input points:
/// nearest neighbours are about equally far apart (deviation over mean about 0.03, smallest over
/// mean about 0.9 for a uniform simulation of a scanned surface), however unevenly the input lies;
/// pairs stay closer where particles have no way to go: on stray points and in foliage. Upsampling
/// (N above the input's size) does the same, coarse to fine (§5.1). Attributes are taken from the
/// nearest input points by their policy (`Reduction`): averaged over as many as there are to a
/// particle, up to 16, or, for more than a quarter of the input's size, interpolated between the
/// four nearest. The order of the points follows a space-filling curve.
///
/// Upsampling a cloud of a few points is defined but says little: all particles of coincident
/// points coincide; those of two points, or of collinear ones, lie on the line; those of three lie
/// around them in their plane.
///
/// The cloud must hold finite positions, no two alike (`clean`).
/// @throws Error(InvalidArgument) for an empty cloud, an option out of range, or an attribute that
/// the cloud has not. O(n log n + N iterations), parallel, the same bytes for any number of
/// threads; beyond the clouds about 60 bytes an input point, 160 for each that stands for the
/// surface (at most 16 a particle for a uniform simulation, else all) and 250 a particle.
PointCloud particle_simulation(const PointCloud& cloud, const ParticleSimulationOptions& options,
                               const RunContext& context = {});

}  // namespace stipple
