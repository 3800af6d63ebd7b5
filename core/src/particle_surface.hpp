#pragma once

#include "stipple/neighbors.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

/// What particles move on: samples of a surface, each with its tangent plane (§3.3, Projection).
/// Particles beyond the border of the samples, or in a hole, are held back.
class ParticleSurface {
public:
    /// Where a particle stands.
    struct Foot {
        Index sample = 0;  ///< the nearest
        float slack = -1;  ///< so far the particle can go with the same sample nearest
    };

    /// @param normals  one for each sample, unit, sign any.
    /// @param border  how far from each a particle may be along its plane, input units.
    ParticleSurface(std::vector<Vec3f> samples, std::vector<Vec3f> normals,
                    std::vector<float> border, const RunContext& context)
        : search_(samples, context),
          samples_(std::move(samples)),
          normals_(std::move(normals)),
          border_(std::move(border)) {}

    /// `to` on the tangent plane of the sample nearest to it, for a particle that moves there from
    /// `from`, where its foot was `foot`.
    Vec3f project(const Vec3f& from, const Vec3f& to, Foot& foot) const noexcept;

    std::span<const Vec3f> samples() const noexcept { return samples_; }

private:
    NeighborSearch search_;
    std::vector<Vec3f> samples_, normals_;
    std::vector<float> border_;
};

}  // namespace stipple
