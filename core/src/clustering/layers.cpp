#include "clustering/layers.hpp"

#include "base/symmetric_eigen.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace stipple {

namespace {

constexpr std::size_t kFewest = 32, kAsked = 20;

/// Whether layers that would spread samples as they do could be apart. A plate of n samples has the
/// area 12 sqrt(l1 l2) / n, and either of its layers n / 2 samples; heights of two values, a apart,
/// have the variance a^2 / 4.
bool may_be_layered(const SampleMoments& moments, const Spread& spread) noexcept {
    constexpr double kApart = 1.5;  // in distances of the samples of one
    constexpr double kLeast = 12 * kApart * kApart / 2;
    const double across = static_cast<double>(moments.count) * spread.smallest,
                 middle = moments.scatter.trace() - spread.smallest - spread.largest;
    return moments.count >= kFewest && across > 0 &&
           across * across >= kLeast * kLeast * middle * spread.largest;
}

}  // namespace

std::optional<SplitPlane> plane_between_layers(const SampleSpan& samples,
                                               const SampleMoments& moments, const Spread& spread) {
    if (!may_be_layered(moments, spread)) return std::nullopt;
    const SplitPlane plane =
        plane_through_centroid(moments, eigenvector(moments.scatter, spread.smallest));
    const auto& [x, y, z] = plane.reference;
    const Vec3f reference(x, y, z), normal(plane.normal[0], plane.normal[1], plane.normal[2]);
    const auto per_deviation = static_cast<float>(
        std::sqrt(static_cast<double>(moments.count) / spread.smallest));  // so that no power is 0
    // A few of many tell enough, but not in equal steps: points of both layers may take turns.
    const std::size_t asked = std::min(samples.size, kAsked);
    const auto place_of = [&](std::size_t i) {
        const double turns = static_cast<double>(i) * std::numbers::phi,
                     at = static_cast<double>(i) + turns - std::floor(turns);
        return static_cast<std::size_t>(at * static_cast<double>(samples.size) /
                                        static_cast<double>(asked));
    };
    const auto share = 1 / static_cast<float>(asked);
    std::array<float, kAsked> heights;
    float mean = 0;
    for (std::size_t i = 0; i < asked; ++i) {
        const Vec3f d = samples.position(place_of(i)) - reference;
        heights[i] = per_deviation * normal.dot(d);
        mean += share * heights[i];
    }
    float m2 = 0, m3 = 0, m4 = 0;  // central moments
    for (std::size_t i = 0; i < asked; ++i) {
        const float height = heights[i] - mean, square = height * height;
        m2 += share * square;
        m3 += share * square * height;
        m4 += share * square * square;
    }
    const bool layered =
        m3 * m3 + m2 * m2 * m2 > kLayered * m4 * m2 && m4 < kMostKurtosis * m2 * m2;
    return layered ? std::optional(plane) : std::nullopt;
}

}  // namespace stipple
