#pragma once

#include "stipple/neighbors.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <span>
#include <vector>

namespace stipple {

/// A cloud moved and scaled to about -1..1, but for a few points far off, where floats resolve
/// small moves and hold squares.
struct ParticleFrame {
    Vec3d center;
    double scale;     ///< input units, a power of two; 0 when all points coincide
    Vec3f low, high;  ///< the box of the points, inside the frame

    explicit ParticleFrame(std::span<const Vec3f> points);
    Vec3f inside(const Vec3d& p) const { return ((p - center) / scale).cast<float>(); }
    Vec3d outside(const Vec3f& p) const { return p.cast<double>() * scale + center; }
};

/// The surface around a sample, together since particles look at all of it.
struct TangentPlane {
    Vec3f normal;      ///< unit, sign any
    Vec3f outward;     ///< away from the mean of the neighbours, unit or 0
    float outer = 0;   ///< how far the surface goes on in that direction, at least; 0 where the
                       ///< neighbours lie on one side, as at a border
    float radius = 0;  ///< of the enclosing sphere of the k nearest neighbours (§2)

    /// Of the surface that the sample stands for: 1 / rho, to scale; positive.
    float area() const noexcept;
    /// How far from it along the plane its surface reaches, in directions that go on.
    float border() const noexcept;
};

inline constexpr unsigned kSampleNeighbors = 16;

/// Points that stand for a surface, and what is known of it there; one entry each, lengths in the
/// units of the frame.
struct SurfaceSamples {
    std::vector<Index> points;  ///< their numbers in the cloud
    std::vector<Vec3f> positions;
    std::vector<TangentPlane> planes;
    std::vector<Index> neighbors;  ///< of each the `neighbor_count` nearest, 16 at most
    std::size_t neighbor_count = 0;
    std::vector<float> variation;  ///< sigma_n

    std::size_t size() const noexcept { return points.size(); }
    std::span<const Index> neighbors_of(std::size_t i) const noexcept {
        return {neighbors.data() + i * neighbor_count, neighbor_count};
    }
};

/// Analyses the `points` of a cloud, among themselves: neighbourhoods of 16, normals by Eq. 4,
/// variation by Eq. 5.
SurfaceSamples sample_surface(const PointCloud& cloud, std::vector<Index> points,
                              const ParticleFrame& frame, const RunContext& context);

}  // namespace stipple
