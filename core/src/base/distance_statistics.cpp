#include "base/distance_statistics.hpp"

#include "base/parallel_for.hpp"
#include "base/until_stopped.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numeric>
#include <utility>
#include <vector>

namespace stipple {

AttributeError summarize(std::string name, std::span<const float> differences,
                         std::span<const float> areas, const RunContext& context) {
    AttributeError error{.name = std::move(name)};
    double total = 0, sum = 0, sum_sq = 0;
    for_blocks_in_order(differences.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const double d = differences[i], area = areas[i];
            error.max = std::max(error.max, d);
            total += area;
            sum += area * d;
            sum_sq += area * d * d;
        }
    });
    error.mean = sum / total;
    error.rms = std::sqrt(sum_sq / total);
    return error;
}

namespace {

std::vector<double> quantiles_of_few(std::span<const float> values, std::span<const float> weights,
                                     std::span<const double> parts) {
    std::vector<std::pair<float, float>> sorted(values.size());
    for (std::size_t i = 0; i < values.size(); ++i) sorted[i] = {values[i], weights[i]};
    std::ranges::sort(sorted);
    double total = 0;
    for (const auto& [value, weight] : sorted) total += weight;
    std::vector<double> quantiles;
    for (const double part : parts) {
        double left = part * total;
        std::size_t at = 0;
        while (at + 1 < sorted.size() && sorted[at].second < left) left -= sorted[at++].second;
        quantiles.push_back(sorted.empty() ? 0.0 : sorted[at].first);
    }
    return quantiles;
}

}  // namespace

std::vector<double> weighted_quantiles(std::span<const float> values,
                                       std::span<const float> weights,
                                       std::span<const double> parts, const RunContext& context) {
    constexpr std::size_t kFew = 8'192;  // are sorted sooner than stretches are looked through
    if (values.size() <= kFew) return quantiles_of_few(values, weights, parts);
    // Floats that are not negative sort as their bits: the weight of each stretch of them first,
    // then the values of the one stretch that matters.
    constexpr unsigned kShift = 16;
    const auto stretch = [](float v) { return std::bit_cast<std::uint32_t>(v) >> kShift; };
    std::vector<double> weight_of(std::size_t{1} << (32 - kShift));
    for_blocks_in_order(values.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) weight_of[stretch(values[i])] += weights[i];
    });
    const double total = std::accumulate(weight_of.begin(), weight_of.end(), 0.0);

    std::vector<double> quantiles;
    for (const double part : parts) {
        double left = part * total;
        std::size_t chosen = 0;
        for (std::size_t s = 0; s < weight_of.size(); ++s) {
            if (weight_of[s] == 0) continue;
            chosen = s;
            if (weight_of[s] >= left) break;
            left -= weight_of[s];
        }
        std::vector<std::pair<float, float>> inside;
        for_blocks_in_order(values.size(), context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i)
                if (stretch(values[i]) == chosen) inside.emplace_back(values[i], weights[i]);
        });
        std::ranges::sort(inside, until_stopped(context, std::less<>()));
        std::size_t at = 0;
        while (at + 1 < inside.size() && inside[at].second < left) left -= inside[at++].second;
        quantiles.push_back(inside.empty() ? 0.0 : inside[at].first);
    }
    return quantiles;
}

double mean_confidence(std::span<const float> distances, std::span<const float> areas, double mean,
                       const RunContext& context) {
    constexpr double kDeviations = 1.96;  // of a normal distribution hold 95 % of it
    if (distances.size() < 2) return 0;
    // Half the squared difference of two that follow each other is the variance without what places
    // far from each other differ by, of which all have their part: they are spread evenly.
    double total = 0, spread = 0, before = 0;
    for_blocks_in_order(distances.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const double area = areas[i], from_mean = area * (distances[i] - mean);
            total += area;
            if (i > 0) spread += 0.5 * (from_mean - before) * (from_mean - before);
            before = from_mean;
        }
    });
    const auto n = static_cast<double>(distances.size());
    return kDeviations * std::sqrt(spread * n / (n - 1)) / total;
}

DirectedError summarize_distances(std::span<const float> distances, std::span<const float> areas,
                                  unsigned histogram_bins, const RunContext& context) {
    const AttributeError all = summarize("", distances, areas, context);
    DirectedError error;
    error.samples = distances.size();
    error.max = all.max;
    error.mean = all.mean;
    error.rms = all.rms;
    const auto quantiles =
        weighted_quantiles(distances, areas, std::array<double, 3>{0.50, 0.95, 0.99}, context);
    error.p50 = quantiles[0];
    error.p95 = quantiles[1];
    error.p99 = quantiles[2];

    error.histogram.resize(histogram_bins);
    const double bins = histogram_bins, by = all.max > 0 ? bins / all.max : 0.0;
    double total = 0;
    for_blocks_in_order(distances.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const double area = areas[i];
            const auto bin = static_cast<unsigned>(distances[i] * by);
            total += area;
            error.histogram[std::min(histogram_bins - 1, bin)] += area;
        }
    });
    for (double& share : error.histogram) share /= total;
    error.mean_confidence = mean_confidence(distances, areas, all.mean, context);
    return error;
}

void limit_largest(std::span<float> weights) {
    constexpr double kMostOfAll = 0.02, kMostOfFew = 8, kRounding = 1 + 1e-6;
    const double most = std::max(kMostOfAll, kMostOfFew / static_cast<double>(weights.size()));
    // Less of the large ones is less of all: until both agree.
    double limit = std::numeric_limits<double>::infinity();
    for (;;) {
        double rest = 0, largest = 0, beyond = 0;  // the last how many
        for (const double weight : weights) {
            largest = std::max(largest, std::min(weight, limit));
            (weight < limit ? rest : beyond) += weight < limit ? weight : 1;
        }
        if (rest == 0) return;
        const double total = beyond == 0 ? rest : rest + beyond * limit;
        if (most * beyond >= 1 || largest <= kRounding * most * total) break;
        limit = most * rest / (1 - most * beyond);
    }
    for (float& weight : weights) weight = std::min(weight, static_cast<float>(limit));
}

}  // namespace stipple
