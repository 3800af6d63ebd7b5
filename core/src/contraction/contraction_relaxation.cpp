#include "contraction/contraction_relaxation.hpp"

#include "base/parallel_for.hpp"
#include "neighbors/nearest_lists.hpp"

#include <limits>
#include <span>
#include <utility>

// Follows: Lloyd 1982 with quadrics as the distance, as Cohen-Steiner, Alliez and Desbrun 2004 use
// it to better a greedy partition.

namespace stipple {
namespace {

constexpr std::size_t kSamplesPerBlock = 1024, kSurvivorsPerBlock = 256;
constexpr unsigned kNeighbors = 8;
/// What samples add to their quadrics as points, of the weight of their planes: it keeps the
/// survivors of rough surfaces from going wherever noise tilts the planes.
constexpr double kCentroidTerm = 5e-3;

double error_at(const SharedSamples& samples, std::size_t sample, const Vec3f& survivor) {
    return value(Quadric(samples.quadrics[sample]),
                 (survivor - samples.positions[sample]).cast<double>());
}

/// The samples of each survivor, flat, in their order.
struct Shares {
    std::vector<Index> members, begin;

    Shares(std::span<const Index> survivor_of, std::size_t survivors, const RunContext& context)
        : members(survivor_of.size()), begin(survivors + 1) {
        const auto for_samples = [&](auto&& body) {
            for_blocks_in_order(members.size(), context, [&](std::size_t first, std::size_t end) {
                for (std::size_t i = first; i < end; ++i) body(i);
            });
        };
        for_samples([&](std::size_t i) { ++begin[survivor_of[i]]; });
        Index total = 0;
        for (Index& count : begin) total += std::exchange(count, total);
        std::vector<Index> next = begin;
        for_samples(
            [&](std::size_t i) { members[next[survivor_of[i]]++] = static_cast<Index>(i); });
    }
    std::span<const Index> of(std::size_t survivor) const {
        return {members.data() + begin[survivor], members.data() + begin[survivor + 1]};
    }
};

/// Moves the survivor to the minimiser of its samples, which draws it a little to their centroid.
/// @return the sample that it fits best, which stays with it.
Index settle(const SharedSamples& samples, std::span<const Index> members, Vec3f& survivor) {
    Quadric sum;
    for (const Index i : members) {
        Quadric q(samples.quadrics[i]);
        add_point(q, Vec3d::Zero(), kCentroidTerm * (q.xx + q.yy + q.zz));
        sum = sum + referred_to(q, (survivor - samples.positions[i]).cast<double>());
    }
    Vec3d y;
    if (minimiser(sum, y)) survivor = (survivor.cast<double>() + y).cast<float>();
    Index best = members.front();
    double least = std::numeric_limits<double>::infinity();
    for (const Index i : members) {
        const double error = error_at(samples, i, survivor);
        if (error < least) {
            least = error;
            best = i;
        }
    }
    return best;
}

}  // namespace

void relax(SharedSamples& samples, std::vector<Vec3f>& survivors, unsigned rounds,
           const RunContext& context) {
    std::vector<Index> anchors(survivors.size());
    const auto settle_all = [&] {
        const Shares shares(samples.survivor_of, survivors.size(), context);
        parallel_for_blocks(survivors.size(), kSurvivorsPerBlock, context,
                            [&](std::size_t begin, std::size_t end) {
                                for (std::size_t s = begin; s < end; ++s)
                                    anchors[s] = settle(samples, shares.of(s), survivors[s]);
                            });
    };
    const auto share_out = [&] {
        const NearestLists lists = nearest_lists(survivors, kNeighbors, context);
        parallel_for_blocks(samples.positions.size(), kSamplesPerBlock, context,
                            [&](std::size_t begin, std::size_t end) {
                                for (std::size_t i = begin; i < end; ++i) {
                                    const Index home = samples.survivor_of[i];
                                    if (anchors[home] == i) continue;
                                    double least = error_at(samples, i, survivors[home]);
                                    for (const Index other : lists.of(home)) {
                                        const double error = error_at(samples, i, survivors[other]);
                                        if (error < least) {
                                            least = error;
                                            samples.survivor_of[i] = other;
                                        }
                                    }
                                }
                            });
    };
    if (rounds > 0) settle_all();
    for (unsigned round = 0; round < rounds; ++round) {
        share_out();
        settle_all();
    }
}

}  // namespace stipple
