#include "error/error_judge.hpp"

#include <algorithm>
#include <limits>
#include <utility>

namespace stipple {

namespace {

constexpr std::uint64_t kGlance = 10'000;
constexpr std::size_t kManyPlaces = 100'000;        // to watch, unless there are more points
constexpr std::size_t kManyPoints = 1'000'000;      // which are close together: no places between
constexpr std::uint64_t kFewestMeasured = 200'000;  // also of small clouds
constexpr std::uint64_t kFewestAgain = 800'000;
/// Of a cloud of some hundred points: for each, with no more to find between them.
constexpr std::uint64_t kEnoughOfEach = 100, kEnoughAgainOfEach = 400;
constexpr std::uint64_t kUnevenAgain = 600'000;  // more places where a candidate is uneven
/// Of a cloud of many points so small a part of the places is measured first: it mostly tells what
/// is too far.
constexpr std::uint64_t kFirstPart = 8;
/// A search looks at so many places, and so many for each point of the cloud, and ends: else noise
/// just below the bound, where some place out of millions is always a little too far, takes a
/// thousand times as long as what made the candidates. Of a large cloud each is less: somebody
/// waits.
constexpr std::uint64_t kMostLooks = 60'000'000, kMostLooksEach = 150, kMostLooksEachOfMany = 25;
constexpr std::uint64_t kSeed = 0, kAgainSeed = 1, kFirstSeed = 2;
constexpr std::uint64_t kMeasuredEach = 100;        // enough for each point of a candidate
constexpr std::uint64_t kEnoughMeasured = 300'000;  // unless it has more points than that

/// Distances rise to a maximum, if steeply: where they are above these parts of the bound, in the
/// first round and then, `kEach` places around are looked at, in reach of `kSpread` times h at
/// first.
constexpr double kRaised = 0.5, kHigh = 0.8;
constexpr std::size_t kMostRaised = 4'000;
constexpr unsigned kEach = 16, kRounds = 2;
constexpr float kSpread = 0.5F;

void append(std::vector<Vec3f>& to, const std::vector<Vec3f>& more) {
    to.insert(to.end(), more.begin(), more.end());
}

/// Where a distance is above the bound: the `most` farthest.
std::vector<Vec3f> places_above(double bound, const DirectedError& error,
                                std::size_t most = std::numeric_limits<std::size_t>::max()) {
    const std::vector<float>& distances = error.distances;
    std::vector<std::size_t> above;
    for (std::size_t i = 0; i < distances.size(); ++i)
        if (distances[i] > bound) above.push_back(i);
    if (above.size() > most) {
        const auto farther = [&](std::size_t a, std::size_t b) {
            return distances[a] > distances[b] || (distances[a] == distances[b] && a < b);
        };
        std::ranges::nth_element(above, above.begin() + static_cast<std::ptrdiff_t>(most), farther);
        above.resize(most);
        std::ranges::sort(above);
    }
    std::vector<Vec3f> places;
    for (const std::size_t i : above) places.push_back(error.positions[i]);
    return places;
}

}  // namespace

ErrorJudge::ErrorJudge(const PointCloud& cloud, double bound, const RunContext& context)
    : cloud_(cloud),
      bound_(bound),
      quietly_(context.quietly()),
      frame_(bounds(cloud), cloud),
      surface_(frame_.into(cloud, quietly_), Reading::Confirmed, quietly_) {
    part_points();
    const std::size_t step = std::max<std::size_t>(1, points_.size() / kGlance);
    for (std::size_t i = 0; i < points_.size(); i += step) some_points_.push_back(points_[i]);
}

void ErrorJudge::remember(std::uint64_t points, const Vec3f& place, double distance) {
    const double in_units = distance / frame_.scale;
    if (in_units <= bound_ || (too_far_ && points <= too_far_->points)) return;
    too_far_ = {.points = points,
                .place = frame_.center + place.cast<double>() / frame_.scale,
                .distance = in_units};
}

void ErrorJudge::part_points() {
    const Probes own = surface_.measure(surface_.some_points(cloud_.size(), quietly_), surface_,
                                        margin(), quietly_);
    for (std::size_t i = 0; i < own.places.size(); ++i)
        (own.distances[i] <= margin() ? points_ : off_surface_).push_back(own.places[i]);
    if (!can_be_kept(points_.size())) remember(cloud_.size(), own.farthest(), own.max());
}

std::vector<Vec3f> ErrorJudge::out_of_frame(std::span<const Vec3f> places) const {
    std::vector<Vec3f> points(places.size());
    for (std::size_t i = 0; i < points.size(); ++i) points[i] = frame_.out_of(places[i], cloud_);
    return points;
}

bool ErrorJudge::can_be_kept(std::size_t points_of_surface) const noexcept {
    constexpr std::size_t kOneOf = 100;
    return points_of_surface + cloud_.size() / kOneOf >= cloud_.size();
}

bool ErrorJudge::is_spent() const noexcept {
    const std::uint64_t looks = looks_ + (watch_ ? watch_->looks() : 0);
    const std::uint64_t points = cloud_.size(), some = std::min<std::uint64_t>(points, kManyPoints);
    return looks > kMostLooks + kMostLooksEach * some + kMostLooksEachOfMany * (points - some);
}

void ErrorJudge::read(Reading reading) {
    if (reading_ != reading && watch_) {
        looks_ += watch_->looks();
        watch_.reset();
    }
    reading_ = reading;
}

ErrorJudge::Finding ErrorJudge::glance(const PointCloud& candidate) {
    ++tries_;
    const ProbedSurface other(frame_.into(candidate, quietly_), Reading::Confirmed, quietly_);
    const Probes forward = surface_.measure(some_points_, other, margin(), quietly_);
    const std::uint64_t places = std::min<std::uint64_t>(kGlance, kEnoughOfEach * cloud_.size());
    const Probes backward =
        other.measure(other.random_places(places, quietly_), surface_, margin(), quietly_);
    Finding finding;
    finding.max = std::max(forward.max(), backward.max()) / (bound_ * frame_.scale);
    for (const Probes* const probes : {&forward, &backward}) {
        append(finding.places, out_of_frame(probes->places_above(margin())));
        remember(candidate.size(), probes->farthest(), probes->max());
    }
    const std::size_t looks = forward.places.size() + backward.places.size();
    looks_ += looks;
    finding.share = static_cast<double>(finding.places.size()) / static_cast<double>(looks);
    return finding;
}

ErrorJudge::Finding ErrorJudge::watch(const PointCloud& candidate) {
    ++tries_;
    if (!watch_) {
        std::vector<Vec3f> places = points_;
        if (cloud_.size() < kManyPoints) {
            // A place around a point also lies in gaps between points.
            const auto each =
                static_cast<unsigned>(std::clamp<std::size_t>(kManyPlaces / cloud_.size(), 1, 10));
            append(places, surface_.places_around(places, 1, each, 0, quietly_).places);
        }
        watch_.emplace(surface_, std::move(places), off_surface_, margin(), reading_);
    }
    watch_->look_at(frame_.into(candidate, quietly_), quietly_);
    looks_ += cloud_.size();  // to see where anything has changed takes about as long as so many
    remember(candidate.size(), watch_->farthest_place(), watch_->max());
    return found_by_watch();
}

ErrorJudge::Finding ErrorJudge::found_by_watch() const {
    return {.places = out_of_frame(watch_->places_too_far()),
            .max = watch_->max() / (bound_ * frame_.scale)};
}

ErrorJudge::Finding ErrorJudge::measure(ErrorBoundedCloud& candidate) {
    ++tries_;
    if (careful_ && reading_ == Reading::Confirmed) {
        // First what mostly decides, and takes less time than what is measured then.
        watch_->look_again(std::min(kUnevenAgain, kEnoughAgainOfEach * cloud_.size()), tries_,
                           quietly_);
        if (watch_->max() > kWithin * bound_ * frame_.scale) return found_by_watch();
    }
    const std::uint64_t fewest =
        std::min<std::uint64_t>(kFewestMeasured, kEnoughOfEach * cloud_.size());
    if (!meter_) {
        const SurfaceErrorOptions options = {
            .sampling = ErrorSampling::Surface,
            .samples = std::max<std::uint64_t>(fewest, cloud_.size()),
            .keep_samples = true};
        meter_.emplace(cloud_, options, quietly_);
    }
    const std::uint64_t enough = std::max(kEnoughMeasured, kMeasuredEach * candidate.cloud.size());
    const auto samples = std::clamp<std::uint64_t>(2 * cloud_.size(), fewest, enough);
    if (cloud_.size() >= kManyPoints) {
        Finding finding = measured(candidate, samples / kFirstPart, kFirstSeed);
        if (finding.max > kWithin) return finding;
    }
    Finding finding = measured(candidate, samples, kSeed);
    if (finding.max <= kWithin && (careful_ || reading_ == Reading::ByTheLetter)) {
        // Where a fixed point leaps the farthest places may be few: others are likely to meet them.
        const std::uint64_t few = std::min(kFewestAgain, kEnoughAgainOfEach * cloud_.size());
        const SurfaceError again =
            meter_->measure(candidate.cloud, std::max(samples, few), kAgainSeed, quietly_);
        looks_ += again.forward.samples + again.backward.samples;
        append(finding.places, places_above(kMargin * bound_, again.forward));
        append(finding.places, places_above(kMargin * bound_, again.backward));
        finding.max = std::max(finding.max, again.max() / bound_);
        if (finding.max <= kWithin) measure_as_usual(candidate.cloud, finding);
    }
    return finding;
}

void ErrorJudge::measure_as_usual(const PointCloud& candidate, Finding& finding) {
    constexpr std::uint64_t kSeeds = 3;
    if (!usual_meter_) usual_meter_.emplace(cloud_, SurfaceErrorOptions{}, quietly_);
    for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
        const SurfaceError error = usual_meter_->measure(candidate, 0, seed, quietly_);
        for (const DirectedError* const direction : {&error.forward, &error.backward}) {
            looks_ += direction->samples;
            if (direction->max <= kMargin * bound_ || !direction->max_at) continue;
            const Vec3f place = (*direction->max_at - cloud_.origin).cast<float>();
            if (is_off_surface(place)) continue;  // and hides what is less far
            finding.places.push_back(place);
            finding.max = std::max(finding.max, direction->max / bound_);
        }
    }
}

