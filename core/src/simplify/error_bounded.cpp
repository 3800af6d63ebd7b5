#include "stipple/error_bounded.hpp"

#include "base/refuse.hpp"
#include "error/error_judge.hpp"
#include "simplify/snapshot_forest.hpp"
#include "simplify/snapshots.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

// Follows: Pauly, Gross, Kobbelt 2002, §1 (the problem) and §4 (the measure); Hoppe 1997
// (view-dependent refinement: a front through a forest of contractions). The forest here joins
// snapshots, whatever made them, so that one search serves every method.

namespace stipple {

namespace {

constexpr double kStep = 1.26;  // from a snapshot to the next: three of them double a count
constexpr std::size_t kMostCounts = 64;
constexpr unsigned kMostRounds = 100;
constexpr unsigned kPatience = 32;      // rounds of small steps; then they grow
constexpr unsigned kLetterRounds = 24;  // to hold for those, too, who measure by the letter
// Of a cloud of so many points no front of more than half is looked for: to tell that it needs them
// takes many times as long as to find a fraction.
constexpr std::size_t kLarge = 50'000;
constexpr double kQuickly = 100'000;  // points of the finest snapshot of a first run

/// Descending from `finest` in even steps to one.
std::vector<std::uint64_t> snapshot_sizes(double finest) {
    std::vector<std::uint64_t> sizes;
    for (double size = finest; size >= 1; size /= kStep) {
        const auto rounded = static_cast<std::uint64_t>(std::llround(size));
        if (sizes.empty() || rounded < sizes.back()) sizes.push_back(rounded);
    }
    return sizes;
}

/// The snapshots of one run, the last of them the cloud itself.
SnapshotForest forest_of(const PointCloud& cloud, const SimplifyOptions& options, double finest,
                         const RunContext& context) {
    const std::vector<std::uint64_t> sizes = snapshot_sizes(finest);
    const std::uint64_t points =
        std::accumulate(sizes.begin(), sizes.end(), std::uint64_t{cloud.size()});
    if (points > std::numeric_limits<Index>::max()) {  // from 1.25e9 and half of them on
        throw Error(ErrorCode::TooLarge,
                    std::to_string(cloud.size()) + " points and their snapshots are " +
                        std::to_string(points) +
                        ": expected fewer than 2^32; simplify to a count first, or to a larger "
                        "max_error");
    }
    std::vector<PointCloud> levels;
    make_snapshots(
        cloud, options, sizes, [&](PointCloud&& level) { levels.push_back(std::move(level)); },
        context);
    std::ranges::reverse(levels);
    levels.push_back(cloud);
    return {std::move(levels), context};
}

ErrorBoundedCloud whole(const PointCloud& cloud, double bound, unsigned tries) {
    ErrorBoundedCloud result{.cloud = cloud, .bound = bound, .tries = tries, .whole = true};
    result.error.diagonal = bounds(cloud).diagonal();
    return result;
}

/// Whether it is within the bound everywhere, as it is then measured.
bool holds(ErrorBoundedCloud& candidate, ErrorJudge& judge) {
    return judge.watch(candidate.cloud).places.empty() &&
           judge.measure(candidate).max <= ErrorJudge::kWithin;
}

/// The search through the snapshots of one run.
class ForestSearch {
public:
    ForestSearch(SnapshotForest forest, ErrorJudge& judge, const RunContext& context)
        : forest_(std::move(forest)),
          judge_(judge),
          context_(context),
          quietly_(context.quietly()) {}

    /// No snapshot of so few points holds everywhere. Known after the run.
    std::uint64_t too_few() const { return finest_ == 0 ? 0 : forest_.size_of(finest_ - 1); }

    /// Looks at the levels from the coarsest that holds down to where most places are too coarse.
    /// @return whether a snapshot holds everywhere, at a glance.
    bool learn() {
        too_far_.assign(forest_.level_count(), 0.0);
        const std::size_t input = forest_.level_count() - 1;  // which holds
        std::size_t coarse = 0, fine = input;
        std::vector<bool> seen(forest_.level_count(), false);
        while (fine - coarse > 0) {
            const std::size_t middle = coarse + (fine - coarse) / 2;
            seen[middle] = true;
            if (learn(middle))
                fine = middle;
            else
                coarse = middle + 1;
        }
        context_.checkpoint(0.4);
        coarsest_ = fine;
        while (coarsest_ > 0) {
            const std::size_t next = coarsest_ - 1;
            if (!seen[next]) learn(next);
            if (too_far_[next] > kHopeless) break;
            coarsest_ = next;
        }
        finest_ = fine;
        context_.checkpoint(0.6);
        return finest_ < input;
    }

