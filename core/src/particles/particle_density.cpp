#include "particles/particle_density.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"

#include <algorithm>
#include <cmath>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 4'096;

template <typename... Parts>
[[noreturn]] void refuse_region(std::size_t number, const Parts&... parts) {
    refuse("regions[", number, "]: ", parts...);
}

template <typename... Forms>
struct Overloaded : Forms... {
    using Forms::operator()...;
};

/// The width of the passage where none was chosen: enough for a dozen particles of a region that
/// many lie in.
double chosen_transition(const DensityRegion& region) {
    if (region.transition > 0) return region.transition;
    return std::visit(
        Overloaded{[](const DensityRegion::Sphere& s) { return 0.5 * s.radius; },
                   [](const DensityRegion::Box& b) { return 0.25 * (b.max - b.min).maxCoeff(); },
                   [](const DensityRegion::Scalar& s) { return 0.25 * (s.high - s.low); }},
        region.where);
}

double value_at(const Attribute& attribute, Index i) {
    return std::visit([i](const auto& values) { return static_cast<double>(values[i]); },
                      attribute.values);
}

/// How far point i is outside of the region, in the unit of its transition.
double distance_outside(const DensityRegion& region, const PointCloud& cloud, Index i) {
    const Vec3d p = cloud.positions[i].cast<double>();
    return std::visit(Overloaded{[&](const DensityRegion::Sphere& s) {
                                     return std::max(0.0, (p - s.center).norm() - s.radius);
                                 },
                                 [&](const DensityRegion::Box& b) {
                                     return (b.min - p).cwiseMax(p - b.max).cwiseMax(0.0).norm();
                                 },
                                 [&](const DensityRegion::Scalar& s) {
                                     const double v =
                                         value_at(*find_attribute(cloud, s.attribute), i);
                                     return std::isnan(v) ? std::numeric_limits<double>::infinity()
                                                          : std::max({0.0, s.low - v, v - s.high});
                                 }},
                      region.where);
}

/// 1 inside, 0 from the end of the transition on.
double membership(const DensityRegion& region, const PointCloud& cloud, Index i) {
    const double outside = distance_outside(region, cloud, i);
    if (outside <= 0) return 1;
    const double t = 1 - outside / chosen_transition(region);
    return t > 0 ? t * t * (3 - 2 * t) : 0;
}

}  // namespace

void check_ranges(const std::vector<DensityRegion>& regions) {
    for (std::size_t r = 0; r < regions.size(); ++r) {
        const DensityRegion& region = regions[r];
        constexpr double kLeast = 1e-6, kMost = 1e6;
        if (!(region.density >= kLeast && region.density <= kMost))
            refuse_region(r, "density ", region.density, ": expected ", kLeast, "..", kMost);
        if (!(region.transition >= 0 && std::isfinite(region.transition)))
            refuse_region(r, "transition ", region.transition, ": expected at least 0, finite");
        std::visit(
            Overloaded{[&](const DensityRegion::Sphere& s) {
                           if (!s.center.allFinite())
                               refuse_region(r, "center: expected finite numbers");
                           if (!(s.radius > 0 && std::isfinite(s.radius)))
                               refuse_region(r, "radius ", s.radius, ": expected above 0, finite");
                       },
                       [&](const DensityRegion::Box& b) {
                           if (!b.min.allFinite() || !b.max.allFinite())
                               refuse_region(r, "box: expected finite numbers");
                           if (!(b.min.array() <= b.max.array()).all())
                               refuse_region(r, "box: min ", b.min.transpose(), " above max ",
                                             b.max.transpose());
                       },
                       [&](const DensityRegion::Scalar& s) {
                           if (!std::isfinite(s.low) || !std::isfinite(s.high) || s.low > s.high)
                               refuse_region(r, "low ", s.low, " and high ", s.high,
                                             ": expected finite, low at most high");
                       }},
            region.where);
    }
}

void check_attributes(const std::vector<DensityRegion>& regions, const PointCloud& cloud) {
    for (std::size_t r = 0; r < regions.size(); ++r) {
        const auto* const scalar = std::get_if<DensityRegion::Scalar>(&regions[r].where);
        if (scalar == nullptr) continue;
        const Attribute* const attribute = find_attribute(cloud, scalar->attribute);
        if (attribute == nullptr) refuse_region(r, "no attribute ", scalar->attribute);
        if (attribute->components != 1)
            refuse_region(r, "attribute ", scalar->attribute, " has ", attribute->components,
                          " components: expected 1");
    }
}

float region_spacing(const std::vector<DensityRegion>& regions, const PointCloud& cloud, Index i) {
    constexpr double kMost = 7;  // of the logarithm, wherever regions overlap: a thousand times
    double log_spacing = 0;
    for (const DensityRegion& region : regions)
        log_spacing -= 0.5 * std::log(region.density) * membership(region, cloud, i);
    return static_cast<float>(std::exp(std::clamp(log_spacing, -kMost, kMost)));
}

std::vector<float> adaptive_spacing(const SurfaceSamples& samples, std::span<const float> areas,
                                    double adaptivity, double max_grading,
                                    const RunContext& context) {
    double sum = 0, area = 0;
    for_blocks_in_order(samples.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            sum += static_cast<double>(samples.variation[i]) * static_cast<double>(areas[i]);
            area += static_cast<double>(areas[i]);
        }
    });
    constexpr double kFlat = 1e-9;  // what rounding makes of a plane
    const double mean = area > 0 ? sum / area : 0;
    if (!(mean > kFlat)) return std::vector<float>(samples.size(), 1.0F);

    const double bound = 0.5 * std::log(max_grading);
    auto logs = made_in_blocks<std::vector<float>>(samples.size(), context);
    auto smooth = made_in_blocks<std::vector<float>>(samples.size(), context);
    parallel_for_blocks(samples.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const double sigma = std::max(static_cast<double>(samples.variation[i]), kFlat);
            logs[i] =
                static_cast<float>(std::clamp(adaptivity * std::log(mean / sigma), -bound, bound));
        }
    });
    // sigma_n of neighbours differs by noise, and particles lie evenly only where their radius
    // changes slowly.
    constexpr unsigned kPasses = 3;
    for (unsigned pass = 0; pass < kPasses; ++pass) {
        parallel_for_blocks(samples.size(), kBlock, context,
                            [&](std::size_t begin, std::size_t end) {
                                for (std::size_t i = begin; i < end; ++i) {
                                    const std::span<const Index> near = samples.neighbors_of(i);
                                    float total = logs[i];
                                    for (const Index j : near) total += logs[j];
                                    smooth[i] = total / static_cast<float>(1 + near.size());
                                }
                            });
        std::swap(logs, smooth);
    }
    parallel_for_blocks(samples.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) logs[i] = std::exp(logs[i]);
    });
    return logs;
}

}  // namespace stipple
