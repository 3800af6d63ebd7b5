#pragma once

#include "stipple/neighbors.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <vector>

namespace stipple {

/// Points that stand for a surface, and what is known of it there; one entry each.
struct SurfaceSamples {
    std::vector<Index> points;  ///< their numbers in the cloud
    std::vector<Vec3f> positions;
    std::vector<Vec3f> normals;    ///< unit, sign any
    std::vector<float> radii;      ///< of the enclosing sphere of the k nearest neighbours (§2)
    std::vector<float> areas;      ///< of the surface each stands for: 1 / rho, to scale; positive
    std::vector<float> variation;  ///< sigma_n

    std::size_t size() const noexcept { return points.size(); }
};

/// What particles move on: the tangent planes of samples (§3.3, Projection). Particles beyond the
/// border of the samples, or over a hole, are held back.
class ParticleSurface {
public:
    /// Where a particle stands.
    struct Foot {
        Index sample = 0;  ///< the nearest
        float slack = -1;  ///< so far the particle can go with the same sample nearest
    };

    /// @param samples  kept by reference.
    ParticleSurface(const SurfaceSamples& samples, const RunContext& context)
        : samples_(samples), search_(samples.positions, context) {}

    /// `to` on the tangent plane of the sample nearest to it, for a particle that moves there from
    /// `from`, where its foot was `foot`.
    Vec3f project(const Vec3f& from, const Vec3f& to, Foot& foot) const noexcept;

private:
    const SurfaceSamples& samples_;
    NeighborSearch search_;
};

}  // namespace stipple
