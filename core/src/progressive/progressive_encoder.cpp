// Follows: Pauly, Gross, Kobbelt 2002, §3.2, whose contractions run backwards here; the idea of one
// order for all resolutions from Hoppe's progressive meshes (1996).
//
// A batch visits the points that are there in their order, which is that of nothing in space: what
// a part of a batch adds is spread over all of the surface.

#include "base/distance_statistics.hpp"
#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "cloud/grid_step.hpp"
#include "contraction/nested_order.hpp"
#include "error/error_samples.hpp"
#include "error/foot_finder.hpp"
#include "neighbors/gaps.hpp"
#include "neighbors/point_tree.hpp"
#include "progressive/progressive_layout.hpp"
#include "progressive/progressive_values.hpp"
#include "progressive/progressive_walk.hpp"
#include "progressive/sharpening.hpp"
#include "stipple/error.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/progressive_cloud.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 8'192;

void check(const PointCloud& cloud, const ProgressiveOptions& options) {
    validate(cloud);
    if (cloud.empty()) refuse("the cloud has no points: expected at least 1");
    require(options.position_bits >= 1 && options.position_bits <= kMostGridBits, "position_bits",
            options.position_bits, "1..24");
    if (options.precision) {
        require(makes_steps(*options.precision), "precision", *options.precision,
                "a finite number above 0");
    }
    require(options.normal_bits >= 2 && options.normal_bits <= 16, "normal_bits",
            options.normal_bits, "2..16");
    require(options.attribute_bits <= 32, "attribute_bits", options.attribute_bits, "0..32");
    require(options.coarseness >= 0 && std::isfinite(options.coarseness), "coarseness",
            options.coarseness, "a finite number of at least 0");
    for (const Vec3f& p : cloud.positions) {
        if (!p.allFinite())
            refuse("a position is not finite: remove such points (`clean`; jobs and commands do)");
    }
}

[[noreturn]] void refuse_wide_cloud(double side, double spacing) {
    refuse("the cloud is ", side, " wide, and its points lie about ", spacing, " apart: a grid of ",
           kMostGridBits,
           " bits cannot tell them apart; remove far-off points, or set a precision");
}

/// Half the step of a grid whose places are told in single precision, in the frame of the cloud:
/// rounding adds to it, unless it takes positions that were floats back to where they were.
double half_step_of_floats(double precision, double rounding) {
    if (rounding <= kUncounted * precision) return precision;
    return std::max(precision - rounding, precision / 2);
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
        const double largest = std::max(low.cwiseAbs().maxCoeff(), high.cwiseAbs().maxCoeff());
        const double rounding = rounding_of_floats(largest);  // of what is decoded
        const double left = precision_left(*options.precision, rounding_of_reading(cloud), side);
        layout.step = 2 * half_step_of_floats(left, rounding);
        bits = std::max(1.0, std::ceil(std::log2(side / layout.step + 1)));
        require(bits <= kMostGridBits, "precision", *options.precision,
                "a value that 24 bits can give");
    } else if (side > 0) {
        // With longer steps than the spacing the points of one part would fall into one place.
        const double spacing =
            median_gap(PointTree(cloud.positions, PointTree::Leaves::Loose, context));
        const double apart = spacing > 0 ? std::ceil(std::log2(side / spacing + 1)) : 0;
        if (apart > kMostGridBits) refuse_wide_cloud(side, spacing);
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
        // Not at points, which are off the surface that is through them by their noise.
        const FootFinder surface(points, tree, {});
        const LonePoints lone_points(points, tree);
        const auto take = [&](std::uint64_t samples) {
            constexpr std::uint64_t kFew = 4;  // points for each place
            return points.size() < kFew * samples
                       ? take_surface(lone_points, surface, samples, 0, context)
                       : take_surface_by_area(lone_points, surface, samples, 0, context);
        };
        constexpr std::uint64_t kSamples = 16'384, kFew = 4'096;
        samples_ = take(kSamples);
        few_samples_ = take(kFew);
    }

    double mean(std::size_t count, const auto& position) const {
        return mean_at(samples_, count, position);
    }
    /// In a quarter of the places: to compare.
    double quick_mean(std::size_t count, const auto& position) const {
        return mean_at(few_samples_, count, position);
    }

