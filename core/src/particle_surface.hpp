#pragma once

#include "stipple/mls.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <vector>

namespace stipple {

/// A cloud moved and scaled to about -1..1, where floats resolve small moves and hold squares.
struct ParticleFrame {
    Vec3d center;
    double scale;  ///< input units, a power of two; 0 when all points coincide

    explicit ParticleFrame(std::span<const Vec3f> points);
    Vec3f inside(const Vec3f& p) const {
        return ((p.cast<double>() - center) / scale).cast<float>();
    }
    Vec3d outside(const Vec3f& p) const { return p.cast<double>() * scale + center; }
};

/// Points that stand for a surface, and what is known of it there; one entry each, lengths
/// in the units of the frame.
struct SurfaceSamples {
    std::vector<Index> points;  ///< their numbers in the cloud
    std::vector<Vec3f> positions;
    std::vector<Vec3f> normals;    ///< unit, sign any
    std::vector<float> radii;      ///< of the enclosing sphere of the k nearest neighbours (§2)
    std::vector<float> areas;      ///< of the surface each stands for: 1 / rho, to scale; positive
    std::vector<float> variation;  ///< sigma_n

    std::size_t size() const noexcept { return points.size(); }
};

/// What particles move on (§3.3, Projection): the tangent planes of samples, and at the end the
/// moving least squares surface of the cloud.
class ParticleSurface {
public:
    /// Where a particle stands.
    struct Foot {
        Index sample = 0;  ///< the nearest
        float slack = -1;  ///< so far the particle can go with the same sample nearest
    };

    /// @param samples  kept by reference, as is `mls`, the surface outside of the frame.
    ParticleSurface(const SurfaceSamples& samples, const MlsSurface& mls,
                    const ParticleFrame& frame, const RunContext& context)
        : samples_(samples), mls_(mls), frame_(frame), search_(samples.positions, context) {}

    /// `to` on the tangent plane of the sample nearest to it, for a particle that moves there from
    /// `from`, where its foot was `foot`. Beyond the border of the samples, or over a hole, it is
    /// held back.
    Vec3f project(const Vec3f& from, const Vec3f& to, Foot& foot) const noexcept;

    /// Psi(P, p) for a particle that `project` gave. Where that is far, since the points carry no
    /// surface there, it stays.
    /// @param spacing  of the particles there.
    Vec3f settle(const Vec3f& p, const Foot& foot, float spacing) const;

private:
    const SurfaceSamples& samples_;
    const MlsSurface& mls_;
    ParticleFrame frame_;
    NeighborSearch search_;
};

}  // namespace stipple
