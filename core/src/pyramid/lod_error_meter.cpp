#include "stipple/lod_error_meter.hpp"

#include "base/refuse.hpp"
#include "cloud/hilbert_order.hpp"
#include "error/error_frame.hpp"
#include "pyramid/level_meter.hpp"

#include <utility>

namespace stipple {

struct LodErrorMeter::State {
    Aabb box;  ///< of the source
    ErrorFrame frame;
    LevelMeter meter;
};

LodErrorMeter::LodErrorMeter(const PointCloud& source, const RunContext& context)
    : state_(std::make_unique<State>()) {
    require_cleaned(source);
    if (source.empty()) refuse("the cloud has no points: expected at least 1");
    State& state = *state_;
    state.box = bounds(source);
    state.frame = ErrorFrame(state.box, source);
    std::vector<Vec3f> points =
        state.frame.into(source, hilbert_order(source.positions, context), context);
    context.checkpoint(0.3);
    state.meter = LevelMeter(std::move(points), LodErrors::Sure, context.part(0.3, 1));
    state.meter.forget_surface();  // while levels are made
}

LodErrorMeter::~LodErrorMeter() = default;

SurfaceError LodErrorMeter::measure(const PointCloud& level, const RunContext& context) {
    if (level.empty()) refuse("the level has no points: expected at least 1");
    auto& [box, frame, meter] = *state_;
    MeasuredLevel measured(frame.into(level, hilbert_order(level.positions, context), context),
                           context);
    context.checkpoint(0.3);
    meter.measure_well(measured, context);
    context.checkpoint(0.8);
    SurfaceError error = meter.error_of(measured, frame, context);
    error.diagonal = box.diagonal();
    error.candidate_diagonal = bounds(level).diagonal();
    meter.forget_surface();
    return error;
}

}  // namespace stipple
