#include "stipple/lod_tiles.hpp"

#include "chain_order.hpp"
#include "distance_statistics.hpp"
#include "error_samples.hpp"
#include "first_touch.hpp"
#include "foot_finder.hpp"
#include "hilbert_order.hpp"
#include "leaf_shapes.hpp"
#include "point_tree.hpp"
#include "progress_for.hpp"
#include "sample_rounds.hpp"
#include "stipple/error.hpp"
#include "surface_rounding.hpp"
#include "tile_streams.hpp"
#include "tile_tree.hpp"
#include "tree_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <string>
#include <utility>

namespace stipple {

namespace {

constexpr unsigned kLeastBits = 2, kMostBits = 24;
constexpr std::uint32_t kMostPoints = 65'536;  // a tile is sorted without a look at the stop token
constexpr std::size_t kBlock = 8'192;

template <typename T>
[[noreturn]] void refuse(const char* name, T value, const char* expected) {
    std::ostringstream text;
    text << name << ' ' << value << ": expected " << expected;
    throw Error(ErrorCode::InvalidArgument, text.str());
}

/// A grid through the middle of the source's box.
struct Grid {
    double step;
    unsigned bits;
    double steps = 1 / step;  ///< of a unit

    std::int32_t at(float coordinate) const noexcept {
        // Of a number above 0 the whole part is what conversion leaves.
        constexpr std::int32_t kAbove = 1 << 30;
        return static_cast<std::int32_t>(static_cast<double>(coordinate) * steps + (kAbove + 0.5)) -
               kAbove;
    }
    Vec3f rounded(const Vec3f& p) const noexcept {
        Vec3f q;
        for (int axis = 0; axis < 3; ++axis) q[axis] = static_cast<float>(at(p[axis]) * step);
        return q;
    }
};

/// @param normals  of the surface, where they are known.
std::vector<Vec3f> rounded(std::span<const Vec3f> points, std::span<const Vec3f> normals,
                           const Grid& grid, const RunContext& context) {
    auto decoded = made_in_blocks<std::vector<Vec3f>>(points.size(), context);
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        if (normals.empty()) {
            for (std::size_t i = begin; i < end; ++i) decoded[i] = grid.rounded(points[i]);
            return;
        }
        round_to_surface(points.subspan(begin, end - begin), normals.subspan(begin, end - begin),
                         grid.step, &decoded[begin]);
    });
    return decoded;
}

constexpr unsigned kLeastRounds = 8;  // that there are

/// One place for 128 points.
unsigned rounds_for(std::uint64_t points, unsigned least) {
    constexpr std::uint64_t kPoints = 128 * SampleRounds::kRound;
    return static_cast<unsigned>(std::clamp<std::uint64_t>((points + kPoints - 1) / kPoints, least,
                                                           SampleRounds::kMostRounds));
}

constexpr std::uint64_t kMany = 40'000;  // points of a source

/// Places on the surface of the source, as `measure_error` takes them: at points, where there are
/// many.
ErrorSamples take_samples(std::span<const Vec3f> points, const PointTree& tree, std::uint64_t count,
                          std::uint64_t seed, const RunContext& context) {
    if (points.size() >= kMany) return take_points_by_area(tree, count, seed, context);
    return take_surface(tree, FootFinder(points, tree, {}), count, seed, context);
}

constexpr std::size_t kAsked = 256;

/// Mean distance from about `asked` of `count` points of a tree, point_at(i), to the nearest other.
template <typename PointAt>
double mean_gap(const PointTree& tree, std::size_t count, std::size_t asked, PointAt&& point_at) {
    const std::size_t step = std::max<std::size_t>(1, count / asked);
    double sum = 0;
    std::size_t answers = 0;
    for (std::size_t i = 0; i < count; i += step, ++answers) {
        std::array<Neighbor, 2> room;
        const auto found = find_nearest(tree, point_at(i), room);
        sum += std::sqrt(static_cast<double>(found.back().distance_sq));
    }
    return sum / static_cast<double>(answers);
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

/// Points of a level, in the order of a curve, and how far the source is from their surface.
struct Measured {
    std::vector<Vec3f> points;
    std::unique_ptr<PointTree> tree;
    std::vector<Index> places;     ///< numbers of those where it is measured, ascending
    std::vector<float> distances;  ///< of each
    std::vector<float> covers;     ///< from each to the nearest point
    std::vector<float> areas;      ///< that each stands for
    double mean = 0;
};

}  // namespace

