// Follows: Pauly, Gross, Kobbelt 2002, §3.2, whose contractions run backwards here; the idea of one
// order for all resolutions from Hoppe's progressive meshes (1996).
//
// A point is coded where it comes from: a batch visits the points that are there in their order,
// new ones too, and writes those attached to each with it. The first half of the points are the
// earlier batches', which cover all of the surface: so does what a part of a batch adds.

#include "distance_statistics.hpp"
#include "error_samples.hpp"
#include "first_touch.hpp"
#include "foot_finder.hpp"
#include "gaps.hpp"
#include "nested_order.hpp"
#include "parallel_for.hpp"
#include "point_tree.hpp"
#include "progressive_layout.hpp"
#include "progressive_model.hpp"
#include "progressive_values.hpp"
#include "stipple/error.hpp"
#include "stipple/progressive_cloud.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 8'192;

template <typename T>
[[noreturn]] void refuse(const char* name, T value, const char* expected) {
    std::ostringstream text;
    text << name << ' ' << value << ": expected " << expected;
    throw Error(ErrorCode::InvalidArgument, text.str());
}

void check(const PointCloud& cloud, const ProgressiveOptions& options) {
    validate(cloud);
    if (cloud.empty())
        throw Error(ErrorCode::InvalidArgument, "the cloud has no points: expected at least 1");
    if (options.position_bits < 1 || options.position_bits > kMostGridBits)
        refuse("position_bits", options.position_bits, "1..24");
    if (options.precision && !(*options.precision > 0 && std::isfinite(*options.precision)))
        refuse("precision", *options.precision, "a finite number above 0");
    if (options.normal_bits < 2 || options.normal_bits > 16)
        refuse("normal_bits", options.normal_bits, "2..16");
    if (options.attribute_bits > 32) refuse("attribute_bits", options.attribute_bits, "0..32");
    if (!(options.coarseness >= 0 && std::isfinite(options.coarseness)))
        refuse("coarseness", options.coarseness, "a finite number of at least 0");
    for (const Vec3f& p : cloud.positions) {
        if (!p.allFinite())
            throw Error(
                ErrorCode::InvalidArgument,
                "a position is not finite: clean the cloud first, as `simplify` with ratio 1 does");
    }
}

void choose_grid(const PointCloud& cloud, const ProgressiveOptions& options,
                 ProgressiveLayout& layout, const RunContext& context) {
    Vec3f low = cloud.positions.front(), high = low;
    for (const Vec3f& p : cloud.positions) {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
    }
    layout.low = low.cast<double>();
    const double side = (high.cast<double>() - layout.low).maxCoeff();
    double bits = options.position_bits;
    if (options.precision) {
        layout.step = 2 * *options.precision;
        bits = std::max(1.0, std::ceil(std::log2(side / layout.step + 1)));
        if (bits > kMostGridBits) refuse("precision", *options.precision, "what 24 bits can give");
    } else if (side > 0) {
        // With longer steps than the spacing the points of one part would fall into one place.
        const double spacing =
            median_gap(PointTree(cloud.positions, PointTree::Leaves::Loose, context));
        const double apart = spacing > 0 ? std::ceil(std::log2(side / spacing + 1)) : 0;
        bits = std::clamp<double>(apart, options.position_bits, kMostGridBits);
        layout.step = side / (std::exp2(bits) - 1);
    }
    layout.grid_bits = static_cast<std::uint8_t>(bits);
}

/// Where the points are on the finest grid, in an order.
std::vector<Cell> cells_of(const PointCloud& cloud, std::span<const Index> points,
                           const ProgressiveLayout& layout, const RunContext& context) {
    const double most = (1U << layout.grid_bits) - 1U;
    auto cells = made_in_blocks<std::vector<Cell>>(points.size(), context);
    parallel_for_blocks(cells.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const Vec3d at = (cloud.positions[points[i]].cast<double>() - layout.low) / layout.step;
            for (int axis = 0; axis < 3; ++axis)
                cells[i][axis] =
                    static_cast<std::int32_t>(std::clamp(std::floor(at[axis] + 0.5), 0.0, most));
        }
    });
    return cells;
}

/// How far the surface of the whole is from that of its first points.
class PrefixErrors {
public:
    PrefixErrors(const PointCloud& cloud, double unit, const RunContext& context)
        : unit_(unit), context_(context) {
        auto points = made_in_blocks<std::vector<Vec3f>>(cloud.size(), context);
        const auto scale = static_cast<float>(unit);
        for_blocks_in_order(points.size(), context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) points[i] = cloud.positions[i] * scale;
        });
        const PointTree tree(points, PointTree::Leaves::Quick, context);
        constexpr std::uint64_t kSamples = 16'384;
        samples_ = points.size() < 2 * kSamples
                       ? take_surface(tree, FootFinder(points, tree, {}), kSamples, 0, context)
                       : take_points(tree, kSamples, 0, context);
    }

    double mean(std::size_t count, const auto& position) const {
        auto points = made_in_blocks<std::vector<Vec3f>>(count, context_);
        for_blocks_in_order(count, context_, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i)
                points[i] = (position(i) * unit_).template cast<float>();
        });
        const PointTree tree(points, PointTree::Leaves::Quick, context_);
        std::vector<float> distances(samples_.size());
        FootFinder(points, tree, {})
            .find(
                samples_.positions,
                [&](std::size_t i, const Foot& foot) {
                    distances[i] = static_cast<float>(foot.distance);
                },
                context_);
        return summarize("", distances, samples_.areas).mean / unit_;
    }

