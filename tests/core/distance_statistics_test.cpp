#include "base/distance_statistics.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <numeric>
#include <random>
#include <utility>
#include <vector>

namespace stipple {
namespace {

class WeightedQuantiles : public ::testing::TestWithParam<int> {};

TEST_P(WeightedQuantiles, AreThoseOfTheSortedValues) {
    std::mt19937_64 random(9);
    std::exponential_distribution<float> value(3), weight(1);
    std::vector<float> values, weights;
    for (int i = 0; i < GetParam(); ++i) {
        values.push_back(i % 10 == 0 ? 0.25F : value(random));
        weights.push_back(weight(random));
    }
    std::vector<std::pair<float, float>> sorted;
    for (std::size_t i = 0; i < values.size(); ++i) sorted.emplace_back(values[i], weights[i]);
    std::ranges::sort(sorted);
    double total = 0;
    for (const float w : weights) total += w;
    const std::vector<double> parts = {0.0, 0.1, 0.5, 0.9, 0.999, 1.0};
    const auto quantiles = weighted_quantiles(values, weights, parts);
    for (std::size_t p = 0; p < parts.size(); ++p) {
        double up_to = 0;
        std::size_t at = 0;
        while (at + 1 < sorted.size() && (up_to += sorted[at].second) < parts[p] * total) ++at;
        EXPECT_NEAR(quantiles[p], sorted[at].first, 1e-3 * sorted[at].first) << parts[p];
    }
}

INSTANTIATE_TEST_SUITE_P(OfFewAndMany, WeightedQuantiles, ::testing::Values(1, 5'000, 20'000));

float total(const std::vector<float>& weights) {
    return std::accumulate(weights.begin(), weights.end(), 0.0F);
}

TEST(LimitLargest, LeavesWeightsOfWhichNoneIsMuch) {
    std::vector<float> weights(10'000, 2.0F);
    weights[5] = 15.0F;
    std::vector<float> limited = weights;
    limit_largest(limited);
    EXPECT_EQ(limited, weights);
}

TEST(LimitLargest, LeavesNoneMoreThanAFiftiethOfAll) {
    std::vector<float> weights(10'000, 1.0F);
    weights[3] = weights[9'000] = 1e30F;
    weights[4] = 1'000.0F;
    limit_largest(weights);
    EXPECT_EQ(weights[0], 1.0F);
    EXPECT_NEAR(weights[3] / total(weights), 0.02F, 1e-5F);
    EXPECT_EQ(weights[3], weights[9'000]);
    EXPECT_EQ(weights[4], weights[3]);
}

TEST(LimitLargest, LeavesNoneOfFewMoreThanEightTimesTheMean) {
    std::vector<float> weights(100, 1.0F);
    weights[42] = 1e6F;
    limit_largest(weights);
    EXPECT_NEAR(weights[42] / total(weights), 0.08F, 1e-5F);
}

TEST(LimitLargest, LeavesTheOnlyOneThereIs) {
    std::vector<float> weights(10'000, 0.0F);
    weights[7] = 3.0F;
    limit_largest(weights);
    EXPECT_EQ(weights[7], 3.0F);
}

}  // namespace
}  // namespace stipple