private:
    double mean_at(const ErrorSamples& samples, std::size_t count, const auto& position) const {
        auto points = made_in_blocks<std::vector<Vec3f>>(count, context_);
        for_blocks_in_order(count, context_, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i)
                points[i] = (position(i) * unit_).template cast<float>();
        });
        const PointTree tree(points, PointTree::Leaves::Quick, context_);
        std::vector<float> distances(samples.size());
        FootFinder(points, tree, {})
            .find(
                samples.positions,
                [&](std::size_t i, const Foot& foot) {
                    distances[i] = static_cast<float>(foot.distance);
                },
                context_);
        return summarize("", distances, samples.areas).mean / unit_;
    }

    double unit_;  ///< brings positions to a size of about 1
    const RunContext& context_;
    ErrorSamples samples_, few_samples_;
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

Cell coarser(const Cell& cell, unsigned shift) {
    return {cell[0] >> shift, cell[1] >> shift, cell[2] >> shift};
}

// Neighbours are looked for in blocks of three points, new ones asked for in cells of hardly more
// than one: of finer cells more would be asked, of coarser ones less would be known.
constexpr double kBlocksOfPoints = 1.0 / 3, kCellsOfPoints = 0.9;

/// Chooses how fine the grid of each batch is and how much its points are put out, and says what
/// error comes of it.
class BatchPlanner {
public:
    BatchPlanner(const PointCloud& cloud, std::span<const Cell> cells,
                 const ProgressiveLayout& layout, const RunContext& context)
        : cells_(cells),
          layout_(layout),
          context_(context),
          errors_(cloud, unit(cells, layout), context) {}

    std::vector<ProgressiveLayout::Batch> batches(double coarseness) const;

private:
    /// The first points as decoders have them.
    struct Prefix {
        std::vector<Cell> places;
        std::vector<Vec3d> ways;                  ///< to their surface
        std::map<unsigned, double> quick_errors;  ///< of sharpenings that were tried
    };

    static double unit(std::span<const Cell> cells, const ProgressiveLayout& layout);
    std::vector<Cell> places_of(std::size_t count, unsigned shift) const;
    Prefix prefix(std::size_t count, unsigned shift, unsigned block_bits) const;
    /// Where its point i is shown.
    Vec3d position(const Prefix& prefix, unsigned sharpening, std::size_t i) const;
    double error(const Prefix& prefix, unsigned sharpening) const;
    double quick_error(Prefix& prefix, unsigned sharpening) const;
    unsigned best_sharpening(Prefix& prefix, unsigned from) const;

    std::span<const Cell> cells_;  ///< on the finest grid, in the order of the stream
    const ProgressiveLayout& layout_;
    const RunContext& context_;
    PrefixErrors errors_;
};

/// Brings positions to a size of about 1.
double BatchPlanner::unit(std::span<const Cell> cells, const ProgressiveLayout& layout) {
    std::int32_t steps = 0;  // of the longest side
    for (const Cell& cell : cells) steps = std::max(steps, *std::ranges::max_element(cell));
    constexpr int kMostOfFloat = 120;
    const int size = steps == 0 ? 0 : std::ilogb(layout.step * steps);
    return std::ldexp(1.0, std::clamp(-size, -kMostOfFloat, kMostOfFloat));
}

std::vector<Cell> BatchPlanner::places_of(std::size_t count, unsigned shift) const {
    const std::span<const Cell> cells = cells_.first(count);
    // In a crowd in one cell every search for the nearest few would look at all of it.
    const std::vector<Index> apart = first_in_blocks(cells, shift);
    const bool is_crowded = 2 * apart.size() < count;
    std::vector<Cell> places;
    places.reserve(is_crowded ? apart.size() : count);
    const auto add = [&](const Cell& cell) {
        places.push_back(ProgressiveLayout::place(coarser(cell, shift), shift));
    };
    if (is_crowded) {
        for (const Index i : apart) add(cells[i]);
    } else {
        for (const Cell& cell : cells) add(cell);
    }
    return places;
}

BatchPlanner::Prefix BatchPlanner::prefix(std::size_t count, unsigned shift,
                                          unsigned block_bits) const {
    Prefix prefix{places_of(count, shift), {}, {}};
    prefix.ways = ways_to_surface(prefix.places, std::max(block_bits, shift) + 1, context_);
    return prefix;
}

Vec3d BatchPlanner::position(const Prefix& prefix, unsigned sharpening, std::size_t i) const {
    const double part = static_cast<double>(sharpening) / ProgressiveLayout::kSharpeningUnit;
    const Vec3d way = sharpening == 0 ? Vec3d::Zero() : Vec3d(-part * prefix.ways[i]);
    return layout_.position(prefix.places[i], way);
}

