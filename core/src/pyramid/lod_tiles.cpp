#include "stipple/lod_tiles.hpp"

#include "base/distance_statistics.hpp"
#include "base/progress_for.hpp"
#include "base/refuse.hpp"
#include "cloud/box_of_most.hpp"
#include "cloud/chain_order.hpp"
#include "cloud/grid_step.hpp"
#include "cloud/hilbert_order.hpp"
#include "error/error_frame.hpp"
#include "neighbors/gaps.hpp"
#include "pyramid/level_meter.hpp"
#include "pyramid/level_rounding.hpp"
#include "pyramid/tile_streams.hpp"
#include "pyramid/tile_tree.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <string>
#include <utility>

namespace stipple {

namespace {

constexpr std::uint32_t kMostPoints = 65'536;  // a tile is sorted without a look at the stop token
constexpr std::size_t kBlock = 8'192;

void check_order(std::span<const Index> order, const PointCloud& level) {
    require(order.empty() || order.size() == level.size(), "points of an order", order.size(),
            "all of the level");
}

/// Cuts the next level where it is to be cut: of additive tiles only the points that no level had.
/// @param order  of the level's points in the cloud, which begins with `had` points of the level
/// before.
std::vector<TileTree::Part> cut_level(TileTree& tree, std::span<const Vec3f> points,
                                      std::span<const Index> order, std::uint64_t had,
                                      const TileTree::Limits& limits, const RunContext& context) {
    if (had == 0) return tree.add_level(points, limits, context);
    std::vector<Index> fresh;
    std::vector<Vec3f> places;
    for (std::size_t i = 0; i < points.size(); ++i) {
        if (order[i] < had) continue;
        fresh.push_back(static_cast<Index>(i));
        places.push_back(points[i]);
    }
    std::vector<TileTree::Part> parts = tree.add_level(places, limits, context);
    for (TileTree::Part& part : parts)
        for (Index& i : part.points) i = fresh[i];
    return parts;
}

}  // namespace

void validate(const LodTileOptions& options) {
    constexpr unsigned kMostAsked = 24;  // where no points are far off floats have no more
    require(
        options.position_bits >= LevelRounding::kLeastBits && options.position_bits <= kMostAsked,
        "tiles: position_bits", options.position_bits, "2..24");
    if (options.precision) {
        require(makes_steps(*options.precision), "tiles: precision", *options.precision,
                "a finite length above 0");
    }
    require(options.tolerance >= 0, "tiles: tolerance", options.tolerance, "at least 0");
    require(options.max_points >= 1 && options.max_points <= kMostPoints, "tiles: max_points",
            options.max_points, "1..65536");
}

/// All in the source's frame, but what is told of tiles.
struct LodTiler::State {
    LodTileOptions options;
    Aabb box;      ///< of the source
    Vec3d middle;  ///< of that
    ErrorFrame frame;
    TileContents contents;
    std::vector<Index> order;  ///< of the source's points, along a curve
    LevelMeter meter;
    LevelRounding rounding;
    TileTree tree;
    unsigned levels = 0;
    std::uint64_t had = 0;  ///< points of the level before, where tiles are additive
    LodFigures figures;
    double level_spacing = 0;  ///< before rounding
    std::optional<SurfaceError> level_error;

    /// Mean distance from a point to the nearest other, in the unit of the input; where most have
    /// others at their places, from place to place, 0 of one place alone.
    /// @param point_at  in the order of a curve. @param asked  how many points tell it.
    /// @param all  of the points, and perhaps of others.
    template <typename PointAt>
    double spacing_of(std::size_t count, PointAt&& point_at, const PointTree& all,
                      std::size_t asked, const RunContext& context) const {
        double gap = 0;
        if (!is_crowd(count, point_at)) gap = mean_gap(all, count, asked, point_at);
        if (gap > 0) return gap / frame.scale;
        std::vector<Vec3f> places(count);
        for (std::size_t i = 0; i < count; ++i) places[i] = point_at(i);
        std::ranges::sort(places, [](const Vec3f& a, const Vec3f& b) {
            return std::ranges::lexicographical_compare(a, b);
        });
        const auto others = std::ranges::unique(places);
        places.erase(others.begin(), others.end());
        if (places.size() == 1) return 0;
        const PointTree apart(places, PointTree::Leaves::Loose, context);
        return mean_gap(apart, places.size(), asked, [&](std::size_t i) { return places[i]; }) /
               frame.scale;
    }