void validate(const LodTileOptions& options) {
    if (options.position_bits < kLeastBits || options.position_bits > kMostBits)
        refuse("tiles: position_bits", options.position_bits, "2..24");
    if (options.precision && !(*options.precision > 0 && std::isfinite(*options.precision)))
        refuse("tiles: precision", *options.precision, "a finite length above 0");
    if (!(options.tolerance >= 0)) refuse("tiles: tolerance", options.tolerance, "at least 0");
    if (options.max_points == 0 || options.max_points > kMostPoints)
        refuse("tiles: max_points", options.max_points, "1..65536");
}

/// All in a frame where the middle of the source's box lies at 0 and its longest side is between 1
/// and 2: scaled by a power of two, so that nothing is lost on the way there and back.
struct LodTiler::State {
    LodTileOptions options;
    Vec3d center = Vec3d::Zero();
    double scale = 1;
    double side = 0;            ///< of the source's box, the longest
    double spacing = 0;         ///< of the source
    std::vector<Index> order;   ///< of the source's points, along a curve
    std::vector<Vec3f> source;  ///< those, in that order
    SampleRounds places;
    TileTree tree;
    unsigned levels = 0;
    unsigned rounds = 0;    ///< of places that the level before was measured at
    std::uint64_t had = 0;  ///< points of the level before, where tiles are additive
    LodFigures figures;