bool ErrorJudge::is_off_surface(const Vec3f& place) const {
    constexpr float kSame = 1e-6F;
    const Vec3f there = frame_.into(place, cloud_);
    return std::ranges::any_of(off_surface_,
                               [&](const Vec3f& point) { return (point - there).norm() <= kSame; });
}

ErrorJudge::Finding ErrorJudge::measured(ErrorBoundedCloud& candidate, std::uint64_t samples,
                                         std::uint64_t seed) {
    candidate.error = meter_->measure(candidate.cloud, samples, seed, quietly_);
    candidate.sampling = ErrorSampling::Surface;
    DirectedError &forward = candidate.error.forward, &backward = candidate.error.backward;
    looks_ += forward.samples + backward.samples;
    Finding finding{.places = places_above(kMargin * bound_, forward),
                    .max = candidate.error.max() / bound_};
    append(finding.places, places_above(kMargin * bound_, backward));
    if (finding.max <= kWithin) {
        const ProbedSurface other(frame_.into(candidate.cloud, quietly_), reading_, quietly_);
        look_closer(surface_, places_above(kRaised * bound_, forward, kMostRaised), other, finding);
        look_closer(other, places_above(kRaised * bound_, backward, kMostRaised), surface_,
                    finding);
        look_at_points(candidate.cloud, finding);
    }
    for (DirectedError* const direction : {&forward, &backward}) {
        direction->positions = {};
        direction->distances = {};
    }
    return finding;
}