    /// After `learn`: the cloud within the bound, and its measurement; none when it would be the
    /// whole input.
    ///
    /// What holds is then made to hold for those, too, who measure by the letter, if it takes few
    /// more points and rounds, as it does not in noise; else it is looked at once more, with care.
    std::optional<ErrorBoundedCloud> run() {
        constexpr double kFewMore = 1.25;
        const std::size_t base = best_base();
        auto found = refine(base, most_wanted(), kMostRounds, context_.part(0.6, 0.8));
        if (judge_.is_spent()) return with_care(std::move(found));
        if (!found) return found;
        std::vector<std::uint8_t> marks = forest_.marks();
        judge_.read(Reading::ByTheLetter);
        const auto most = static_cast<double>(found->cloud.size()) * kFewMore;
        auto by_the_letter =
            refine(base, static_cast<std::size_t>(most), kLetterRounds, context_.part(0.8, 0.9));
        if (by_the_letter) return by_the_letter;
        if (judge_.is_spent()) return with_care(std::move(found));
        forest_.set_marks(std::move(marks));
        judge_.read(Reading::Confirmed);
        judge_.take_care();
        auto careful = refine(base, most_wanted(), kMostRounds, context_.part(0.9, 1.0));
        if (!careful && judge_.is_spent()) return with_care(std::move(found));
        return careful;
    }

private:
    std::size_t most_wanted() const {
        const std::size_t points = forest_.size_of(forest_.level_count() - 1);
        return points < kLarge ? points * 9 / 10 : points / 2;
    }

    /// Where the judge is spent: what was found, if it holds with care; else a snapshot that does,
    /// by bisection, so that it takes few tries: one where not even the finest holds, as in noise.
    std::optional<ErrorBoundedCloud> with_care(std::optional<ErrorBoundedCloud> found) {
        judge_.read(Reading::Confirmed);
        judge_.take_care();
        if (found && holds(*found, judge_)) return found;
        std::size_t coarse = finest_, fine = finest_;  // the levels from `coarse` to before `fine`
        while (forest_.size_of(fine) <= most_wanted()) ++fine;
        std::optional<ErrorBoundedCloud> best;
        for (std::size_t next = fine - 1; coarse < fine; next = coarse + (fine - coarse) / 2) {
            ErrorBoundedCloud candidate{.cloud = forest_.level(next, quietly_)};
            if (holds(candidate, judge_)) {
                best = std::move(candidate);
                fine = next;
            } else if (best) {
                coarse = next + 1;
            } else {
                break;
            }
        }
        return best;
    }

    /// Makes the cut finer until it holds; none when that takes more than `most` points or rounds,
    /// or the judge is spent.
    std::optional<ErrorBoundedCloud> refine(std::size_t base, std::size_t most, unsigned rounds,
                                            const RunContext& context) {
        for (unsigned round = 0; round < rounds; ++round) {
            context.checkpoint(static_cast<double>(round) / rounds);
            if (judge_.is_spent()) return std::nullopt;
            std::vector<Index> cut = forest_.cut(base);
            while (forest_.grade(cut, context)) cut = forest_.cut(base);
            if (cut.empty() || cut.size() > most) return std::nullopt;
            ErrorBoundedCloud result{.cloud = forest_.cloud_of(cut, quietly_)};
            ErrorJudge::Finding finding = judge_.watch(result.cloud);
            if (finding.places.empty()) {
                finding = judge_.measure(result);
                if (finding.max <= ErrorJudge::kWithin) return result;
            }
            const unsigned steps = 2 + (round < kPatience ? 0 : round - kPatience);
            if (!forest_.mark(cut, finding.places, steps, context) &&
                !forest_.mark_all(finding.places, context))
                return std::nullopt;  // what is too far is the input from its own surface
        }
        return std::nullopt;
    }

    /// Whether a level holds everywhere. Says where it is too coarse.
    bool learn(std::size_t level) {
        const ErrorJudge::Finding finding = judge_.glance(forest_.level(level, quietly_));
        too_far_[level] = finding.share;
        forest_.mark(level, finding.places, context_);
        return finding.places.empty();
    }

    /// Where the cut that follows from what was seen has fewest points.
    std::size_t best_base() const {
        std::size_t best = finest_, fewest = forest_.cut(finest_).size();
        for (std::size_t base = coarsest_; base < finest_; ++base) {
            const std::size_t size = forest_.cut(base).size();
            if (size > 0 && size < fewest) std::tie(best, fewest) = std::pair(base, size);
        }
        return best;
    }

