#pragma once

#include "analysis/lone_points.hpp"
#include "error/foot_finder.hpp"
#include "neighbors/point_tree.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace stipple {

/// Places of one surface and how far they are from another.
struct Probes {
    std::vector<Vec3f> places;
    std::vector<float> distances;  ///< to the other, also beyond its border, where planes go on
    std::vector<float> reach;  ///< no point of the other farther from a place changes its distance
    std::vector<std::uint8_t> uneven;  ///< whether the other has no even piece of surface there

    float max() const noexcept;
    Vec3f farthest() const noexcept;  ///< where that is
    /// Where the distance is above a bound.
    std::vector<Vec3f> places_above(double bound) const;
};

/// Places of a surface around some others, the centers.
struct PlacesAround {
    std::vector<Vec3f> places;
    std::vector<Index> centers;  ///< of each place the number of its center; ascending
    std::vector<float> reach;    ///< of each center: no point farther from it changes its places
    std::vector<std::uint8_t> uneven;  ///< of each center: whether the surface around it turns by
                                       ///< more than 40 degrees or is not found everywhere
};

/// How a measurement is read.
enum class Reading : std::uint8_t {
    Confirmed,  ///< places on the surface alone, and large distances confirmed (worst_samples.hpp)
    ByTheLetter,  ///< whatever walks come to rest at, also in knots of samples, which have no
                  ///< normal, and what they find from there: as one measures who looks no further
};

/// A surface as `measure_error` has it, with a linear basis, to look for where it is farthest from
/// another one.
class ProbedSurface {
public:
    /// @param points  at least one; of a size of about 1, where floats are at their best.
    ProbedSurface(std::vector<Vec3f> points, Reading reading, const RunContext& context);
    ProbedSurface(const ProbedSurface&) = delete;
    ProbedSurface& operator=(const ProbedSurface&) = delete;

    /// So many of its points, evenly drawn; all when there are no more.
    std::vector<Vec3f> some_points(std::uint64_t count, const RunContext& context) const;
    /// So many random places.
    std::vector<Vec3f> random_places(std::uint64_t count, const RunContext& context) const;

    /// `each` places around each center: the feet of random ones within `spread` times the scale of
    /// the weights there, also off the surface, so that a sheet beside it is found; the center
    /// itself for those that have none or one beyond the border of the surface, and where it is a
    /// point that lies alone. They depend on where the center is and on the seed, not on the other
    /// centers.
    PlacesAround places_around(std::span<const Vec3f> centers, float spread, unsigned each,
                               std::uint64_t seed, const RunContext& context) const;

    /// @param doubtful  distances above it are confirmed where they are few, unless one of the two
    ///                  surfaces is read by the letter.
    Probes measure(std::vector<Vec3f> places, const ProbedSurface& other, double doubtful,
                   const RunContext& context) const;

    /// How far its nearest point is.
    float to_point(const Vec3f& place) const;

private:
    /// Whether a foot lies beside all points on one side, farther off than any place is drawn by
    /// who measures: planes go on there, the surface does not.
    bool is_beyond_border(const Foot& foot) const;

    std::vector<Vec3f> points_;
    Reading reading_;
    PointTree tree_;
    FootFinder finder_;
    LonePoints lone_points_;
};

}  // namespace stipple
