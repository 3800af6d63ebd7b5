#pragma once

#include "cloud/boxed_cloud.hpp"
#include "error/error_frame.hpp"
#include "error/foot_finder.hpp"
#include "error/framed_surface.hpp"
#include "neighbors/balls.hpp"
#include "stipple/run_context.hpp"

#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <vector>

namespace stipple {

/// A cloud's surface for a few queries, known beforehand: one pass over the cloud gathers what lies
/// around them, which takes a fifth of the time of a tree of all points.
class LocalSurface {
public:
    using Part = FramedSurface;

    /// @param cloud, frame  must outlive the surface.
    /// @param places  about as many as are asked for at a time: where points around them would be
    ///                most of the cloud, or it has no more than 100,000, all are used.
    LocalSurface(const BoxedCloud& cloud, const ErrorFrame& frame, std::size_t places,
                 const FootFinder::Options& options, const RunContext& context);

    std::size_t size() const noexcept { return cloud_.cloud.size(); }
    /// Every sixteenth point, of fewer than 131,072 every eighth, or all.
    const Part& some() const noexcept { return *some_; }
    /// Whether `some` are all.
    bool is_whole() const noexcept { return some_->points.size() == size(); }

    /// How many points to have in view around a place: to find its foot, or for the area around it.
    static constexpr std::size_t kForFeet = 128, kForAreas = 96;

    /// What has to be in view for places on the surface or beside it: balls around them, in the
    /// frame, with about so many points of the cloud each.
    std::vector<Ball> views(std::span<const Vec3f> places, std::size_t points,
                            const RunContext& context) const;

    /// The points within some balls; all of a surface that is whole.
    std::shared_ptr<const Part> gather(std::span<const Ball> balls,
                                       const RunContext& context) const;

    /// `FootFinder::find` for the centers of balls, on this thread. Where the neighbourhood of a
    /// foot is not in view, more is gathered, twice at most.
    ///
    /// @param part  with all that is within the balls.
    void find(const Part& part, std::span<const Ball> places,
              const std::function<void(std::size_t, const Foot&)>& found,
              const RunContext& context) const;

private:
    const BoxedCloud& cloud_;
    const ErrorFrame& frame_;
    FootFinder::Options options_;
    std::shared_ptr<const Part> some_;
};

}  // namespace stipple
