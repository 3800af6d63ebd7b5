#pragma once

#include "error/surface_probe.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <cstdint>
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
    /// @param surface  must outlive the watch. @param places  of the surface.
    /// @param off_surface  points that are none of its places, nor of a candidate that has them.
    /// @param margin  what is too far, as the distance between two places.
    /// @param reading  of the candidates.
    ErrorWatch(const ProbedSurface& surface, std::vector<Vec3f> places,
               std::vector<Vec3f> off_surface, double margin, Reading reading);

    /// Takes a candidate for the last one's. @param points  at least one.
    void look_at(std::vector<Vec3f> points, const RunContext& context);

    /// Looks again at the last candidate where its surface is uneven, at about so many places:
    /// walks to it end anywhere there, some of them far away.
    void look_again(std::uint64_t places, std::uint64_t seed, const RunContext& context);

    /// How many places were looked for so far.
    std::uint64_t looks() const noexcept { return looks_; }

    /// Of the last candidate, the farthest.
    double max() const noexcept;
    Vec3f farthest_place() const noexcept;
    /// Where its distance is above the margin: for each place or point the farthest around it.
    std::vector<Vec3f> places_too_far() const;

private:
    /// How closely was looked: at places around; at some more where it is uneven; at all there, and
    /// around what is suspicious.
    enum class Closeness : std::uint8_t { Around, Some, All };

    /// What is known around a place.
    struct Spot {
        Vec3f farthest = Vec3f::Zero();
        float distance = 0;
        float reach = 0;      ///< no point of a candidate farther away changes that
        bool uneven = false;  ///< whether the candidate's surface is uneven there
        Closeness looked = Closeness::Around;
    };

    std::vector<Index> touched(std::span<const Vec3f> centers, std::span<const Spot> spots,
                               std::span<const Vec3f> changed, const RunContext& context) const;
    void measure_from_surface(const ProbedSurface& candidate, std::span<const Index> which,
                              const RunContext& context);
    void measure_from_candidate(const ProbedSurface& candidate, std::span<const Index> which,
                                const RunContext& context);
    /// Places around others: how far off, in scales of the weights there, how many, which.
    struct Look {
        float spread;
        unsigned each;
        std::uint64_t seed;
    };
    /// Measures from places around `centers`, each of which belongs to the spot of `which`.
    /// @return of each center whether the surface that it is of is uneven around it.
    std::vector<std::uint8_t> look_around(const ProbedSurface& from, const ProbedSurface& to,
                                          std::span<const Index> which,
                                          std::span<const Vec3f> centers, std::vector<Spot>& spots,
                                          const Look& look, const RunContext& context);
    /// Looks closer, until something is too far, which is enough to go on with.
    void look_closer(const ProbedSurface& candidate, const RunContext& context);
    /// Where to look closer: so many places where it is uneven; and above this part of the margin.
    struct Care {
        unsigned uneven;
        double suspicious;
    };
    void look_closer(const ProbedSurface& from, const ProbedSurface& to, std::vector<Spot>& spots,
                     const Care& care, Closeness closeness, const RunContext& context);
    /// What the spots are around.
    std::span<const Vec3f> middles(const std::vector<Spot>& spots) const {
        return &spots == &forward_ ? places_ : points_;
    }

    const ProbedSurface& surface_;
    std::vector<Vec3f> off_surface_;  ///< sorted
    double margin_;
    Reading reading_;
    std::vector<Vec3f> places_, points_;    ///< of the surface; of the last candidate
    std::vector<Spot> forward_, backward_;  ///< one for each place, one for each point
    std::uint64_t looks_ = 0;
};

}  // namespace stipple
