#pragma once

#include "stipple/point_cloud.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace stipple::bench {

/// The surface that a scan came with, where it came with one. Never shown to a simplifier.
struct TriangleMesh {
    std::vector<Vec3d> vertices;
    std::vector<std::array<Index, 3>> triangles;

    bool empty() const noexcept { return triangles.empty(); }
};

/// How far two surfaces are apart, each figure divided by the diagonal of the original's box. S is
/// the surface of the original P, S' that of the simplified P'; both are MLS surfaces (§2.2) unless
/// "mesh" is said.
struct SurfaceDistance {
    double max = 0;  ///< Δmax (Eq. 9), the larger of both directions
    double mean =
        0;  ///< Δavg (Eq. 10), S to S': over the mesh where there is one, else as `mean_points`
    /// As `max`, of what is certain: without places of S' that have no normal (λ0 / λ1 of their
    /// neighbours is above 1/2), and no distance larger than that of a place beside and the way
    /// there, which tell of a nearer foot.
    double max_certain = 0;
    double p99 = 0;             ///< 99th percentile of the same distances
    double mean_quadratic = 0;  ///< as `mean`, with a quadratic polynomial over the plane
    double mean_points = 0;     ///< P to S', each point weighted by its area 1/ρ
    double back_mean = 0;       ///< P' to S
    double back_max = 0;        ///< S' to S, from dense samples of S'
    std::optional<double>
        surface_to_mesh;  ///< mean, S' to the triangles; no MLS of the original in it
    std::optional<double>
        points_to_mesh;            ///< mean, P' to the triangles: 0 for subsets, else shrinkage
    double spacing_variation = 0;  ///< deviation over mean of the nearest-neighbour distances in P'
    double least_spacing = 0;      ///< smallest over mean of them
    std::size_t not_converged =
        0;  ///< projections without a fixed point; their least step was used
};

struct SurfaceDistanceOptions {
    unsigned neighbors = 20;        ///< k of the MLS surface; h = r / 3
    std::size_t samples = 100'000;  ///< of S and of P at most, and of S' about
    std::uint64_t seed = 1;
    std::function<Vec3d(const Vec3d&)>
        foot{};            ///< the true surface's nearest point, where a formula gives it; the
                           ///< mesh only says where to look
    unsigned threads = 0;  ///< 0: one per hardware thread; the result does not depend on it
    unsigned starts = 0;   ///< of `measure_places`: not one walk, but the nearest place of S' that
                           ///< is found from all neighbours and so many random places. Slow
};

/// Distances of places of the original from S', in input units.
struct PlaceDistances {
    std::vector<Vec3d> places;             ///< points of P, drawn at random, or places of S by them
    std::vector<double> areas, distances;  ///< of each: of S around it, and to S'
};

/// The error measure of the paper's §4 against one original. Shares no code with the library that
/// it judges.
class SurfaceMeter {
public:
    /// Keeps a copy of the positions. @param mesh  in the unit of the input, origin added; may be
    /// empty.
    explicit SurfaceMeter(const PointCloud& original, const TriangleMesh& mesh = {},
                          const SurfaceDistanceOptions& options = {});
    ~SurfaceMeter();

    /// @param simplified  at least one point.
    SurfaceDistance measure(const PointCloud& simplified) const;

    /// What `mean_points` is the mean of.
    /// @param on_surface  from places of S all around the points: without what those are off it.
    PlaceDistances measure_places(const PointCloud& simplified, bool on_surface) const;

private:
    struct Original;
    std::unique_ptr<const Original> original_;
};

/// `SurfaceMeter` for a single comparison, without a mesh.
SurfaceDistance measure(const PointCloud& original, const PointCloud& simplified, unsigned threads);

}  // namespace stipple::bench