    std::vector<Vec3f> into_frame(const PointCloud& cloud, std::span<const Index> numbers,
                                  const RunContext& context) const {
        constexpr std::size_t kAhead = 16;  // that far the memory is asked for in advance
        const Vec3d shift = cloud.origin - center;
        auto points = made_in_blocks<std::vector<Vec3f>>(numbers.size(), context);
        parallel_for_blocks(
            points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
                for (std::size_t i = begin; i < end; ++i) {
                    __builtin_prefetch(&cloud.positions[numbers[std::min(i + kAhead, end - 1)]]);
                    const Vec3d p = cloud.positions[numbers[i]].cast<double>();
                    points[i] = (scale * (p + shift)).cast<float>();
                }
            });
        return points;
    }

    Grid grid(unsigned bits) const {
        if (side == 0) return {1, bits};
        return {side / static_cast<double>((std::uint64_t{1} << bits) - 2), bits};
    }
    Grid finest_grid() const {
        if (!options.precision || side == 0) {
            // With longer steps than the spacing the points of one part would fall into one place.
            const unsigned apart = spacing > 0 ? bits_for(spacing, kMostBits) : 0;
            return grid(std::max(options.position_bits, apart));
        }
        const double step = 2 * *options.precision * scale;
        const double bits = std::ceil(std::log2(side / step + 2));
        if (bits > kMostBits) return grid(kMostBits);
        return {step, static_cast<unsigned>(std::max<double>(bits, kLeastBits))};
    }

    static Measured with_tree(std::vector<Vec3f>&& points, const RunContext& context) {
        Measured made;
        made.points = std::move(points);
        made.tree = std::make_unique<PointTree>(made.points, PointTree::Leaves::Given, context);
        return made;
    }
    /// At the places of so many rounds, of which it may have been measured at some.
    void measure(Measured& level, unsigned at_rounds, const RunContext& context) const {
        const std::vector<Index> known_places = std::exchange(level.places, {});
        const std::vector<float> distances = std::exchange(level.distances, {});
        const std::vector<float> covers = std::exchange(level.covers, {});
        level.places = places.of_first(at_rounds);
        const std::size_t count = level.places.size();
        level.distances.resize(count);
        level.covers.resize(count);
        level.areas.resize(count);
        std::vector<Vec3f> others;
        std::vector<Index> number_of;
        for (std::size_t i = 0, known = 0; i < count; ++i) {
            const Index place = level.places[i];
            level.areas[i] = places.all().areas[place];
            if (known < known_places.size() && known_places[known] == place) {
                level.distances[i] = distances[known];
                level.covers[i] = covers[known++];
            } else {
                others.push_back(places.all().positions[place]);
                number_of.push_back(static_cast<Index>(i));
            }
        }
        FootFinder(level.points, *level.tree, {.across_sample = true})
            .find(
                others,
                [&](std::size_t i, const Foot& foot) {
                    level.distances[number_of[i]] = static_cast<float>(foot.distance);
                    level.covers[number_of[i]] = static_cast<float>(foot.to_sample);
                },
                context);
        level.mean = summarize("", level.distances, level.areas).mean;
    }

    /// At one place for 128 points, and at more for this level and those after it while chance
    /// would decide: of as many rounds as the spread of those that there are calls for.
    void measure_well(Measured& level, const RunContext& context) {
        constexpr double kSure = 0.0145;
        constexpr unsigned kLeast = 2;
        rounds = std::max(
            rounds, rounds_for(level.points.size(), source.size() < kMany ? kLeastRounds : kLeast));
        for (;;) {
            add_places(rounds, context);
            measure(level, rounds, context);
            const double wanted = kSure * level.mean;
            const double unsure = mean_confidence(level.distances, level.areas, level.mean);
            if (unsure <= wanted || rounds == SampleRounds::kMostRounds) return;
            const double needed = rounds * (unsure / wanted) * (unsure / wanted);
            rounds = static_cast<unsigned>(
                std::clamp<double>(std::ceil(needed), rounds + 1, SampleRounds::kMostRounds));
        }
    }

    /// Until there are so many rounds of places.
    void add_places(unsigned at_least, const RunContext& context) {
        if (places.rounds() >= at_least) return;
        const PointTree of_source(source, PointTree::Leaves::Given, context);
        while (places.rounds() < at_least) {
            const unsigned so_far = places.rounds(),
                           more = std::min(so_far, SampleRounds::kMostRounds - so_far);
            places.add(take_samples(source, of_source, more * SampleRounds::kRound,
                                    so_far * SampleRounds::kRound, context),
                       more);
        }
    }

    /// Of the surface at the points of a level; none where there are too many to be worth the time:
    /// those who load them have waited already.
    static std::vector<Vec3f> normals_of(const Measured& level, const RunContext& context) {
        constexpr std::size_t kMost = 131'072;
        if (level.points.size() > kMost) return {};
        constexpr unsigned kNeighbors = 12;
        constexpr std::size_t kLeaves = 128;
        const std::size_t others = level.points.size() - 1;
        std::vector<Vec3f> normals(level.points.size(), Vec3f::UnitZ());
        if (others == 0) return normals;
        const PointTree& tree = *level.tree;
        const auto k = static_cast<unsigned>(std::min<std::size_t>(kNeighbors, others));
        parallel_for_blocks(tree.leaf_count(), kLeaves, context,
                            [&](std::size_t begin, std::size_t end) {
                                LeafShapes shapes(tree, level.points, {k});
                                for (std::size_t l = begin; l < end; ++l) {
                                    shapes.run(l);
                                    for (std::size_t lane = 0; lane < tree.points_in(l); ++lane)
                                        normals[tree.leaf(l).index[lane]] =
                                            shapes.shape(0, lane).normal.cast<float>();
                                }
                            });
        return normals;
    }

    /// The fewest bits by which the mean error grows by no more than the tolerance, and by which
    /// points stay apart: two steps to a spacing.
    Measured round_level(const std::vector<Vec3f>& points, Grid& grid_taken,
                         const RunContext& context) const {
        const double tolerance = options.tolerance;
        const Grid finest = finest_grid();
        // Enough to compare two roundings of the same points.
        const unsigned few = (rounds_for(source.size(), kLeastRounds) - 1) / kLeastRounds + 1;
        const auto measured = [&](std::vector<Vec3f>&& level) {
            Measured made = with_tree(std::move(level), context);
            measure(made, few, context);
            return made;
        };
        const Measured unrounded = measured(std::vector<Vec3f>(points));
        const double exact = unrounded.mean;
        const std::vector<Vec3f> normals = normals_of(unrounded, context);
        const auto try_bits = [&](unsigned bits) {
            return measured(rounded(points, normals, grid(bits), context));
        };
        // The variance of what rounding adds, in squared steps, once the surface's fit has smoothed
        // it: measured.
        const double added = normals.empty() ? 0.025 : 0.0025;
        const double limit = (1 + tolerance) * exact;
        const unsigned least = bits_for(0.5 * mean_gap(*unrounded.tree, points.size(), kAsked,
                                                       [&](std::size_t i) { return points[i]; }),
                                        finest.bits);
        const auto at_finest = [&] {
            grid_taken = finest;
            return with_tree(rounded(points, normals, finest, context), context);
        };
        const unsigned wanted = bits_for(exact * std::sqrt(2 * tolerance / added), kMostBits);
        // Many points take a while to be measured with a bit less, which here is hopeless.
        if (wanted > finest.bits && exact > 0 && normals.empty()) return at_finest();
        unsigned bits = std::max(least, std::min(wanted, finest.bits - 1));
        Measured taken = try_bits(bits);
        if (taken.mean <= limit) {
            // A bit less doubles the steps: four times the variance, and three times what it adds
            // to the mean at least.
            constexpr double kAtLeast = 3;
            while (bits > least && exact + kAtLeast * (taken.mean - exact) <= limit) {
                Measured fewer = try_bits(bits - 1);
                if (fewer.mean > limit) break;
                taken = std::move(fewer);
                --bits;
            }
        } else {
            while (taken.mean > limit && ++bits < finest.bits) taken = try_bits(bits);
        }
        if (bits >= finest.bits) return at_finest();
        grid_taken = grid(bits);
        return taken;
    }

    /// For steps no longer than `step`, from 2 to `most`.
    unsigned bits_for(double step, unsigned most) const {
        if (!(step > 0)) return most;
        const double bits = std::ceil(std::log2(side / step + 2));
        return static_cast<unsigned>(std::clamp<double>(bits, kLeastBits, most));
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
        into.error = {.mean = error.mean / scale,
                      .max = error.max / scale,
                      .p99 = p99 / scale,
                      .mean_confidence = mean_confidence(distances, areas, error.mean) / scale,
                      .samples = distances.size()};
        into.cover_radius = cover / scale;
    }

    /// The samples in the cell of each part of the level.
    std::vector<Inside> in_parts(std::size_t parts, const Measured& level,
                                 const RunContext& context) const {
        std::vector<std::uint32_t> part_of(level.places.size());
        parallel_for_blocks(
            part_of.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
                for (std::size_t i = begin; i < end; ++i)
                    part_of[i] = tree.part_at(places.all().positions[level.places[i]]);
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
    void add_errors(std::span<LodTile> tiles, const Measured& level, const RunContext& context) {
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
        figures.spacing = 0;
        std::uint64_t points = 0;
        for (const LodTile& tile : tiles) {
            figures.spacing += tile.spacing * static_cast<double>(tile.points);
            points += tile.points;
        }
        figures.spacing /= static_cast<double>(points);
    }

    /// What the tiles of one thread are made in.
    struct Workbench {
        std::vector<GridPoint> points, sorted;
        std::vector<Index> numbers;
        BlockChain chain;
        VertexEncoder encoder;
    };

    /// Sorts and compresses the points of a part.
    /// @param numbers  of the level's points, in the cloud.
    /// @param asked  how many points tell the spacing.
    void encode(LodTile& tile, const PointCloud& cloud, std::span<const Index> members,
                std::span<const Index> numbers, const Measured& level, const Grid& grid_taken,
                std::size_t asked, Workbench& at) const {
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
        tile.step = grid_taken.step / scale;
        for (int axis = 0; axis < 3; ++axis)
            tile.offset[axis] = static_cast<double>(least[axis]) * tile.step;
        tile.spacing = mean_gap(*level.tree, members.size(), asked,
                                [&](std::size_t i) { return level.points[members[i]]; }) /
                       scale;
        tile.streams = encode_streams(cloud, at.numbers, at.sorted, options.attributes, at.encoder);
    }
};

LodTiler::LodTiler(const PointCloud& source, const LodTileOptions& options,
                   const RunContext& context)
    : state_(std::make_unique<State>()) {
    validate(options);
    if (source.empty())
        throw Error(ErrorCode::InvalidArgument, "the cloud has no points: expected at least 1");
    State& state = *state_;
    state.options = options;
    const Aabb box = bounds(source);
    state.center = 0.5 * (box.min + box.max);
    const double side = (box.max - box.min).maxCoeff();
    if (side > 0) state.scale = std::ldexp(1.0, -std::ilogb(side));
    state.side = side * state.scale;

    state.order = hilbert_order(source.positions, context);
    context.checkpoint(0.2);
    state.source = state.into_frame(source, state.order, context);
    context.checkpoint(0.3);
    const std::vector<Vec3f>& points = state.source;
    const PointTree tree(points, PointTree::Leaves::Given, context);
    context.checkpoint(0.6);
    state.spacing = mean_gap(tree, points.size(), kAsked, [&](std::size_t i) { return points[i]; });
    const unsigned rounds = rounds_for(points.size(), kLeastRounds);
    state.places.add(take_samples(points, tree, rounds * SampleRounds::kRound, 0, context), rounds);
}

LodTiler::~LodTiler() = default;

const Vec3d& LodTiler::center() const noexcept {
    return state_->center;
}

std::span<const Index> LodTiler::order() const noexcept {
    return state_->order;
}

const LodFigures& LodTiler::figures() const noexcept {
    return state_->figures;
}

void LodTiler::restart() {
    state_->tree = {};
    state_->levels = 0;
    state_->had = 0;
    state_->rounds = 0;
}

std::vector<LodTile> LodTiler::add_level(const PointCloud& cloud, bool whole,
                                         const RunContext& context,
                                         std::span<const Index> known_order) {
    if (cloud.empty())
        throw Error(ErrorCode::InvalidArgument, "the level has no points: expected at least 1");
    State& state = *state_;
    const bool additive = state.options.additive;
    if (additive && cloud.size() <= state.had)
        refuse("points of a level", cloud.size(), "more than the level before");
    if (!known_order.empty() && known_order.size() != cloud.size())
        refuse("points of an order", known_order.size(), "all of the level");
    const bool as_measured = whole && !additive;
    std::vector<Index> found_order;
    std::vector<Vec3f> own_points;
    if (!as_measured) {
        if (known_order.empty()) found_order = hilbert_order(cloud.positions, context);
        own_points =
            state.into_frame(cloud, known_order.empty() ? found_order : known_order, context);
    }
    const std::span<const Index> order = as_measured           ? std::span(state.order)
                                         : known_order.empty() ? found_order
                                                               : known_order;
    const std::vector<Vec3f>& points = as_measured ? state.source : own_points;
    context.checkpoint(0.1);
    Grid grid = state.finest_grid();
    Measured level = whole || additive
                         ? State::with_tree(rounded(points, {}, grid, context), context)
                         : state.round_level(points, grid, context);
    context.checkpoint(0.3);
    state.measure_well(level, context);
    context.checkpoint(0.4);

    constexpr double kMostSteps = 65'534;
    const std::vector<TileTree::Part> parts =
        cut_level(state.tree, level.points, order, state.had,
                  {state.options.max_points, static_cast<float>(kMostSteps * grid.step)}, context);
    context.checkpoint(0.5);
    std::vector<LodTile> tiles(parts.size());
    const std::size_t asked = std::max(kAsked / parts.size(), kAsked / 4);
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
    state.add_errors(tiles, level, context);
    ++state.levels;
    if (additive) state.had = cloud.size();
    context.checkpoint(1);
    return tiles;
}

}  // namespace stipple
