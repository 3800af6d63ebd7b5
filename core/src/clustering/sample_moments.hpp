#pragma once

#include "clustering/cluster_kernels.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>

namespace stipple {

/// Where some samples are and how they spread.
struct SampleMoments {
    std::size_t count = 0;
    Vec3d centroid = Vec3d::Zero();
    Symmetric3 scatter;  ///< sum of (p - centroid)(p - centroid)^T, Eq. 1
};

/// Moments from sums of differences to `reference`.
inline SampleMoments moments_from(const SampleSums& s, std::size_t count, const Vec3d& reference) {
    const double n = static_cast<double>(count);
    const double x = s[0] / n, y = s[1] / n, z = s[2] / n;
    return {count,
            reference + Vec3d(x, y, z),
            {s[3] - n * x * x, s[4] - n * x * y, s[5] - n * x * z, s[6] - n * y * y,
             s[7] - n * y * z, s[8] - n * z * z}};
}

/// Where the moments of samples are to be taken anew from, if these stand too far from the
/// reference for how they spread: of two clusters far apart each does from the plane between them.
/// Sums of float products keep some six digits of the squared way.
inline std::optional<std::array<float, 3>> nearer_reference(
    const SampleMoments& moments, const std::array<float, 3>& reference) noexcept {
    constexpr double kLeastSpread = 1e-4;
    const Vec3d way = moments.centroid - Vec3d(reference[0], reference[1], reference[2]);
    const double least = kLeastSpread * static_cast<double>(moments.count) * way.squaredNorm();
    if (!(moments.scatter.trace() < least)) return std::nullopt;
    const Vec3f nearer = moments.centroid.cast<float>();
    return std::array{nearer.x(), nearer.y(), nearer.z()};
}

/// Of at least one sample, relative to `reference`, which should be near their centroid: then large
/// coordinates cost no accuracy. Where it is not, about their centroid.
inline SampleMoments moments_about(const SampleSpan& samples,
                                   const std::array<float, 3>& reference) {
    const auto about = [&](const std::array<float, 3>& r) {
        return moments_from(
            cluster_kernels().sums(samples, r), samples.size,
            {static_cast<double>(r[0]), static_cast<double>(r[1]), static_cast<double>(r[2])});
    };
    const SampleMoments moments = about(reference);
    const auto nearer = nearer_reference(moments, reference);
    return nearer ? about(*nearer) : moments;
}

/// Surface variation (Eq. 5) of what spreads so.
inline double variation_of(const SampleMoments& moments, const Spread& spread) noexcept {
    const double total = moments.scatter.trace();
    return total > 0 ? std::max(0.0, spread.smallest) / total : 0.0;
}

/// Eq. 3: the sum of squared distances to the centroid.
inline double total_variation(const SampleMoments& moments) noexcept {
    return moments.scatter.trace();
}

/// What splitting a cluster is worth where the spacing is to be even: the mean squared distance to
/// the centroid, by the fourth root of the points. Where density varies, total variation leaves
/// gaps in sparse parts; the mean alone gives them so many points that dense parts lack them.
inline double width_of_cluster(const SampleMoments& moments, const Spread&) noexcept {
    const double root = std::sqrt(static_cast<double>(moments.count));
    return total_variation(moments) / (root * std::sqrt(root));
}

/// What splitting a cluster is worth: its total variation (Eq. 3), which keeps the spacing even,
/// the more so the less flat it is. Of the forms tried (size, total variation, lambda_0 and
/// products of them) this had the lowest mean error on smooth and on rough scans; the first term
/// bounds the spacing of flat parts.
inline double gain_of_split(const SampleMoments& moments, const Spread& spread) noexcept {
    constexpr double kFlat = 0.02;
    return total_variation(moments) * (kFlat + std::sqrt(variation_of(moments, spread)));
}

/// Through the centroid, across the unit vector.
inline SplitPlane plane_through_centroid(const SampleMoments& moments,
                                         const Vec3d& across) noexcept {
    const Vec3f reference = moments.centroid.cast<float>(), normal = across.cast<float>();
    return {{reference.x(), reference.y(), reference.z()},
            {normal.x(), normal.y(), normal.z()},
            static_cast<float>(across.dot(moments.centroid - reference.cast<double>()))};
}

/// Through the centroid, across the direction of largest extent.
inline SplitPlane split_plane(const SampleMoments& moments, const Spread& spread) noexcept {
    return plane_through_centroid(moments, spread.direction);
}

}  // namespace stipple