    /// That of all points of a level. @param known  their tree; none: it is made.
    double spacing_of(std::span<const Vec3f> points, const PointTree* known,
                      const RunContext& context) const {
        constexpr std::size_t kAsked = 512;  // within 6 % of that of all points on five scans
        const auto point_at = [points](std::size_t i) { return points[i]; };
        if (known) return spacing_of(points.size(), point_at, *known, kAsked, context);
        const PointTree made(points, PointTree::Leaves::Given, context);
        return spacing_of(points.size(), point_at, made, kAsked, context);
    }

    /// From the source, as far as the diagonals and `unrounded` tell; none: it is the source.
    SurfaceError error_of(const PointCloud& level, MeasuredLevel* unrounded,
                          const RunContext& context) {
        SurfaceError error;
        if (unrounded != nullptr) {
            meter.measure_at_some(*unrounded, context);
            error = meter.error_of(*unrounded, frame, context);
        }
        error.diagonal = box.diagonal();
        error.candidate_diagonal = bounds(level).diagonal();
        return error;
    }

    /// @param points  of the level, in order; none: it is the source, as it is measured.
    /// @param grid  the finest; becomes the one that is taken.
    MeasuredLevel rounded_level(const PointCloud& cloud, std::vector<Vec3f>&& points, bool whole,
                                LevelGrid& grid, const RunContext& context) {
        const bool as_measured = points.empty();
        const bool is_precise = options.precision && options.finest_points == cloud.size();
        const bool all_bits = whole || options.additive || is_precise;
        const auto at_finest = [&](const std::vector<Vec3f>& all) {
            return MeasuredLevel(rounded(all, grid, context), context);
        };
        if (as_measured) {
            level_spacing = spacing_of(meter.source(), &meter.surface(context)->tree, context);
            if (options.level_errors) level_error = error_of(cloud, nullptr, context);
            meter.forget_surface();  // no level comes after
            return at_finest(meter.source());
        }
        if (all_bits && !options.level_errors) {
            level_spacing = spacing_of(points, nullptr, context);
            return at_finest(points);
        }
        MeasuredLevel unrounded(std::move(points), context);
        level_spacing = spacing_of(unrounded.points, unrounded.tree.get(), context);
        // Before there is the rounded one, too.
        if (options.level_errors) level_error = error_of(cloud, &unrounded, context);
        if (!all_bits) return rounding.round(std::move(unrounded), grid, meter, context);
        unrounded.tree.reset();
        return at_finest(unrounded.points);
    }

    /// What some samples say.
    struct Inside {
        std::vector<float> distances, areas;
        float cover = 0;

        void add(float distance, float area, float cover_) {
            distances.push_back(distance);
            areas.push_back(area);
            cover = std::max(cover, cover_);
        }
    };
    void take(std::span<const float> distances, std::span<const float> areas, float cover,
              LodFigures& into) const {
        const AttributeError error = summarize("", distances, areas);
        const double p99 = weighted_quantiles(distances, areas, std::array{0.99}).front();
        into.error = {
            .mean = error.mean / frame.scale,
            .max = error.max / frame.scale,
            .p99 = p99 / frame.scale,
            .mean_confidence = mean_confidence(distances, areas, error.mean) / frame.scale,
            .samples = distances.size()};
        into.cover_radius = cover / frame.scale;
    }

    /// The samples in the cell of each part of the level.
    std::vector<Inside> in_parts(std::size_t parts, const MeasuredLevel& level,
                                 const RunContext& context) const {
        std::vector<std::uint32_t> part_of(level.places.size());
        parallel_for_blocks(
            part_of.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
                for (std::size_t i = begin; i < end; ++i)
                    part_of[i] = tree.part_at(meter.places().positions[level.places[i]]);
            });
        std::vector<Inside> inside(parts);
        for (std::size_t i = 0; i < part_of.size(); ++i) {
            if (part_of[i] != TileTree::kNone)
                inside[part_of[i]].add(level.distances[i], level.areas[i], level.covers[i]);
        }
        return inside;
    }

