#include "first_touch.hpp"
#include "parallel_for.hpp"
#include "progressive_layout.hpp"
#include "progressive_model.hpp"
#include "progressive_values.hpp"
#include "stipple/error.hpp"
#include "stipple/progressive_cloud.hpp"

#include <algorithm>
#include <string>
#include <utility>

namespace stipple {

struct ProgressiveDecoder::State {
    State(const DecodeLimits& limits_, std::uint64_t most) : limits(limits_), most_points(most) {}

    DecodeLimits limits;
    std::uint64_t most_points;
    std::vector<std::byte> pending;  ///< of the header or the current batch, and what follows
    ProgressiveLayout layout;
    std::vector<ProgressiveBatch> batches;
    ProgressiveModel model{{}};
    std::vector<TracedPoint> points;
    std::vector<std::uint32_t> values;  ///< channels, point by point

    std::size_t batch = 0;  ///< the current one
    bool started = false;   ///< it
    RangeDecoder coder;
    std::size_t before = 0;   ///< points before it
    std::size_t visited = 0;  ///< points of which all is known that it says
    unsigned attached = 0;    ///< to the next
    bool refined = false;     ///< the next

    unsigned shift() const { return layout.batches[batch].shift; }
    unsigned split() const { return batch == 0 ? 0 : layout.batches[batch - 1].shift - shift(); }
    bool complete() const { return !batches.empty() && batch == batches.size(); }
    bool done() const { return complete() || (!batches.empty() && points.size() >= most_points); }

