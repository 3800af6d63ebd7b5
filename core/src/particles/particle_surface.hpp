#pragma once

#include "neighbors/point_tree.hpp"
#include "particles/surface_samples.hpp"
#include "stipple/mls.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

namespace stipple {

/// What particles move on (§3.3, Projection): the tangent planes of samples, and at the end the
/// moving least squares surface of the cloud.
class ParticleSurface {
public:
    /// Where a particle stands.
    struct Foot {
        Index sample = 0;   ///< about the nearest, or so on the same sheet of the surface
        float slack = 0;    ///< so far the particle can go with the same sample
        float unasked = 0;  ///< so far, where it is held back, before all samples are asked again
    };

    /// @param samples  along a curve, kept by reference, as is `mls`, the surface outside of the
    /// frame.
    ParticleSurface(const SurfaceSamples& samples, const MlsSurface& mls,
                    const ParticleFrame& frame, const RunContext& context)
        : samples_(samples),
          mls_(mls),
          frame_(frame),
          tree_(samples.positions, PointTree::Leaves::Given, context) {}

    const Vec3f& normal(Index sample) const noexcept { return samples_.planes[sample].normal; }

    /// The sample nearest to p.
    Index nearest(const Vec3f& p) const noexcept;

    /// `to` on the tangent plane of the sample nearest to it, for a particle that moves there from
    /// `from`, where its foot was `foot`. Beyond the border of the samples, or over a hole, it is
    /// held back.
    Vec3f project(const Vec3f& from, const Vec3f& to, Foot& foot) const noexcept;

    /// Asks the memory for what `project` reads of the sample, before it is needed.
    void fetch(const Foot& foot) const noexcept {
        __builtin_prefetch(&samples_.planes[foot.sample]);
        __builtin_prefetch(&samples_.positions[foot.sample]);
        __builtin_prefetch(samples_.neighbors_of(foot.sample).data());
    }
    /// The same of the sample's neighbours, for a particle that may walk; some time after `fetch`.
    void fetch_neighbors(const Foot& foot) const noexcept {
        for (const Index j : samples_.neighbors_of(foot.sample))
            __builtin_prefetch(&samples_.positions[j]);
    }

    /// Psi(P, p) for a particle that `project` gave. Where that is far, since the points carry no
    /// surface there, it stays. Hardly outside the box of the cloud: where points fill a volume,
    /// the planes and surfaces through them lead out of it.
    /// @param spacing  of the particles there.
    Vec3f settle(const Vec3f& p, const Foot& foot, float spacing) const;

private:
    struct Projection {
        Vec3f point;
        bool held_back;
    };

    Neighbor nearest_neighbor(const Vec3f& p, Index sample) const noexcept;
    void walk(const Vec3f& p, Foot& foot) const noexcept;
    Projection onto_plane(const Vec3f& p, Index sample) const noexcept;

    const SurfaceSamples& samples_;
    const MlsSurface& mls_;
    ParticleFrame frame_;
    PointTree tree_;
};

}  // namespace stipple