    /// Of the whole level; and of each part by the samples in its cell, or as of the level where
    /// these have no area.
    void add_errors(std::span<LodTile> tiles, const MeasuredLevel& level, const LevelGrid& grid,
                    const RunContext& context) {
        take(level.distances, level.areas, std::ranges::max(level.covers), figures);
        const auto as_level = [&](LodTile& tile) {
            static_cast<LodFigures&>(tile) = {figures.error, tile.spacing, figures.cover_radius};
        };
        if (!tree.is_cut()) {
            as_level(tiles.front());
        } else {
            const std::vector<Inside> inside = in_parts(tiles.size(), level, context);
            parallel_for_blocks(tiles.size(), 1, context, [&](std::size_t t, std::size_t) {
                const auto& [distances, areas, cover] = inside[t];
                if (std::ranges::any_of(areas, [](float area) { return area > 0; }))
                    take(distances, areas, cover, tiles[t]);
                else
                    as_level(tiles[t]);
            });
        }
        // Of all points down to the level, of which additive tiles hold but the new ones. Short
        // steps hardly change it.
        constexpr double kShort = 0.125;
        const bool is_fine = grid.step / frame.scale <= kShort * level_spacing;
        figures.spacing =
            is_fine ? level_spacing : spacing_of(level.points, level.tree.get(), context);
        const bool is_level = tiles.size() == 1 && !options.additive;
        if (is_level) tiles.front().spacing = figures.spacing;
    }

    /// What the tiles of one thread are made in.
    struct Workbench {
        std::vector<GridPoint> points, sorted;
        std::vector<Index> numbers;
        BlockChain chain;
        VertexEncoder encoder;
        RunContext context{.threads = 1};
    };

    /// Sorts and compresses the points of a part.
    /// @param numbers  of the level's points, in the cloud.
    /// @param asked  how many points tell the spacing.
    void encode(LodTile& tile, const PointCloud& cloud, std::span<const Index> members,
                std::span<const Index> numbers, const MeasuredLevel& level,
                const LevelGrid& grid_taken, std::size_t asked, Workbench& at) const {
        Vec3f low = level.points[members.front()];
        for (const Index i : members) low = low.cwiseMin(level.points[i]);
        std::array<std::int32_t, 3> least;
        for (int axis = 0; axis < 3; ++axis) least[axis] = grid_taken.at(low[axis]);
        at.points.resize(members.size());
        GridPoint last{};
        for (std::size_t i = 0; i < members.size(); ++i) {
            const Vec3f& p = level.points[members[i]];
            GridPoint point;
            for (int axis = 0; axis < 3; ++axis) {
                point[axis] = static_cast<std::uint16_t>(grid_taken.at(p[axis]) - least[axis]);
                last[axis] = std::max(last[axis], point[axis]);
            }
            at.points[i] = point;
        }
        tile.last = last;
        const std::span<const Index> chain = at.chain.order(at.points);
        at.sorted.resize(chain.size());
        for (std::size_t i = 0; i < chain.size(); ++i) at.sorted[i] = at.points[chain[i]];
        at.numbers.clear();
        if (!cloud.normals.empty() || !cloud.colors.empty() || !cloud.attributes.empty())
            for (const Index i : chain) at.numbers.push_back(numbers[members[i]]);
        tile.points = members.size();
        tile.bits = grid_taken.bits;
        tile.step = grid_taken.step / frame.scale;
        const Vec3d shift = frame.center - middle;
        for (int axis = 0; axis < 3; ++axis)
            tile.offset[axis] = static_cast<double>(least[axis]) * tile.step + shift[axis];
        const auto point_at = [&](std::size_t i) { return level.points[members[i]]; };
        // A tile of points in the air is no sparse part of the surface.
        constexpr double kMostSpacings = 8;
        tile.spacing =
            std::min(spacing_of(members.size(), point_at, *level.tree, asked, at.context),
                     kMostSpacings * std::max(level_spacing, tile.step));
        tile.streams = encode_streams(cloud, at.numbers, at.sorted, contents, at.encoder);
    }
};

LodTiler::LodTiler(const PointCloud& source, const LodTileOptions& options,
                   const RunContext& context)
    : state_(std::make_unique<State>()) {
    validate(options);
    require_cleaned(source);
    if (source.empty()) refuse("the cloud has no points: expected at least 1");
    State& state = *state_;
    state.options = options;
    state.box = bounds(source);
    state.middle = 0.5 * (state.box.min + state.box.max);
    state.frame = ErrorFrame(state.box, source);
    state.contents = TileContents(source, options.attributes);
    state.rounding = {.side = (state.box.max - state.box.min).maxCoeff() * state.frame.scale,
                      .tolerance = options.tolerance,
                      .position_bits = options.position_bits};
    const double side_of_most =
        longest_side(box_of_most(
            some_of(source.size(),
                    [&](std::size_t i) { return Vec3d(source.positions[i].cast<double>()); }))) *
        state.frame.scale;
    if (side_of_most > 0 && state.rounding.side > kFarOffGrid * side_of_most)
        state.rounding.side_of_most = side_of_most;
    if (options.precision) {
        const double side = (state.box.max - state.box.min).maxCoeff();
        const double moved =
            rounding_of_reading(source) + state.frame.rounding_of(state.box, source);
        const double left = precision_left(*options.precision, moved, side);
        const double least = state.rounding.least_precision() / state.frame.scale;
        if (left < least)
            refuse("precision ", *options.precision, ": expected at least ", moved + least,
                   ", which tiles of a cloud as wide as this one can have");
        state.rounding.precision = left * state.frame.scale;
    }

    state.order = hilbert_order(source.positions, context);
    context.checkpoint(0.2);
    std::vector<Vec3f> points = state.frame.into(source, state.order, context);
    context.checkpoint(0.3);
    state.meter = LevelMeter(std::move(points), options.errors, context.part(0.3, 1));
    state.meter.forget_surface();  // while levels are made
}

