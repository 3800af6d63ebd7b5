#include "pyramid/level_meter.hpp"

#include "base/distance_statistics.hpp"
#include "error/error_estimate.hpp"
#include "error/error_samples.hpp"
#include "error/foot_distance.hpp"
#include "error/foot_finder.hpp"
#include "neighbors/gaps.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <utility>

namespace stipple {

namespace {

constexpr unsigned kGlance = 1;    // rounds that tell which rounding is much too coarse
constexpr unsigned kRough = 2;     // of rough errors
constexpr unsigned kSome = 4;      // that tell two roundings of the same points apart
constexpr unsigned kMostly = 16;   // that scans of surfaces need
constexpr unsigned kOfSmall = 32;  // of a small source

/// To measure a level of so many points by: one place for 128 of them at least.
unsigned rounds_for(std::uint64_t points) {
    constexpr std::uint64_t kOfRound = 128 * SampleRounds::kRound;
    return static_cast<unsigned>(std::clamp<std::uint64_t>((points + kOfRound - 1) / kOfRound, 8,
                                                           SampleRounds::kMostRounds));
}

/// Where errors are sure, rounds that are drawn at once: as many as scans with much noise need,
/// where looking at all leaves takes little time. A power of two is best: the places of the first
/// rounds then lie evenly among all.
unsigned drawn_rounds(const PointTree& tree, unsigned least) {
    constexpr unsigned kOfNoisy = 64;
    constexpr std::uint64_t kFewLeaves = 400'000;
    return tree.leaf_count() < kFewLeaves ? std::max(least, kOfNoisy) : least;
}

}  // namespace

MeasuredLevel::MeasuredLevel(std::vector<Vec3f>&& points_, const RunContext& context)
    : points(std::move(points_)) {
    // In a crowd at one place every search for the nearest few looks at all of it.
    if (is_crowd(points.size(), [&](std::size_t i) -> const Vec3f& { return points[i]; }))
        std::ranges::unique_copy(points, std::back_inserter(apart));
    tree = std::make_unique<PointTree>(samples(), PointTree::Leaves::Given, context);
}

LevelMeter::LevelMeter(std::vector<Vec3f>&& source, LodErrors errors, const RunContext& context)
    : points_(std::move(source)), errors_(errors) {
    const auto made = surface(context);
    context.checkpoint(0.5);
    const std::vector<Vec3f>& points = made->points;
    spacing_ = median_gap(made->tree);
    const bool is_small = points.size() < kEnoughSamples;
    const unsigned likely = std::max(kMostly, rounds_for(points.size()));
    draw(errors_ == LodErrors::Rough ? kRough
         : is_small                  ? kOfSmall
                    : std::min(std::bit_floor(most_rounds()), drawn_rounds(made->tree, likely)),
         context);
    const unsigned needed = errors_ == LodErrors::Sure ? likely : kSome;
    need_places(std::min(needed, places_.rounds()), context);
    if (!is_exact()) return;
    constexpr std::uint64_t kEvery = SampleRounds::kMostRounds * SampleRounds::kRound;
    every_.add(is_small ? take_surface(lone_points(context), made->finder, kEvery, 0, context)
                        : take_points(lone_points(context), points.size(), 0, context),
               1);
}

std::shared_ptr<const FramedSurface> LevelMeter::surface(const RunContext& context) {
    if (!surface_)
        surface_ = std::make_shared<FramedSurface>(std::move(points_), PointTree::Leaves::Given,
                                                   FootFinder::Options{}, context);
    return surface_;
}

const LonePoints& LevelMeter::lone_points(const RunContext& context) {
    const auto of = surface(context);
    if (!lone_points_) lone_points_ = std::make_unique<LonePoints>(of->points, of->tree);
    return *lone_points_;
}

void LevelMeter::forget_surface() {
    lone_points_.reset();
    if (surface_) points_ = std::move(surface_->points);
    surface_.reset();
}

void LevelMeter::glance(MeasuredLevel& level, const RunContext& context) const {
    measure(level, places_, kGlance, context);
}

double LevelMeter::mean_at_a_glance(const MeasuredLevel& level) const {
    const std::vector<Index> glanced = places_.of_first(kGlance);
    std::vector<float> distances, areas;
    auto next = glanced.begin();  // both are in the order of the curve
    for (std::size_t i = 0; i < level.places.size() && next != glanced.end(); ++i) {
        if (level.places[i] != *next) continue;
        distances.push_back(level.distances[i]);
        areas.push_back(level.areas[i]);
        ++next;
    }
    return summarize("", distances, areas).mean;
}

void LevelMeter::measure_at_some(MeasuredLevel& level, const RunContext& context) const {
    measure(level, places_, std::min(kSome, places_.rounds()), context);
}

/// No more places than points of which they are drawn.
unsigned LevelMeter::most_rounds() const noexcept {
    const std::uint64_t points = source().size();
    if (points < kEnoughSamples) return SampleRounds::kMostRounds;
    return static_cast<unsigned>(
        std::min<std::uint64_t>(SampleRounds::kMostRounds, points / SampleRounds::kRound));
}

unsigned LevelMeter::least_rounds(std::uint64_t points) const {
    return source().size() < kEnoughSamples ? kOfSmall
                                            : std::min(most_rounds(), rounds_for(points));
}

void LevelMeter::measure_well(MeasuredLevel& level, const RunContext& context) {
    if (errors_ == LodErrors::Rough) return measure_at_some(level, context);
    if (is_exact()) {
        level.places.clear();  // of other places
        return measure(level, every_, 1, context);
    }
    constexpr double kSure = 0.016;
    const unsigned most = most_rounds(), least = least_rounds(level.points.size());
    for (unsigned rounds = kRough;;) {
        need_places(rounds, context);
        measure(level, places_, rounds, context);
        const double wanted = kSure * level.mean;
        const double unsure = mean_confidence(level.distances, level.areas, level.mean);
        const bool is_sure = !(unsure > wanted) || rounds == most;
        if (is_sure && rounds >= least) return;
        // More places also lie nearer to each other, and tell more than their number says: no more
        // than twice as many at once.
        const double needed = is_sure ? 0 : rounds * (unsure / wanted) * (unsure / wanted);
        rounds = static_cast<unsigned>(std::clamp<double>(
            std::ceil(needed), std::max(rounds + 1, least), std::max(2 * rounds, least)));
        rounds = std::min(rounds, most);
    }
}

SurfaceError LevelMeter::error_of(const MeasuredLevel& level, const ErrorFrame& frame,
                                  const RunContext& context) {
    SurfaceError error;
    error.forward =
        summarize_places(level.distances, level.areas, level.endless, level.covers, frame, context);
    error.backward =
        estimate_backward(*surface(context), level.samples(), *level.tree, frame, context);
    return error;
}

/// At the places of so many rounds, of which it may have been measured at some, or at more.
void LevelMeter::measure(MeasuredLevel& level, const SampleRounds& places, unsigned rounds,
                         const RunContext& context) {
    const std::vector<Index> known_places = std::exchange(level.places, {});
    const std::vector<float> distances = std::exchange(level.distances, {});
    const std::vector<float> covers = std::exchange(level.covers, {});
    const std::vector<std::uint8_t> endless = std::exchange(level.endless, {});
    level.places = places.of_first(rounds);
    const std::size_t count = level.places.size();
    level.distances.resize(count);
    level.covers.resize(count);
    level.endless.resize(count);
    level.areas.resize(count);
    std::vector<Vec3f> others;
    std::vector<Index> number_of;
    constexpr Index kNone = std::numeric_limits<Index>::max();
    std::vector<Index> known_at(places.all().size(), kNone);
    for (std::size_t i = 0; i < known_places.size(); ++i)
        known_at[known_places[i]] = static_cast<Index>(i);
    for (std::size_t i = 0; i < count; ++i) {
        const Index place = level.places[i];
        level.areas[i] = places.all().areas[place];
        if (const Index known = known_at[place]; known != kNone) {
            level.distances[i] = distances[known];
            level.endless[i] = endless[known];
            level.covers[i] = covers[known];
        } else {
            others.push_back(places.all().positions[place]);
            number_of.push_back(static_cast<Index>(i));
        }
    }
    // Of walks through trees most go on for long with little change; of those that have come to no
    // end after so many steps few ever do.
    constexpr unsigned kSteps = 16;
    constexpr double kSurePart = 0.005;
    FootFinder(level.samples(), *level.tree,
               {.max_iterations = kSteps, .sure_part = kSurePart, .across_sample = true})
        .find(
            others,
            [&](std::size_t i, const Foot& foot) {
                const float doubtful_sq = places.all().doubtful_sq[level.places[number_of[i]]];
                level.distances[number_of[i]] = static_cast<float>(distance_of(foot, doubtful_sq));
                level.covers[number_of[i]] = static_cast<float>(foot.to_sample);
                level.endless[number_of[i]] = !foot.converged && !foot.beyond;
            },
            context);
    level.mean = summarize("", level.distances, level.areas).mean;
}

/// Draws more rounds of places on the surface of the source, as `measure_error` takes them: at
/// points, where there are many.
void LevelMeter::draw(unsigned rounds, const RunContext& context) {
    const std::uint64_t count = rounds * SampleRounds::kRound,
                        seed = places_.rounds() * SampleRounds::kRound;
    const auto source = surface(context);
    const LonePoints& points = lone_points(context);
    if (source->points.size() >= kEnoughSamples) {
        places_.add(draw_points_by_area(points, count, seed, context), rounds);
    } else {
        places_.add(take_surface(points, source->finder, count, seed, context), rounds);
        weighed_ = places_.rounds();  // all stand for as much
    }
}

/// Until there are so many rounds of places with their areas.
void LevelMeter::need_places(unsigned rounds, const RunContext& context) {
    if (places_.rounds() < rounds) draw(rounds - places_.rounds(), context);
    if (weighed_ >= rounds) return;
    const std::vector<Index> places = places_.between(weighed_, rounds);
    std::vector<Vec3f> positions;
    for (const Index place : places) positions.push_back(places_.all().positions[place]);
    places_.weigh(places, areas_around(lone_points(context), positions, context));
    weighed_ = rounds;
}

}  // namespace stipple
