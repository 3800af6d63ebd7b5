#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "progressive/progressive_layout.hpp"
#include "progressive/progressive_values.hpp"
#include "progressive/progressive_walk.hpp"
#include "progressive/sharpening.hpp"
#include "stipple/error.hpp"
#include "stipple/progressive_cloud.hpp"

#include <string>
#include <utility>
#include <vector>

namespace stipple {

struct ProgressiveDecoder::State {
    State(const DecodeLimits& limits_, std::uint64_t most) : limits(limits_), most_points(most) {}

    // What the walk asks; the bits tell.
    RangeDecoder coder;
    static void begin_round(std::size_t /*known*/, std::size_t /*target*/) {}
    static bool lies_in(const Cell& /*cell*/) { return false; }
    static void begin_far() {}
    static bool has_far(std::size_t /*parent*/) { return false; }
    static Cell next_cell() { return {}; }
    static Cell fine_cell(std::size_t /*point*/) { return {}; }
    void added(std::size_t parent);

    DecodeLimits limits;
    std::uint64_t most_points;
    std::vector<std::byte> pending;  ///< of the header or the current batch, and what follows
    ProgressiveLayout layout;
    std::vector<ProgressiveBatch> batches;
    ProgressiveWalk walk{{}};
    std::vector<std::uint32_t> values;  ///< channels, point by point
    std::size_t batch = 0;              ///< the current one
    bool started = false;               ///< it

    bool complete() const { return !batches.empty() && batch == batches.size(); }
    bool done() const { return complete() || (!batches.empty() && walk.size() >= most_points); }

    /// The cell of a point, and the bits of the grid that it lacks.
    std::pair<Cell, unsigned> cell_of(std::size_t i) const;

    bool take_header();
    bool run_batch(const RunContext& context);
    void start_batch(std::span<const std::byte> bytes, const RunContext& context);
    void end_batch();
};

void ProgressiveDecoder::State::added(std::size_t parent) {
    const std::size_t count = walk.model().channel_count();
    if (count == 0) return;
    const std::vector<std::uint32_t> zeros(values.empty() ? count : 0);  // the first has no parent
    values.resize(walk.size() * count);
    const auto from = std::span<const std::uint32_t>(values).subspan(parent * count, count);
    walk.model().code_channels(coder, zeros.empty() ? from : zeros, std::span(values).last(count));
}

/// Whether it is there.
bool ProgressiveDecoder::State::take_header() {
    const auto length = header_length(pending);
    if (!length || pending.size() < *length) return false;
    layout = parse_header(std::span(pending).first(*length), limits);
    pending.erase(pending.begin(), pending.begin() + static_cast<std::ptrdiff_t>(*length));
    walk = ProgressiveWalk(layout.channels());
    std::uint64_t bytes = *length;
    for (const ProgressiveLayout::Batch& b : layout.batches) {
        bytes += b.bytes;
        batches.push_back({b.points, bytes, layout.step * (1U << b.shift), b.mean_error});
    }
    return true;
}

void ProgressiveDecoder::State::start_batch(std::span<const std::byte> bytes,
                                            const RunContext& context) {
    coder.start(bytes);
    started = true;
    if (batch == 0) {
        walk.start(*this, layout, context);
    } else {
        walk.begin_batch(*this, layout, batch, context);
    }
}

void ProgressiveDecoder::State::end_batch() {
    const std::size_t bytes = layout.batches[batch].bytes;
    pending.erase(pending.begin(), pending.begin() + static_cast<std::ptrdiff_t>(bytes));
    started = false;
    ++batch;
}

/// Goes on as far as the bytes carry; whether the batch is over and all its bytes are there.
bool ProgressiveDecoder::State::run_batch(const RunContext& context) {
    const ProgressiveLayout::Batch& now = layout.batches[batch];
    const bool whole = pending.size() >= now.bytes;
    const auto bytes =
        std::span<const std::byte>(pending).first(whole ? now.bytes : pending.size());
    // What a step may read: a bit takes at most 9, and the coder is 4 bytes ahead.
    const std::size_t step_bytes = 96 + 20 * walk.model().channel_count();
    if (!whole && bytes.size() < step_bytes) return false;
    const std::size_t enough = whole ? SIZE_MAX : bytes.size() - step_bytes;
    coder.use(bytes);
    if (!started) start_batch(bytes, context);
    for (std::size_t steps = 0; coder.position() <= enough && walk.size() < most_points; ++steps) {
        constexpr std::size_t kBetweenLooks = 65'536;
        if (steps % kBetweenLooks == 0) context.throw_if_stopped();
        if (!walk.step(*this, context)) return whole;
    }
    return false;
}

std::pair<Cell, unsigned> ProgressiveDecoder::State::cell_of(std::size_t i) const {
    const auto [cell, is_fine] = walk.cell(i);
    // After a batch its grid is that of the one before.
    const std::size_t of = started && (is_fine || batch == 0) ? batch : batch - 1;
    return {cell, layout.batches[of].shift};
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
    return state_->walk.size();
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
    resize_in_blocks(cloud.positions, state.walk.size(), context);
    auto places = made_in_blocks<std::vector<Cell>>(cloud.size(), context);
    for_blocks_in_order(cloud.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const auto [cell, shift] = state.cell_of(i);
            places[i] = ProgressiveLayout::place(cell, shift);
        }
    });
    const double sharpening = layout.sharpening(state.batch, cloud.size());
    std::vector<Vec3d> ways;
    if (sharpening > 0)
        ways = ways_to_surface(places, layout.sharpening_block_bits(state.batch), context);
    for_blocks_in_order(cloud.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const Vec3d way = ways.empty() ? Vec3d::Zero() : Vec3d(-sharpening * ways[i]);
            cloud.positions[i] = layout.position(places[i], way).cast<float>();
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