    static constexpr double kHopeless = 0.25;  // share of places too coarse

    SnapshotForest forest_;
    ErrorJudge& judge_;
    const RunContext& context_;
    RunContext quietly_;
    std::vector<double> too_far_;
    std::size_t coarsest_ = 0, finest_ = 0;
};

/// Snapshots of more points than `too_few` but fewer than `size` that hold everywhere as far as one
/// sees from a glance and a watch. Descending.
std::vector<PointCloud> fewer_at_a_look(const PointCloud& cloud, const SimplifyOptions& options,
                                        std::uint64_t size, std::uint64_t too_few,
                                        ErrorJudge& judge, const RunContext& context) {
    constexpr double kCloser = 1.05;
    constexpr unsigned kMostMisses = 3;  // the error does not fall evenly with the count
    std::vector<std::uint64_t> counts;
    const double least = std::max(static_cast<double>(too_few) + 1, static_cast<double>(size) / 2);
    for (double count = static_cast<double>(size) / kCloser; count >= least; count /= kCloser) {
        const auto rounded = static_cast<std::uint64_t>(count);
        if (counts.empty() || rounded < counts.back()) counts.push_back(rounded);
    }
    std::vector<PointCloud> fewer;
    unsigned misses = 0;
    if (counts.empty()) return fewer;
    const auto look_at = [&](PointCloud&& snapshot) {
        if (misses == kMostMisses || judge.is_spent()) return;
        const bool holds =
            judge.glance(snapshot).places.empty() && judge.watch(snapshot).places.empty();
        misses = holds ? 0 : misses + 1;
        if (holds) fewer.push_back(std::move(snapshot));
    };
    const RunContext quiet = context.quietly();
    if (options.method == Method::Particles) {  // each is a run of its own
        const CloudOfSize run = runs_of(cloud, options, quiet);
        for (const std::uint64_t count : counts)
            if (misses < kMostMisses && !judge.is_spent()) look_at(run(count, quiet));
    } else {
        make_snapshots(cloud, options, counts, look_at, quiet);
    }
    return fewer;
}

/// A snapshot of more points than `too_few` but fewer than `size` that holds everywhere, if there
/// is one: where the error is even, one count for all needs fewer than a front with its grading. A
/// measurement takes as long as many looks, and the fewest points of those that hold at a look
/// mostly hold: they are measured first, and where they do not, the least that do are bisected for.
std::optional<ErrorBoundedCloud> fewer_everywhere(const PointCloud& cloud,
                                                  const SimplifyOptions& options,
                                                  std::uint64_t size, std::uint64_t too_few,
                                                  ErrorJudge& judge, const RunContext& context) {
    std::vector<PointCloud> fewer = fewer_at_a_look(cloud, options, size, too_few, judge, context);
    std::optional<ErrorBoundedCloud> best;
    std::size_t holding = 0, failing = fewer.size();  // the first `holding` have more points
    for (std::size_t next = fewer.size(); next > holding;
         next = holding + (failing - holding + 1) / 2) {
        ErrorBoundedCloud candidate{.cloud = std::move(fewer[next - 1])};
        if (holds(candidate, judge)) {
            best = std::move(candidate);
            holding = next;
        } else {
            failing = next - 1;
        }
    }
    return best;
}

ErrorBoundedCloud search_forest(const PointCloud& cloud, const SimplifyOptions& options,
                                double bound, ErrorJudge& judge, const RunContext& context) {
    // A large cloud mostly has far more points than it needs: half of them are made only where
    // fewer have not been enough.
    const double half = 0.5 * static_cast<double>(cloud.size());
    std::optional<ErrorBoundedCloud> found;
    std::uint64_t too_few = 0;
    for (const double finest : {std::min(half, kQuickly), half}) {
        constexpr double kQuickPass = 0.8;  // of the time
        const bool is_first = finest <= kQuickly, is_last = finest == half;
        const RunContext rest = context.part(is_first ? 0 : kQuickPass, is_last ? 1 : kQuickPass);
        ForestSearch search(forest_of(cloud, options, finest, rest.part(0, 0.3)), judge, rest);
        if (search.learn() || is_last) found = search.run();
        too_few = search.too_few();
        if (found || is_last) break;
    }
    const std::uint64_t size = found ? found->cloud.size() : cloud.size();
    judge.take_care();
    auto fewer = fewer_everywhere(cloud, options, size, too_few, judge, context);
    if (fewer) return std::move(*fewer);
    return found ? std::move(*found) : whole(cloud, bound, judge.tries());
}

}  // namespace

void require_error_bounded(Method method) {
    if (std::ranges::find(kErrorBoundedMethods, method) != kErrorBoundedMethods.end()) return;
    refuse("method ", to_string(method),
           ": expected multiphase, hierarchical, iterative or particles for max_error or a curve");
}

ErrorBoundedCloud simplify_within_error(const PointCloud& cloud, const SimplifyOptions& options,
                                        const RunContext& context) {
    validate(options);
    if (!options.max_error && !options.max_error_rel) refuse("max_error: missing");
    if (cloud.empty()) refuse("the cloud has no points: expected at least 1");
    const double bound =
        options.max_error ? *options.max_error : *options.max_error_rel * bounds(cloud).diagonal();
    if (bounds(cloud).diagonal() == 0) return whole(cloud, bound, 0);
    context.checkpoint(0.0);
    ErrorJudge judge(cloud, bound, context);
    ErrorBoundedCloud result;
    if (judge.can_be_kept())
        result = search_forest(cloud, options, bound, judge, context);
    else
        result = whole(cloud, bound, 0);
    result.bound = bound;
    result.points_off_surface = judge.points_off_surface();
    result.tries = judge.tries();
    result.ended_early = judge.is_spent();
    if (result.whole) result.too_far = judge.too_far();
    context.checkpoint(1.0);
    return result;
}

std::vector<std::uint64_t> curve_counts(std::uint64_t points, unsigned count) {
    require(count <= kMostCounts, "count", count, "at most 64");
    constexpr double kMost = 1e6;  // to measure at more takes minutes
    const double least = std::max(20.0, 1e-3 * static_cast<double>(points));
    const double most = std::min(0.5 * static_cast<double>(points), std::max(kMost, least));
    std::vector<std::uint64_t> counts;
    for (unsigned i = 0; i < count && most >= least; ++i) {
        const double part = count == 1 ? 0.0 : i / (count - 1.0);
        const auto next =
            static_cast<std::uint64_t>(std::llround(most * std::pow(least / most, part)));
        if (next < points && (counts.empty() || next < counts.back())) counts.push_back(next);
    }
    return counts;
}

void validate(const ErrorCurveOptions& options) {
    require_error_bounded(options.simplification.method);
    SimplifyOptions method = options.simplification;
    const bool targeted = method.points || method.ratio || method.max_error || method.max_error_rel;
    if (targeted) refuse("target: a curve has none; give points or count");
    method.points = 1;
    validate(method);
    require(options.count >= 2 && options.count <= kMostCounts, "count", options.count, "2..64");
    if (options.points.size() > kMostCounts)
        refuse("points: ", options.points.size(), " counts: expected at most 64");
    for (std::size_t i = 0; i < options.points.size(); ++i) {
        const std::uint64_t least = i == 0 ? 1 : options.points[i - 1] + 1;
        require(options.points[i] >= least, "points", options.points[i],
                "ascending counts, each at least 1");
    }
}

std::vector<std::uint64_t> curve_counts(std::uint64_t points, const ErrorCurveOptions& options) {
    validate(options);
    std::vector<std::uint64_t> counts;
    if (options.points.empty()) {
        counts = curve_counts(points, options.count);
        if (counts.empty())
            refuse("points: the cloud has ", points, ": expected at least 40, or explicit counts");
    }
    for (const std::uint64_t count : options.points)
        if (count < points) counts.insert(counts.begin(), count);
    if (counts.empty())
        refuse("points: the cloud has ", points, ": expected at least one count below that");
    return counts;
}

void error_curve(const PointCloud& cloud, const ErrorCurveOptions& options,
                 const std::function<void(const CurvePoint&)>& on_point,
                 const SurfaceErrorOptions& measure, const RunContext& context) {
    if (cloud.empty()) refuse("the cloud has no points: expected at least 1");
    const std::vector<std::uint64_t> counts = curve_counts(cloud.size(), options);
    const RunContext quietly = context.quietly();
    std::size_t done = 0;
    context.checkpoint(0.0);
    SurfaceErrorMeter meter(cloud, measure, quietly);
    make_snapshots(
        cloud, options.simplification, counts,
        [&](PointCloud&& snapshot) {
            on_point({snapshot.size(), meter.measure(snapshot, quietly)});
            context.checkpoint(static_cast<double>(++done) / static_cast<double>(counts.size()));
        },
        quietly);
    context.checkpoint(1.0);
}

}  // namespace stipple
