#pragma once

#include "foot_finder.hpp"
#include "point_tree.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace stipple {

/// Places of one surface and how far they are from another.
struct Probes {
    std::vector<Vec3f> places;
    std::vector<float> distances;

    float max() const noexcept;
    /// Where the distance is above a bound.
    std::vector<Vec3f> places_above(double bound) const;
};

/// A surface as `measure_error` has it, with a linear basis, to look for where it is farthest from
/// another one.
class ProbedSurface {
public:
    /// @param points  at least one; of a size of about 1, where floats are at their best.
    ProbedSurface(std::vector<Vec3f> points, const RunContext& context);
    ProbedSurface(const ProbedSurface&) = delete;
    ProbedSurface& operator=(const ProbedSurface&) = delete;

    std::span<const Vec3f> points() const noexcept { return points_; }

    /// So many of its points, evenly drawn; all when there are no more.
    std::vector<Vec3f> some_points(std::uint64_t count, const RunContext& context) const;
    /// So many random places.
    std::vector<Vec3f> random_places(std::uint64_t count, const RunContext& context) const;

    /// Eight places of it around each of some: the feet of random ones within `reach` times the
    /// scale of the weights there, also off the surface, so that a sheet beside it is found.
    std::vector<Vec3f> places_around(std::span<const Vec3f> centers, float reach,
                                     std::uint64_t seed, const RunContext& context) const;

    Probes measure(std::vector<Vec3f> places, const ProbedSurface& other,
                   const RunContext& context) const;

    /// Adds places around those that are farther than `distance`: rounds of random ones, nearer and
    /// nearer to the worst found, so that a maximum is found that even samples would miss.
    void search_around(Probes& probes, const ProbedSurface& other, double distance,
                       const RunContext& context) const;

private:
    std::vector<Vec3f> points_;
    PointTree tree_;
    FootFinder finder_;
};

}  // namespace stipple