double BatchPlanner::error(const Prefix& prefix, unsigned sharpening) const {
    return errors_.mean(prefix.places.size(),
                        [&](std::size_t i) { return position(prefix, sharpening, i); });
}

double BatchPlanner::quick_error(Prefix& prefix, unsigned sharpening) const {
    const auto [at, is_new] = prefix.quick_errors.try_emplace(sharpening);
    if (is_new) {
        at->second = errors_.quick_mean(
            prefix.places.size(), [&](std::size_t i) { return position(prefix, sharpening, i); });
    }
    return at->second;
}

/// The least that has about the least error: of what is put out farther than that asks, surfaces of
/// quadratic basis become worse.
unsigned BatchPlanner::best_sharpening(Prefix& prefix, unsigned from) const {
    constexpr unsigned kStep = ProgressiveLayout::kSharpeningUnit / 8, kMost = 15 * kStep;
    constexpr double kAbout = 1 + 1.0 / 32;
    const auto error_of = [&](unsigned sharpening) { return quick_error(prefix, sharpening); };
    unsigned best = from;
    while (best < kMost && error_of(best + kStep) < error_of(best)) best += kStep;
    while (best > 0 && error_of(best - kStep) < error_of(best)) best -= kStep;
    unsigned least = best;
    while (least > 0 && error_of(least - kStep) <= kAbout * error_of(best)) least -= kStep;
    return least;
}

std::vector<ProgressiveLayout::Batch> BatchPlanner::batches(double coarseness) const {
    constexpr unsigned kUsualSharpening = 24;
    std::vector<ProgressiveLayout::Batch> batches;
    unsigned shift = layout_.grid_bits - 1U, sharpening = kUsualSharpening;
    unsigned blocks = 0, cells = 0;  // bits of those of the batch before
    for (const std::uint32_t end : batch_ends(cells_.size())) {
        const bool is_last = end == cells_.size();
        const unsigned before = shift;
        const unsigned next_blocks =
            is_last ? 0 : block_bits_for(cells_.first(end), kBlocksOfPoints);
        Prefix shown;
        if (is_last) {
            shift = sharpening = 0;
            shown.places = places_of(end, shift);
        } else {
            Prefix finest = prefix(end, 0, next_blocks);
            const double most = (1 + coarseness) * quick_error(finest, sharpening);
            const auto on_grid = [&] {
                return shift == 0 ? std::move(finest) : prefix(end, shift, next_blocks);
            };
            shown = on_grid();
            while (shift > 0 && !(coarseness > 0 && quick_error(shown, sharpening) <= most)) {
                --shift;
                shown = on_grid();
            }
            sharpening = best_sharpening(shown, sharpening);
        }
        ProgressiveLayout::Batch batch{.points = end,
                                       .shift = static_cast<std::uint8_t>(shift),
                                       .block_bits = kMostGridBits,  // few points: all in one block
                                       .sharpening = static_cast<std::uint8_t>(sharpening),
                                       .mean_error = static_cast<float>(error(shown, sharpening))};
        if (!batches.empty()) {
            batch.lift = static_cast<std::uint8_t>(
                std::min(std::max(cells, before) - shift, layout_.grid_bits - shift));
            batch.block_bits = static_cast<std::uint8_t>(std::max(blocks, before) - before + 1);
        }
        batches.push_back(batch);
        blocks = next_blocks;
        if (!is_last) cells = block_bits_for(cells_.first(end), kCellsOfPoints);
        context_.checkpoint(static_cast<double>(end) / static_cast<double>(cells_.size()));
    }
    return batches;
}

constexpr std::size_t kBetweenLooks = 16'384;  // at the stop token

/// What the encoder's side of the walk knows.
class Encoder {
public:
    Encoder(std::span<const Cell> cells, std::span<std::uint32_t> values,
            const ProgressiveLayout& layout)
        : cells_(cells), values_(values), walk_(layout.channels()) {}

    std::vector<std::byte> batch(const ProgressiveLayout& layout, std::size_t number,
                                 const RunContext& context);

