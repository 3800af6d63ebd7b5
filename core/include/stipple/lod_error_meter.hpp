#pragma once

#include "stipple/point_cloud.hpp"
#include "stipple/run_context.hpp"
#include "stipple/surface_error.hpp"

#include <memory>

namespace stipple {

/// Measures how far the levels of a pyramid are from their source (§4), as `LodTiler` does for
/// those that have tiles.
///
/// From the source, at places on its surface that all levels share: one for 128 points of the
/// level, at least 8,192 (32,768 for a source of fewer than 40,000 points), and more, up to
/// 131,072, while these do not determine the mean to 1.6 %. To the source, at as many points of the
/// level as `estimate_error` takes. The maximum is the largest distance met, a lower bound.
///
/// O(N log N), parallel, the same for any number of threads; about 60 bytes per point of the
/// source.
class LodErrorMeter {
public:
    /// @param source  a cleaned cloud of at least one point; not needed afterwards.
    explicit LodErrorMeter(const PointCloud& source, const RunContext& context = {});
    ~LodErrorMeter();
    LodErrorMeter(const LodErrorMeter&) = delete;
    LodErrorMeter& operator=(const LodErrorMeter&) = delete;

    /// @param level  of at least one point. @throws Error(InvalidArgument) for one without.
    SurfaceError measure(const PointCloud& level, const RunContext& context = {});

private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace stipple
