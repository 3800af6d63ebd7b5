#include "stipple/random_sampling.hpp"

#include "base/random.hpp"
#include "base/refuse.hpp"
#include "cloud/cloud_copy.hpp"

#include <vector>

// Follows: Fan, Muller, Rezucha 1962 (selection sampling; Knuth's algorithm S): a point is kept
// with the probability of what is still wanted among what is still to come.

namespace stipple {

PointCloud random_sampling(const PointCloud& cloud, const RandomSamplingOptions& options,
                           const RunContext& context) {
    if (cloud.empty()) {
        refuse("the cloud has no points: expected at least 1");
    }
    if (options.target_size == 0) {
        refuse("target_size 0: expected 1..", cloud.size());
    }
    if (options.target_size >= cloud.size()) return copy_of(cloud, context);
    constexpr std::size_t kBetweenCheckpoints = 1 << 20;
    std::vector<Index> kept;
    kept.reserve(options.target_size);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        if (i % kBetweenCheckpoints == 0) {
            context.checkpoint(0.5 * static_cast<double>(i) / static_cast<double>(cloud.size()));
        }
        const std::uint64_t wanted = options.target_size - kept.size(), left = cloud.size() - i;
        if (below(random_bits(options.seed, i), left) < wanted) {
            kept.push_back(static_cast<Index>(i));
        }
    }
    context.checkpoint(0.5);
    PointCloud result = subset(cloud, kept, context);
    context.checkpoint(1.0);
    return result;
}

}  // namespace stipple
