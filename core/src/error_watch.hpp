#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "surface_probe.hpp"

#include <span>
#include <vector>

namespace stipple {

/// How far a surface and those of candidates are apart, for candidates of which each is much like
/// the last: only where points have come or gone is measured anew.
///
/// From the surface: at given places of it. From the candidate: around each of its points, closer
/// where its surface is not even, for two sheets may run together there. Both ways also around the
/// places that are nearly too far.
class ErrorWatch {
public:
    /// @param places  of the surface. @param margin  what is too far, as the distance between two
    /// places.
    /// @param surface  must outlive the watch.
    ErrorWatch(const ProbedSurface& surface, std::vector<Vec3f> places, double margin);

    /// Takes a candidate for the last one's. @param points  at least one.
    void look_at(std::vector<Vec3f> points, const RunContext& context);

    /// Of the last candidate, the farthest.
    double max() const noexcept;
    /// Where its distance is above the margin: for each place or point the farthest around it.
    std::vector<Vec3f> places_too_far() const;

private:
    /// What is known around a place.
    struct Spot {
        Vec3f farthest = Vec3f::Zero();
        float distance = 0;
        float reach = 0;  ///< no point of a candidate farther away changes that
    };

    std::vector<Index> touched(std::span<const Vec3f> centers, std::span<const Spot> spots,
                               std::span<const Vec3f> changed, const RunContext& context) const;
    void measure_from_surface(const ProbedSurface& candidate, std::span<const Index> which,
                              const RunContext& context);
    void measure_from_candidate(const ProbedSurface& candidate, std::span<const Index> which,
                                const RunContext& context);
    void look_closer(const ProbedSurface& from, const ProbedSurface& to,
                     std::span<const Index> which, std::vector<Spot>& spots, double suspicious,
                     const RunContext& context) const;

    const ProbedSurface& surface_;
    double margin_;
    std::vector<Vec3f> places_, points_;    ///< of the surface; of the last candidate
    std::vector<Spot> forward_, backward_;  ///< one for each place, one for each point
};

}  // namespace stipple
