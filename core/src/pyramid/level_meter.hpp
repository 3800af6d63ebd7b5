#pragma once

#include "analysis/lone_points.hpp"
#include "error/error_frame.hpp"
#include "error/framed_surface.hpp"
#include "error/sample_rounds.hpp"
#include "neighbors/point_tree.hpp"
#include "stipple/lod_tiles.hpp"
#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/surface_error.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace stipple {

/// Whether most points, in the order of a curve, have another one at their place.
template <typename PointAt>
bool is_crowd(std::size_t count, PointAt&& point_at) {
    std::size_t places = 0;
    for (std::size_t i = 0; i < count; ++i)
        places += i == 0 || point_at(i) != point_at(i - 1) ? 1 : 0;
    return 2 * places < count;
}

/// Points of a level, in the order of a curve, and how far the source is from their surface.
struct MeasuredLevel {
    std::vector<Vec3f> points;
    std::vector<Vec3f> apart;  ///< one for each place, where most have others at theirs; else none
    std::unique_ptr<PointTree> tree;  ///< of those, or of all
    std::vector<Index>
        places;  ///< numbers of those where it is measured, as `SampleRounds` has them
    std::vector<float> distances;       ///< of each
    std::vector<float> covers;          ///< from each to the nearest point
    std::vector<float> areas;           ///< that each stands for
    std::vector<std::uint8_t> endless;  ///< whether no walk from there came to an end
    double mean = 0;

    std::span<const Vec3f> samples() const noexcept { return apart.empty() ? points : apart; }

    MeasuredLevel() = default;
    MeasuredLevel(std::vector<Vec3f>&& points, const RunContext& context);
};

/// Measures how far the surface of a source is from those of its levels (§4), at places that all
/// of them share.
class LevelMeter {
public:
    LevelMeter() = default;
    /// @param source  in the order of a curve.
    LevelMeter(std::vector<Vec3f>&& source, LodErrors errors, const RunContext& context);

    /// The source's points, in their order.
    const std::vector<Vec3f>& source() const noexcept {
        return surface_ ? surface_->points : points_;
    }
    /// Their surface: made where it is not there, and kept.
    std::shared_ptr<const FramedSurface> surface(const RunContext& context);
    /// Gives back what the surface takes beside its points.
    void forget_surface();
    /// The middle one of the source's gaps.
    double spacing() const noexcept { return spacing_; }
    /// Of `measure_well`.
    const ErrorSamples& places() const noexcept { return (is_exact() ? every_ : places_).all(); }

    /// Well enough to turn down a rounding of points.
    void glance(MeasuredLevel& level, const RunContext& context) const;
    /// What it would say of a level that is measured at more places.
    double mean_at_a_glance(const MeasuredLevel& level) const;

    /// At 4,096 places, or 2,048 where errors are rough: well enough to compare two roundings of
    /// the same points.
    void measure_at_some(MeasuredLevel& level, const RunContext& context) const;

    /// As well as errors are to be known. Sure ones at one place for 128 points at least, and at
    /// more while chance would decide: of as many rounds as the spread of those that there are
    /// calls for.
    void measure_well(MeasuredLevel& level, const RunContext& context);

    /// What was measured last, and the way back, by few samples: all but the diagonals.
    SurfaceError error_of(const MeasuredLevel& level, const ErrorFrame& frame,
                          const RunContext& context);

private:
    bool is_exact() const noexcept { return errors_ == LodErrors::Exact; }
    static void measure(MeasuredLevel& level, const SampleRounds& places, unsigned rounds,
                        const RunContext& context);
    /// Of the surface, which is made where it is not there.
    const LonePoints& lone_points(const RunContext& context);
    void draw(unsigned rounds, const RunContext& context);
    void need_places(unsigned rounds, const RunContext& context);
    unsigned most_rounds() const noexcept;
    unsigned least_rounds(std::uint64_t points) const;

    std::vector<Vec3f> points_;  ///< where there is no surface that has them
    std::shared_ptr<FramedSurface> surface_;
    std::unique_ptr<const LonePoints> lone_points_;  ///< of the surface, while it is there
    LodErrors errors_ = LodErrors::Sure;
    double spacing_ = 0;
    SampleRounds places_;
    SampleRounds every_;    ///< one round of all points, where it is to be exact
    unsigned weighed_ = 0;  ///< rounds of places whose areas are known: what takes the time
};

}  // namespace stipple