    // What the walk asks.
    RangeEncoder coder;
    void begin_round(std::size_t known, std::size_t target);
    bool lies_in(const Cell& cell);
    void begin_far();
    bool has_far(std::size_t parent);
    Cell next_cell() const { return waiting_[coming_ - first_]; }
    void added(std::size_t parent);
    Cell fine_cell(std::size_t point) const {
        return coarser(cells_[point == 0 ? 0 : numbers_[point]], shift_);
    }

private:
    std::span<const Cell> cells_;  ///< on the finest grid
    std::span<std::uint32_t> values_;
    ProgressiveWalk walk_;
    std::vector<Index> numbers_;  ///< which the points are that were coded

    unsigned shift_ = 0, lift_ = 0;  ///< of the batch

    // Of a round: the points that are to come, and which of them have.
    Index first_ = 0;
    std::vector<Cell> waiting_;
    std::vector<bool> came_;
    CellBlocks by_cell_;
    Index coming_ = 0;                          ///< the number of the point that is added next
    std::vector<std::pair<Index, Index>> far_;  ///< parent, number; in the order of the walk
    std::size_t next_far_ = 0;
};

void Encoder::begin_round(std::size_t known, std::size_t target) {
    first_ = static_cast<Index>(known);
    waiting_.clear();
    for (std::size_t i = known; i < target; ++i) waiting_.push_back(coarser(cells_[i], shift_));
    came_.assign(waiting_.size(), false);
    by_cell_ = CellBlocks(waiting_, lift_);
}

bool Encoder::lies_in(const Cell& cell) {
    const auto next = by_cell_.take_from(cell);
    if (!next) return false;
    came_[*next] = true;
    coming_ = first_ + *next;
    return true;
}

void Encoder::begin_far() {
    const auto place = [](const Cell& cell) {
        return Vec3f(Eigen::Vector3i(cell[0], cell[1], cell[2]).cast<float>());
    };
    std::vector<Vec3f> known;
    for (Index i = 0; i < first_; ++i) known.push_back(place(walk_.cell(i).first));
    const NeighborSearch search(known, {.threads = 1});
    far_.clear();
    next_far_ = 0;
    for (Index i = 0; i < waiting_.size(); ++i) {
        if (came_[i]) continue;
        std::array<Neighbor, 1> room;
        search.nearest(place(waiting_[i]), room);
        far_.emplace_back(room[0].index, first_ + i);
    }
    std::ranges::sort(far_);
}

bool Encoder::has_far(std::size_t parent) {
    if (next_far_ == far_.size() || far_[next_far_].first != parent) return false;
    coming_ = far_[next_far_++].second;
    return true;
}

void Encoder::added(std::size_t parent) {
    const std::size_t count = walk_.model().channel_count();
    const std::vector<std::uint32_t> zeros(numbers_.empty() ? count
                                                            : 0);  // the first has no parent
    numbers_.push_back(coming_);
    const auto from =
        std::span<const std::uint32_t>(values_).subspan(numbers_[parent] * count, count);
    walk_.model().code_channels(coder, zeros.empty() ? from : zeros,
                                values_.subspan(coming_ * count, count));
}

std::vector<std::byte> Encoder::batch(const ProgressiveLayout& layout, std::size_t number,
                                      const RunContext& context) {
    shift_ = layout.batches[number].shift;
    lift_ = layout.batches[number].lift;
    coder = {};
    const std::size_t before = walk_.size();
    if (number == 0) {
        walk_.start(*this, layout, context);
    } else {
        walk_.begin_batch(*this, layout, number, context);
    }
    for (std::size_t steps = 0; walk_.step(*this, context); ++steps)
        if (steps % kBetweenLooks == 0) context.throw_if_stopped();
    std::vector<std::byte> bytes = coder.finish();
    // A batch of points that took hardly a bit is filled up to what decoders want to see.
    while (walk_.size() - before >
           ProgressiveLayout::most_points(bytes.size(), walk_.model().channel_count()))
        bytes.push_back(std::byte{0});
    return bytes;
}

}  // namespace

std::vector<std::byte> encode_progressive(const PointCloud& cloud,
                                          const ProgressiveOptions& options,
                                          const RunContext& context) {
    check(cloud, options);
    require_squares(bounds(cloud).diagonal());
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
    const std::vector<Index> order = nested_order(cloud.positions, context.part(0, 0.5));
    const std::vector<Cell> cells = cells_of(cloud, order, layout, context);
    const RunContext planning = context.part(0.5, 0.8);
    layout.batches = BatchPlanner(cloud, cells, layout, planning).batches(options.coarseness);

    std::vector<std::uint32_t> values = pack_channels(cloud, order, layout, context);
    Encoder encoder(cells, values, layout);
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
