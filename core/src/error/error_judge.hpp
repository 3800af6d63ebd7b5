#pragma once

#include "error/error_frame.hpp"
#include "error/error_watch.hpp"
#include "error/surface_probe.hpp"
#include "stipple/error_bounded.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"

#include <optional>
#include <span>
#include <vector>

namespace stipple {

/// Judges candidates for one cloud and a bound, from a glance to what anyone would measure. Lengths
/// and places are those of the cloud.
class ErrorJudge {
public:
    /// @param cloud  of a diagonal that is not 0; must outlive the judge.
    ErrorJudge(const PointCloud& cloud, double bound, const RunContext& context);

    /// What is found of a candidate.
    struct Finding {
        std::vector<Vec3f> places;  ///< that are not safely within the bound
        double share = 0;           ///< of the places looked at
        double max = 0;             ///< over the bound
    };

    /// Whether nearly all points of the cloud are safely within the bound of its own surface: else
    /// that is not known well enough to tell. The few that are not are no places of it.
    bool can_be_kept() const noexcept { return can_be_kept(points_.size()); }
    /// How many are not.
    std::uint64_t points_off_surface() const noexcept { return off_surface_.size(); }

    /// How candidates are read from now on, but for glances; `Confirmed` before.
    void read(Reading reading);

    /// From few samples, to learn where snapshots are too coarse.
    Finding glance(const PointCloud& candidate);

    /// From all points and much between: quick for a candidate that is much like the last.
    Finding watch(const PointCloud& candidate);

    /// From now on what holds is measured again at other and more places, and where it is not read
    /// by the letter most of all where the surface of the candidate is uneven: what is far there
    /// may be so in few places, which the letter would follow without end.
    void take_care() noexcept { careful_ = true; }

    /// As anyone would measure it, and then closer where distances are large; if it is read by the
    /// letter or with care, again at other and more places. Keeps the first measurement.
    /// @param candidate  the one watched last.
    Finding measure(ErrorBoundedCloud& candidate);

    /// The parts of the bound that a glance or a watch calls safe.
    static constexpr double kMargin = 0.95;
    static constexpr double kWithin = 0.97;  ///< of the bound, when measured at the end

    unsigned tries() const noexcept { return tries_; }

    /// Whether so many places were looked at that a search should end with what it has. A count,
    /// not a time: it is the same on every machine.
    bool is_spent() const noexcept;

    /// Of the candidates that were farther than the bound that with most points, and where it was
    /// farthest; where nothing can be kept the cloud itself.
    const std::optional<TooFar>& too_far() const noexcept { return too_far_; }

private:
    /// Finds out which points are of the surface and which are not.
    void part_points();
    bool can_be_kept(std::size_t points_of_surface) const noexcept;
    /// @param place, distance  as in the frame of the surfaces.
    void remember(std::uint64_t points, const Vec3f& place, double distance);
    Finding found_by_watch() const;
    /// As one measures who sets no options, with a few seeds. Adds to what was found.
    void measure_as_usual(const PointCloud& candidate, Finding& finding);
    /// Whether a place of the cloud is one of its points that are not of its surface.
    bool is_off_surface(const Vec3f& place) const;
    /// At so many places, and closer where distances are large. Keeps the figures.
    Finding measured(ErrorBoundedCloud& candidate, std::uint64_t samples, std::uint64_t seed);
    /// Points of a candidate may lie off its own surface, where no place is looked for. They are
    /// too far where they are so from the surface of the cloud and from all of its points.
    void look_at_points(const PointCloud& candidate, Finding& finding);
    /// At many places around raised ones; adds to what was found.
    void look_closer(const ProbedSurface& from, std::span<const Vec3f> raised,
                     const ProbedSurface& other, Finding& finding) const;
    /// Places of the frame as positions of the cloud.
    std::vector<Vec3f> out_of_frame(std::span<const Vec3f> places) const;
    /// What is nearly too far, in the frame.
    double margin() const noexcept { return kMargin * bound_ * frame_.scale; }

    const PointCloud& cloud_;
    double bound_;
    RunContext quietly_;
    ErrorFrame frame_;
    ProbedSurface surface_;
    std::optional<TooFar> too_far_;
    std::vector<Vec3f> points_;       ///< of the cloud that are of its surface
    std::vector<Vec3f> off_surface_;  ///< and those that are not
    std::vector<Vec3f> some_points_;  ///< of the first, for glances
    Reading reading_ = Reading::Confirmed;
    bool careful_ = false;
    std::optional<ErrorWatch> watch_;
    std::optional<SurfaceErrorMeter> meter_;
    std::optional<SurfaceErrorMeter> usual_meter_;
    unsigned tries_ = 0;
    std::uint64_t looks_ = 0;  ///< but for those of the watch that is
};

}  // namespace stipple