void ErrorJudge::look_at_points(const PointCloud& candidate, Finding& finding) {
    const Probes own =
        surface_.measure(frame_.into(candidate, quietly_), surface_, margin(), quietly_);
    looks_ += own.places.size();
    std::vector<Vec3f> too_far;
    for (std::size_t i = 0; i < own.places.size(); ++i) {
        const float distance = own.distances[i];
        if (distance <= margin() || surface_.to_point(own.places[i]) <= margin()) continue;
        too_far.push_back(own.places[i]);
        finding.max =
            std::max(finding.max, static_cast<double>(distance) / (bound_ * frame_.scale));
    }
    append(finding.places, out_of_frame(too_far));
}

void ErrorJudge::look_closer(const ProbedSurface& from, std::span<const Vec3f> raised,
                             const ProbedSurface& other, Finding& finding) const {
    std::vector<Vec3f> centers;
    for (const Vec3f& place : raised) centers.push_back(frame_.into(place, cloud_));
    float spread = kSpread;
    for (unsigned round = 0; round < kRounds; ++round, spread /= 2) {
        const Probes probes =
            from.measure(from.places_around(centers, spread, kEach, round, quietly_).places, other,
                         margin(), quietly_);
        finding.max =
            std::max(finding.max, static_cast<double>(probes.max()) / (bound_ * frame_.scale));
        append(finding.places, out_of_frame(probes.places_above(margin())));
        const std::vector<Vec3f> high = probes.places_above(kHigh * bound_ * frame_.scale);
        centers.clear();
        for (std::size_t i = 0; i < high.size(); i += 1 + high.size() / kMostRaised)
            centers.push_back(high[i]);
    }
}

}  // namespace stipple