    bool take_header();
    bool run_batch(const RunContext& context);
    void start_batch(std::span<const std::byte> bytes);
    void end_batch();
    void take_root();
    void take_attached(std::size_t parent);
    unsigned shift_of(std::size_t i) const;
};

/// Whether it is there.
bool ProgressiveDecoder::State::take_header() {
    const auto length = header_length(pending);
    if (!length || pending.size() < *length) return false;
    layout = parse_header(std::span(pending).first(*length), limits);
    pending.erase(pending.begin(), pending.begin() + static_cast<std::ptrdiff_t>(*length));
    model = ProgressiveModel(layout.channels());
    std::uint64_t bytes = *length;
    for (const ProgressiveLayout::Batch& b : layout.batches) {
        bytes += b.bytes;
        batches.push_back({b.points, bytes, layout.step * (1U << b.shift), b.mean_error});
    }
    return true;
}

void ProgressiveDecoder::State::start_batch(std::span<const std::byte> bytes) {
    coder.start(bytes);
    started = true;
    before = points.size();
    visited = 0;
    attached = 0;
    refined = false;
    if (batch == 0) take_root();
}

void ProgressiveDecoder::State::end_batch() {
    const std::size_t bytes = layout.batches[batch].bytes;
    pending.erase(pending.begin(), pending.begin() + static_cast<std::ptrdiff_t>(bytes));
    started = false;
    ++batch;
}

void ProgressiveDecoder::State::take_root() {
    TracedPoint root{};
    model.code_root(coder, root.cell, layout.grid_bits - shift());
    points.push_back(root);
    values.resize(model.channel_count());
    model.code_channels(coder, std::vector<std::uint32_t>(values.size()), values);
}

void ProgressiveDecoder::State::take_attached(std::size_t parent) {
    const TracedPoint child = model.attach(coder, points[parent], {});
    const std::int32_t most = 1 << (layout.grid_bits - shift());
    for (const std::int32_t c : child.cell) {
        if (c < 0 || c >= most) {
            throw Error(ErrorCode::MalformedInput, "progressive stream: point " +
                                                       std::to_string(points.size()) +
                                                       " lies outside of the grid");
        }
    }
    points.push_back(child);
    const std::size_t count = model.channel_count();
    if (count == 0) return;
    values.resize(points.size() * count);
    model.code_channels(coder, std::span(values).subspan(parent * count, count),
                        std::span(values).last(count));
}

/// Goes on as far as the bytes carry; whether the batch is over and all its bytes are there.
bool ProgressiveDecoder::State::run_batch(const RunContext& context) {
    const ProgressiveLayout::Batch& now = layout.batches[batch];
    const bool whole = pending.size() >= now.bytes;
    const auto bytes =
        std::span<const std::byte>(pending).first(whole ? now.bytes : pending.size());
    // What a step may read: a bit takes at most 9, and the coder is 4 bytes ahead.
    const std::size_t step_bytes = 96 + 20 * model.channel_count();
    if (!whole && bytes.size() < step_bytes) return false;
    const std::size_t enough = whole ? SIZE_MAX : bytes.size() - step_bytes;
    if (!started) start_batch(bytes);
    coder.use(bytes);
    const std::uint64_t reachable =
        before + ProgressiveLayout::most_points(bytes.size(), model.channel_count());
    reserve_in_blocks(points, std::min<std::uint64_t>(now.points, reachable), context);
    const unsigned bits = split();
    for (std::size_t step = 0; visited < points.size(); ++step) {
        constexpr std::size_t kBetweenLooks = 65'536;
        if (step % kBetweenLooks == 0) context.throw_if_stopped();
        if (coder.position() > enough || points.size() >= most_points) return false;
        TracedPoint& point = points[visited];
        if (!refined && bits > 0 && visited < before) model.refine(coder, point, bits, {});
        refined = true;
        if (points.size() < now.points && model.code_more(coder, point, attached, false)) {
            take_attached(visited);
            ++attached;
            continue;
        }
        ProgressiveModel::visited(point, attached);
        ++visited;
        attached = 0;
        refined = false;
    }
    if (points.size() < now.points) {
        throw Error(ErrorCode::MalformedInput, "progressive stream: a batch ends at point " +
                                                   std::to_string(points.size()) + ": expected " +
                                                   std::to_string(now.points));
    }
    return whole;
}

/// Bits of the grid that point i lacks.
unsigned ProgressiveDecoder::State::shift_of(std::size_t i) const {
    if (complete()) return 0;
    const bool fine = started && (i >= before || i < visited || (i == visited && refined));
    return fine || batch == 0 ? shift() : layout.batches[batch - 1].shift;
}

ProgressiveDecoder::ProgressiveDecoder(const DecodeLimits& limits, std::uint64_t most_points)
    : state_(std::make_unique<State>(limits, most_points)) {}
ProgressiveDecoder::~ProgressiveDecoder() = default;
ProgressiveDecoder::ProgressiveDecoder(ProgressiveDecoder&&) noexcept = default;
ProgressiveDecoder& ProgressiveDecoder::operator=(ProgressiveDecoder&&) noexcept = default;

void ProgressiveDecoder::feed(std::span<const std::byte> bytes, const RunContext& context) {
    State& state = *state_;
    if (state.done()) return;
    state.pending.insert(state.pending.end(), bytes.begin(), bytes.end());
    if (state.batches.empty() && !state.take_header()) return;
    while (!state.done() && state.run_batch(context)) state.end_batch();
}

std::uint64_t ProgressiveDecoder::size() const noexcept {
    return state_->points.size();
}

std::uint64_t ProgressiveDecoder::total() const noexcept {
    return state_->layout.points;
}

bool ProgressiveDecoder::done() const noexcept {
    return state_->done();
}

const std::vector<ProgressiveBatch>& ProgressiveDecoder::batches() const noexcept {
    return state_->batches;
}

PointCloud ProgressiveDecoder::cloud(const RunContext& context) const {
    const State& state = *state_;
    const ProgressiveLayout& layout = state.layout;
    PointCloud cloud;
    cloud.origin = layout.origin;
    cloud.double_precision = layout.double_precision;
    resize_in_blocks(cloud.positions, state.points.size(), context);
    for_blocks_in_order(cloud.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const unsigned shift = state.shift_of(i);
            for (int axis = 0; axis < 3; ++axis) {
                const double cell = state.points[i].cell[axis] << shift;
                cloud.positions[i][axis] = static_cast<float>(
                    layout.low[axis] + layout.step * (cell + ProgressiveLayout::middle(shift)));
            }
        }
    });
    unpack_channels(state.values, layout, cloud, context);
    return cloud;
}

PointCloud decode_progressive(std::span<const std::byte> bytes, const DecodeLimits& limits,
                              const RunContext& context) {
    ProgressiveDecoder decoder(limits);
    decoder.feed(bytes, context);
    if (decoder.size() == 0) {
        throw Error(ErrorCode::MalformedInput,
                    "progressive stream: " + std::to_string(bytes.size()) +
                        " bytes do not reach the first point");
    }
    return decoder.cloud(context);
}

}  // namespace stipple
