#include "contraction/sibling_contraction.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/until_stopped.hpp"
#include "contraction/quadric.hpp"

#include <tbb/parallel_invoke.h>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

// A queue of such contractions has nothing to search: what each costs follows from the leaves up,
// and as it is never cheaper than those that must precede it, the ones left undone are the dearest.

namespace stipple {

namespace {

/// A node in the order in which its contraction would be undone: parents before their halves.
struct Rank {
    bool large;  ///< of more samples than one point may stand for
    double cost;
    Index node;

    bool operator<(const Rank& other) const noexcept {
        if (large != other.large) return large;
        return cost != other.cost ? cost > other.cost : node < other.node;
    }
};

/// Ranks nodes when `size` points are left.
class Ranking {
public:
    Ranking(std::span<const double> costs, std::span<const Index> samples_of, std::size_t size)
        : costs_(costs),
          samples_of_(samples_of),
          most_(2.0 * samples_of[0] / static_cast<double>(size)) {}

    Rank operator()(std::size_t node) const noexcept {
        return {samples_of_[node] > most_, costs_[node], static_cast<Index>(node)};
    }

private:
    std::span<const double> costs_;
    std::span<const Index> samples_of_;
    double most_;
};

/// The last node that stays split when `size` points are left.
Rank last_split(const Ranking& ranking, std::span<const Index> samples_of, std::size_t size,
                const RunContext& context) {
    if (size == 1) return {true, std::numeric_limits<double>::infinity(), 0};
    std::vector<Rank> ranks;
    ranks.reserve(samples_of.size() / 2);
    for_blocks_in_order(samples_of.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t node = begin; node < end; ++node)
            if (samples_of[node] > 1) ranks.push_back(ranking(node));
    });
    const auto last = ranks.begin() + static_cast<std::ptrdiff_t>(size - 2);
    std::nth_element(ranks.begin(), last, ranks.end(), until_stopped(context, std::less<>()));
    return *last;
}

}  // namespace

/// Some samples together.
struct SiblingContraction::Joined {
    Index first = 0;  ///< of them; its position is what the rest refers to
    Quadric quadric;
    Vec3d place = Vec3d::Zero();  ///< where the quadric is least
};

SiblingContraction::SiblingContraction(const QuadricSamples& samples,
                                       std::span<const Index> samples_of, const RunContext& context)
    : samples_(samples),
      samples_of_(samples_of),
      costs_(made_in_blocks<std::vector<double>>(samples_of.size(), context)) {
    with_threads(context, [&] { join(0, 0, context); });
}

std::vector<Index> SiblingContraction::nodes_left(std::size_t size,
                                                  const RunContext& context) const {
    const Ranking ranking(costs_, samples_of_, size);
    const Rank last = last_split(ranking, samples_of_, size, context);
    std::vector<Index> first;
    Index sample = 0;
    for (std::size_t node = 0; node < costs_.size();) {
        constexpr std::size_t kBetweenChecks = 65'536;
        if (first.size() % kBetweenChecks == 0) context.throw_if_stopped();
        const Index samples = samples_of_[node];
        if (samples > 1 && !(last < ranking(node))) {
            ++node;
            continue;
        }
        first.push_back(sample);
        sample += samples;
        node += 2 * std::size_t{samples} - 1;
    }
    first.push_back(sample);
    return first;
}

Vec3f SiblingContraction::place_of(Index begin, Index end) const {
    if (end - begin == 1) return samples_.position(begin).cast<float>();
    const Vec3d first = samples_.position(begin);
    Quadric sum;
    Vec3d mean = Vec3d::Zero();
    for (Index i = begin; i < end; ++i) {
        const Vec3d d = samples_.position(i) - first;
        sum = sum + referred_to(samples_.quadric(i), -d);
        mean += d / static_cast<double>(end - begin);
    }
    Vec3d place;
    if (!minimiser(sum, place)) place = mean;
    // No farther out than the samples themselves are.
    double farthest_sq = 0;
    for (Index i = begin; i < end; ++i) {
        farthest_sq = std::max(farthest_sq, (samples_.position(i) - first - mean).squaredNorm());
    }
    const double out_sq = (place - mean).squaredNorm();
    if (out_sq > farthest_sq) place = mean + std::sqrt(farthest_sq / out_sq) * (place - mean);
    return (first + place).cast<float>();
}

SiblingContraction::Joined SiblingContraction::join(std::size_t node, Index first,
                                                    const RunContext& context) {
    const Index samples = samples_of_[node];
    if (samples == 1) return {first, samples_.quadric(first)};
    constexpr Index kParallelGrain = 1'024;
    const std::size_t left = node + 1, right = node + 2 * std::size_t{samples_of_[left]};
    Joined a, b;
    const auto join_left = [&] { a = join(left, first, context); };
    const auto join_right = [&] { b = join(right, first + samples_of_[left], context); };
    if (samples > kParallelGrain) context.throw_if_stopped();
    if (samples > kParallelGrain && context.thread_count() > 1) {
        tbb::parallel_invoke(join_left, join_right);
    } else {
        join_left();
        join_right();
    }
    const Vec3d apart = samples_.position(b.first) - samples_.position(a.first);
    b.place += apart;
    Joined both{first, a.quadric + referred_to(b.quadric, -apart)};
    if (!minimiser(both.quadric, both.place)) both.place = 0.5 * (a.place + b.place);
    const double error = std::max(0.0, value(both.quadric, both.place));
    costs_[node] = std::max({error * (b.place - a.place).norm(), costs_[left], costs_[right]});
    return both;
}

}  // namespace stipple
