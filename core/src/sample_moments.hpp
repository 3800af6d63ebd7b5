#pragma once

#include "cluster_kernels.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

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

/// Of at least one sample, relative to `reference`, which should be near their centroid: then large
/// coordinates cost no accuracy.
inline SampleMoments moments_about(const SampleSpan& samples,
                                   const std::array<float, 3>& reference) {
    return moments_from(cluster_kernels().sums(samples, reference), samples.size,
                        {static_cast<double>(reference[0]), static_cast<double>(reference[1]),
                         static_cast<double>(reference[2])});
}

/// Surface variation (Eq. 5) of what spreads so.
inline double variation_of(const SampleMoments& moments, const Spread& spread) noexcept {
    const double total = moments.scatter.trace();
    return total > 0 ? std::max(0.0, spread.smallest) / total : 0.0;
}

/// What splitting a cluster is worth: its total variation (Eq. 3), which keeps the spacing even,
/// the more so the less flat it is. Of the forms tried (size, total variation, lambda_0 and
/// products of them) this had the lowest mean error on smooth and on rough scans; the first term
/// bounds the spacing of flat parts.
inline double gain_of_split(const SampleMoments& moments, const Spread& spread) noexcept {
    constexpr double kFlat = 0.02;
    return moments.scatter.trace() * (kFlat + std::sqrt(variation_of(moments, spread)));
}

/// Through the centroid, across the direction of largest extent.
inline SplitPlane split_plane(const SampleMoments& moments, const Spread& spread) noexcept {
    const Vec3f reference = moments.centroid.cast<float>(), normal = spread.direction.cast<float>();
    return {{reference.x(), reference.y(), reference.z()},
            {normal.x(), normal.y(), normal.z()},
            static_cast<float>(spread.direction.dot(moments.centroid - reference.cast<double>()))};
}

}  // namespace stipple
