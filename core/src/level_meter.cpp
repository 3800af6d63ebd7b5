#include "level_meter.hpp"

#include "distance_statistics.hpp"
#include "error_samples.hpp"
#include "foot_finder.hpp"
#include "gaps.hpp"

#include <cstdint>
#include <span>
#include <utility>

namespace stipple {

namespace {

constexpr std::uint64_t kMany = 40'000;  // points of a source

constexpr unsigned kRough = 2;     // rounds that tell two roundings of the same points apart
constexpr unsigned kMostly = 12;   // that scans of surfaces need
constexpr unsigned kOfSmall = 32;  // of a small source

/// To measure a level of so many points by: one place for 128 of them at least.
unsigned least_rounds(std::uint64_t points) {
    constexpr std::uint64_t kOfRound = 128 * SampleRounds::kRound;
    return static_cast<unsigned>(std::clamp<std::uint64_t>((points + kOfRound - 1) / kOfRound, 8,
                                                           SampleRounds::kMostRounds));
}

/// Places on the surface of the source, as `measure_error` takes them: at points, where there are
/// many.
ErrorSamples take_samples(const FramedSurface& source, std::uint64_t count, std::uint64_t seed,
                          const RunContext& context) {
    if (source.points.size() >= kMany)
        return take_points_by_area(source.tree, count, seed, context);
    return take_surface(source.tree, source.finder, count, seed, context);
}

}  // namespace

MeasuredLevel::MeasuredLevel(std::vector<Vec3f>&& points_, const RunContext& context)
    : points(std::move(points_)),
      tree(std::make_unique<PointTree>(points, PointTree::Leaves::Given, context)) {}

LevelMeter::LevelMeter(std::vector<Vec3f>&& source, LodErrors errors, const RunContext& context)
    : points_(std::move(source)), errors_(errors) {
    const auto made = surface(context);
    context.checkpoint(0.5);
    const std::vector<Vec3f>& points = made->points;
    spacing_ = median_gap(made->tree);
    const bool is_small = points.size() < kMany;
    const unsigned rounds = errors_ == LodErrors::Rough ? kRough
                            : is_small                  ? kOfSmall
                                       : std::max(kMostly, least_rounds(points.size()));
    places_.add(take_samples(*made, rounds * SampleRounds::kRound, 0, context), rounds);
    if (!is_exact()) return;
    const std::uint64_t every =
        is_small ? SampleRounds::kMostRounds * SampleRounds::kRound : points.size();
    every_.add(take_samples(*made, every, 0, context), 1);
}

std::shared_ptr<const FramedSurface> LevelMeter::surface(const RunContext& context) {
    if (!surface_)
        surface_ = std::make_shared<FramedSurface>(std::move(points_), PointTree::Leaves::Given,
                                                   FootFinder::Options{}, context);
    return surface_;
}

void LevelMeter::forget_surface() {
    if (surface_) points_ = std::move(surface_->points);
    surface_.reset();
}

ErrorSamples LevelMeter::some_places() const {
    constexpr unsigned kSome = 4;
    return places_.first(kSome);
}

void LevelMeter::measure_roughly(MeasuredLevel& level, const RunContext& context) const {
    measure(level, places_, kRough, context);
}

void LevelMeter::measure_well(MeasuredLevel& level, const RunContext& context) {
    if (errors_ == LodErrors::Rough) return measure_roughly(level, context);
    if (is_exact()) {
        level.places.clear();  // of other places
        return measure(level, every_, 1, context);
    }
    constexpr double kSure = 0.016;
    const std::uint64_t points = source().size();
    const bool is_small = points < kMany;
    // No more places than points of which they are drawn.
    const unsigned most = is_small ? SampleRounds::kMostRounds
                                   : static_cast<unsigned>(std::min<std::uint64_t>(
                                         SampleRounds::kMostRounds, points / SampleRounds::kRound));
    const unsigned least = is_small ? kOfSmall : std::min(most, least_rounds(level.points.size()));
    rounds_ = std::max(rounds_, kRough);
    for (;;) {
        add_places(rounds_, context);
        measure(level, places_, rounds_, context);
        const double wanted = kSure * level.mean;
        const double unsure = mean_confidence(level.distances, level.areas, level.mean);
        const bool is_sure = unsure <= wanted || rounds_ == most;
        if (is_sure && rounds_ >= least) return;
        const double needed = is_sure ? 0 : rounds_ * (unsure / wanted) * (unsure / wanted);
        rounds_ = static_cast<unsigned>(
            std::clamp<double>(std::ceil(needed), std::max(rounds_ + 1, least), most));
    }
}

/// At the places of so many rounds, of which it may have been measured at some.
void LevelMeter::measure(MeasuredLevel& level, const SampleRounds& places, unsigned rounds,
                         const RunContext& context) {
    const std::vector<Index> known_places = std::exchange(level.places, {});
    const std::vector<float> distances = std::exchange(level.distances, {});
    const std::vector<float> covers = std::exchange(level.covers, {});
    level.places = places.of_first(rounds);
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

/// Until there are so many rounds of places.
void LevelMeter::add_places(unsigned at_least, const RunContext& context) {
    if (places_.rounds() >= at_least) return;
    const unsigned so_far = places_.rounds(), more = at_least - so_far;
    places_.add(take_samples(*surface(context), more * SampleRounds::kRound,
                             so_far * SampleRounds::kRound, context),
                more);
}

}  // namespace stipple