private:
    double unit_;  ///< brings positions to a size of about 1
    const RunContext& context_;
    ErrorSamples samples_;
};

/// Ends of batches: each has twice the points of the one before.
std::vector<std::uint32_t> batch_ends(std::size_t points) {
    constexpr std::size_t kFirst = 256;
    std::vector<std::uint32_t> ends;
    for (; points > kFirst; points = (points + 1) / 2)
        ends.push_back(static_cast<std::uint32_t>(points));
    ends.push_back(static_cast<std::uint32_t>(points));
    std::ranges::reverse(ends);
    return ends;
}

/// Chooses how fine the grid of each batch is, and says what error comes of it.
void plan_batches(const PointCloud& cloud, const NestedOrder& order, std::span<const Cell> cells,
                  double coarseness, ProgressiveLayout& layout, const RunContext& context) {
    std::int32_t steps = 0;  // of the longest side
    for (const Cell& cell : cells) steps = std::max(steps, *std::ranges::max_element(cell));
    constexpr int kMostOfFloat = 120;
    const int size = steps == 0 ? 0 : std::ilogb(layout.step * steps);
    const PrefixErrors errors(
        cloud, std::ldexp(1.0, std::clamp(-size, -kMostOfFloat, kMostOfFloat)), context);
    unsigned shift = layout.grid_bits - 1U;
    for (const std::uint32_t end : batch_ends(cells.size())) {
        const bool last = end == cells.size();
        const auto exact = [&](std::size_t i) {
            return Vec3d(cloud.positions[order.points[i]].cast<double>());
        };
        const double bound = last ? 0 : coarseness * errors.mean(end, exact);
        while (shift > 0 && !(layout.step * (1U << shift) <= bound)) --shift;
        const auto decoded = [&](std::size_t i) {
            const Vec3d cell((cells[i][0] >> shift) << shift, (cells[i][1] >> shift) << shift,
                             (cells[i][2] >> shift) << shift);
            return Vec3d(layout.low + layout.step * (cell + Vec3d::Constant(layout.middle(shift))));
        };
        layout.batches.push_back({.points = end,
                                  .bytes = 0,
                                  .shift = static_cast<std::uint8_t>(shift),
                                  .mean_error = static_cast<float>(errors.mean(end, decoded))});
        context.checkpoint(static_cast<double>(end) / static_cast<double>(cells.size()));
    }
}

constexpr std::size_t kBetweenLooks = 16'384;  // at the stop token

/// Of each point those attached to it, in the order in which they come: a list for each.
struct Attached {
    static constexpr Index kNone = ~Index{0};
    std::vector<Index> next;   ///< after this one, of the same parent
    std::vector<Index> first;  ///< not yet coded

    Attached(std::span<const Index> parents, const RunContext& context)
        : next(made_in_blocks<std::vector<Index>>(parents.size(), context)),
          first(made_in_blocks<std::vector<Index>>(parents.size(), context)) {
        for_blocks_in_order(parents.size(), context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) next[i] = first[i] = kNone;
        });
        for (auto i = static_cast<Index>(parents.size()); --i > 0;) {
            if (i % kBetweenLooks == 0) context.throw_if_stopped();
            next[i] = first[parents[i]];
            first[parents[i]] = i;
        }
    }
};

class Encoder {
public:
    Encoder(std::span<const Cell> cells, std::span<std::uint32_t> values, const NestedOrder& order,
            const ProgressiveLayout& layout, const RunContext& context)
        : cells_(cells),
          values_(values),
          attached_(order.parents, context),
          model_(layout.channels()) {
        reserve_in_blocks(points_, cells.size(), context);
        reserve_in_blocks(numbers_, cells.size(), context);
    }

    std::vector<std::byte> batch(const ProgressiveLayout& layout, std::size_t number,
                                 const RunContext& context);

private:
    Cell at(Index i, unsigned shift) const {
        return {cells_[i][0] >> shift, cells_[i][1] >> shift, cells_[i][2] >> shift};
    }
    void start(RangeEncoder& coder, unsigned shift, unsigned bits);
    void attach(RangeEncoder& coder, std::size_t parent, unsigned shift);