LodTiler::~LodTiler() = default;

const Vec3d& LodTiler::center() const noexcept {
    return state_->middle;
}

std::span<const Index> LodTiler::order() const noexcept {
    return state_->order;
}

const LodFigures& LodTiler::figures() const noexcept {
    return state_->figures;
}

double LodTiler::level_spacing() const noexcept {
    return state_->level_spacing;
}

const std::optional<SurfaceError>& LodTiler::level_error() const noexcept {
    return state_->level_error;
}

void LodTiler::restart() {
    state_->tree = {};
    state_->levels = 0;
    state_->had = 0;
}

std::vector<LodTile> LodTiler::add_level(const PointCloud& cloud, bool whole,
                                         const RunContext& context,
                                         std::span<const Index> known_order) {
    if (cloud.empty()) refuse("the level has no points: expected at least 1");
    State& state = *state_;
    const bool additive = state.options.additive;
    require(!additive || cloud.size() > state.had, "points of a level", cloud.size(),
            "more than the level before");
    check_order(known_order, cloud);
    const bool as_measured = whole && !additive;
    std::vector<Index> found_order;
    std::vector<Vec3f> own_points;
    if (!as_measured) {
        if (known_order.empty()) found_order = hilbert_order(cloud.positions, context);
        own_points =
            state.frame.into(cloud, known_order.empty() ? found_order : known_order, context);
    }
    const std::span<const Index> order = as_measured           ? std::span(state.order)
                                         : known_order.empty() ? found_order
                                                               : known_order;
    context.checkpoint(0.1);
    LevelGrid grid = state.rounding.finest_grid(state.meter);
    MeasuredLevel level = state.rounded_level(cloud, std::move(own_points), whole, grid, context);
    context.checkpoint(0.3);
    state.meter.measure_well(level, context);
    context.checkpoint(0.4);

    constexpr double kMostSteps = 65'534;
    const std::vector<TileTree::Part> parts =
        cut_level(state.tree, level.points, order, state.had,
                  {state.options.max_points, static_cast<float>(kMostSteps * grid.step)}, context);
    if (state.tree.part_count() > LodTiler::kMostTiles) {
        throw Error(ErrorCode::TooLarge,
                    "the pyramid has " + std::to_string(state.tree.part_count()) +
                        " tiles or more, with max_points " +
                        std::to_string(state.options.max_points) + " and position_bits " +
                        std::to_string(grid.bits) + ": expected at most " +
                        std::to_string(LodTiler::kMostTiles) +
                        "; allow more points per tile, or fewer bits");
    }
    context.checkpoint(0.5);
    std::vector<LodTile> tiles(parts.size());
    const std::size_t asked = std::max(kAskedForGap / parts.size(), kAskedForGap / 4);
    // Some at one bench, and yet enough to do for each thread.
    const std::size_t threads = context.thread_count();
    const std::size_t together = std::max<std::size_t>(1, parts.size() / (threads * threads));
    parallel_for_blocks_with_progress(
        parts.size(), together, context.part(0.5, 0.9), [&](std::size_t begin, std::size_t end) {
            State::Workbench bench;
            for (std::size_t t = begin; t < end; ++t) {
                context.throw_if_stopped();
                tiles[t].level = state.levels;
                if (parts[t].parent != TileTree::kNone) tiles[t].parent = parts[t].parent;
                state.encode(tiles[t], cloud, parts[t].points, order, level, grid, asked, bench);
            }
        });
    context.checkpoint(0.9);
    state.add_errors(tiles, level, grid, context);
    ++state.levels;
    if (additive) state.had = cloud.size();
    context.checkpoint(1);
    return tiles;
}

}  // namespace stipple
