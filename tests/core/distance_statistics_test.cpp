#include "distance_statistics.hpp"

#include <gtest/gtest.h>
#include <algorithm>
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

}  // namespace
}  // namespace stipple