    std::span<const Cell> cells_;
    std::span<std::uint32_t> values_;
    Attached attached_;
    ProgressiveModel model_;
    std::vector<TracedPoint> points_;  ///< those that were coded, as the decoder has them
    std::vector<Index> numbers_;       ///< which these are
};

void Encoder::start(RangeEncoder& coder, unsigned shift, unsigned bits) {
    TracedPoint root{};
    root.cell = at(0, shift);
    model_.code_root(coder, root.cell, bits - shift);
    const std::size_t count = model_.channel_count();
    model_.code_channels(coder, std::vector<std::uint32_t>(count), values_.first(count));
    points_.push_back(root);
    numbers_.push_back(0);
}

/// The next of those attached to a point.
void Encoder::attach(RangeEncoder& coder, std::size_t parent, unsigned shift) {
    Index& i = attached_.first[numbers_[parent]];
    const Cell cell = at(i, shift), &from = points_[parent].cell;
    const TracedPoint child = model_.attach(
        coder, points_[parent], {cell[0] - from[0], cell[1] - from[1], cell[2] - from[2]});
    const std::size_t count = model_.channel_count();
    model_.code_channels(coder, values_.subspan(numbers_[parent] * count, count),
                         values_.subspan(i * count, count));
    points_.push_back(child);
    numbers_.push_back(i);
    i = attached_.next[i];
}

std::vector<std::byte> Encoder::batch(const ProgressiveLayout& layout, std::size_t number,
                                      const RunContext& context) {
    const ProgressiveLayout::Batch& batch = layout.batches[number];
    const unsigned shift = batch.shift,
                   split = number == 0 ? 0 : layout.batches[number - 1].shift - shift;
    RangeEncoder coder;
    if (number == 0) start(coder, shift, layout.grid_bits);
    const std::size_t before = number == 0 ? 0 : points_.size();
    for (std::size_t i = 0; i < points_.size(); ++i) {
        if (i % kBetweenLooks == 0) context.throw_if_stopped();
        if (split > 0 && i < before) {
            const Cell fine = at(numbers_[i], shift);
            const std::int32_t mask = (1 << split) - 1;
            model_.refine(coder, points_[i], split,
                          {fine[0] & mask, fine[1] & mask, fine[2] & mask});
        }
        unsigned attached = 0;
        while (points_.size() < batch.points &&
               model_.code_more(coder, points_[i], attached,
                                attached_.first[numbers_[i]] < batch.points)) {
            attach(coder, i, shift);
            ++attached;
        }
        model_.visited(points_[i], attached);
    }
    std::vector<std::byte> bytes = coder.finish();
    // A batch of points that took hardly a bit is filled up to what decoders want to see.
    while (points_.size() - before >
           ProgressiveLayout::most_points(bytes.size(), model_.channel_count()))
        bytes.push_back(std::byte{0});
    return bytes;
}

}  // namespace

std::vector<std::byte> encode_progressive(const PointCloud& cloud,
                                          const ProgressiveOptions& options,
                                          const RunContext& context) {
    check(cloud, options);
    ProgressiveLayout layout;
    choose_grid(cloud, options, layout, context);
    layout.normals = !cloud.normals.empty();
    layout.colors = !cloud.colors.empty();
    layout.alpha = layout.colors && cloud.has_alpha;
    layout.double_precision = cloud.double_precision;
    layout.normal_bits = static_cast<std::uint8_t>(options.normal_bits);
    layout.points = static_cast<std::uint32_t>(cloud.size());
    layout.origin = cloud.origin;
    layout.attributes = describe_attributes(cloud, options.attribute_bits);

    context.checkpoint(0);
    const NestedOrder order = nested_order(cloud.positions, context.part(0, 0.5));
    const std::vector<Cell> cells = cells_of(cloud, order.points, layout, context);
    plan_batches(cloud, order, cells, options.coarseness, layout, context.part(0.5, 0.8));

    std::vector<std::uint32_t> values = pack_channels(cloud, order.points, layout, context);
    Encoder encoder(cells, values, order, layout, context);
    std::vector<std::byte> body;
    for (std::size_t b = 0; b < layout.batches.size(); ++b) {
        const std::vector<std::byte> batch = encoder.batch(layout, b, context);
        if (batch.size() > UINT32_MAX)
            throw Error(ErrorCode::TooLarge, "progressive stream: a batch of " +
                                                 std::to_string(batch.size()) +
                                                 " bytes: expected less than 2^32; leave "
                                                 "attributes out");
        layout.batches[b].bytes = static_cast<std::uint32_t>(batch.size());
        body.insert(body.end(), batch.begin(), batch.end());
        context.checkpoint(0.8 + 0.2 * layout.batches[b].points / layout.points);
    }
    std::vector<std::byte> stream = write_header(layout);
    stream.insert(stream.end(), body.begin(), body.end());
    return stream;
}

}  // namespace stipple
