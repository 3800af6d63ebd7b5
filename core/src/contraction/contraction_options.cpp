#include "contraction/contraction_options.hpp"

#include "analysis/tangent_plane.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "clustering/representatives.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>

namespace stipple {

namespace {

/// The components of an attribute, each over the range of its finite values; what is not finite
/// counts as the least of them.
void add_attribute(std::vector<std::vector<float>>& columns, const Attribute& attribute,
                   double weight) {
    std::visit(
        [&](const auto& from) {
            for (unsigned c = 0; c < attribute.components; ++c) {
                double least = std::numeric_limits<double>::infinity(), most = -least;
                for (std::size_t i = c; i < from.size(); i += attribute.components) {
                    const auto value = static_cast<double>(from[i]);
                    if (!std::isfinite(value)) continue;
                    least = std::min(least, value);
                    most = std::max(most, value);
                }
                if (!(most > least)) continue;
                std::vector<float>& column = columns.emplace_back();
                for (std::size_t i = c; i < from.size(); i += attribute.components) {
                    const auto value = static_cast<double>(from[i]);
                    // Halves, since the range of doubles may be more than a double holds.
                    const double share =
                        std::isfinite(value) ? (value / 2 - least / 2) / (most / 2 - least / 2) : 0;
                    column.push_back(static_cast<float>(weight * share));
                }
            }
        },
        attribute.values);
}

}  // namespace

void check_ranges(const IterativeSimplificationOptions& options) {
    require(options.k >= 3 && options.k <= 32, "k", options.k, "3..32");
    if (options.max_displacement) {
        require_not_negative("max_displacement", *options.max_displacement);
    }
    require_not_negative("color_weight", options.color_weight);
    for (const auto& [name, weight] : options.attribute_weights) {
        require_not_negative("attribute_weights." + name, weight);
    }
}

void check_ranges(const MultiphaseOptions& options) {
    require(options.oversampling >= 1 && options.oversampling <= 1000, "oversampling",
            options.oversampling, "1 to 1000");
    check_ranges(options.contraction);
}

void check_contraction(const PointCloud& cloud, const IterativeSimplificationOptions& options) {
    if (cloud.empty()) refuse("the cloud has no points");
    check_ranges(options);
    if (options.color_weight > 0 && cloud.colors.empty()) {
        refuse("color_weight: the cloud has no colours; omit it");
    }
    for (const auto& [name, weight] : options.attribute_weights) {
        if (find_attribute(cloud, name) == nullptr) {
            refuse("attribute_weights: the cloud has no attribute ", name);
        }
    }
    reductions_for(cloud, options.reductions, Representative::Centroid);
}

Features::Features(const PointCloud& cloud, const IterativeSimplificationOptions& options) {
    const auto is_set = [](const auto& entry) { return entry.second > 0; };
    if (options.color_weight == 0 && std::ranges::none_of(options.attribute_weights, is_set))
        return;
    const double diagonal = bounds(cloud).diagonal();
    std::vector<std::vector<float>> columns;
    if (options.color_weight > 0) {
        const double scale = options.color_weight * diagonal / 255;
        for (const auto channel : {&Rgba8::r, &Rgba8::g, &Rgba8::b}) {
            std::vector<float>& column = columns.emplace_back();
            for (const Rgba8& color : cloud.colors)
                column.push_back(static_cast<float>(scale * color.*channel));
        }
    }
    for (const auto& [name, weight] : options.attribute_weights) {
        if (weight > 0) add_attribute(columns, *find_attribute(cloud, name), weight * diagonal);
    }
    channels = static_cast<unsigned>(columns.size());
    values.resize(cloud.size() * columns.size());
    for (std::size_t c = 0; c < columns.size(); ++c)
        for (std::size_t i = 0; i < cloud.size(); ++i)
            values[i * columns.size() + c] = columns[c][i];
}

void bound_displacement(std::span<Vec3f> points, const std::vector<Vec3f>& input,
                        const NeighborSearch& search, double limit, const RunContext& context) {
    constexpr std::size_t kBlock = 256, kNeighborhood = 16;
    constexpr unsigned kRounds = 8;
    constexpr double kFlat = 0.15;  // how far off a plane, of the reach of a neighbourhood
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        std::array<Neighbor, kNeighborhood> room;
        std::array<Vec3d, kNeighborhood> around;
        const auto nearest_to = [&](const Vec3f& p) {
            return search.nearest(p, std::span(room).first(1))[0].index;
        };
        const auto normal_at = [&](Index point) -> std::optional<Vec3d> {
            std::size_t count = 0;
            for (const Neighbor& neighbor : search.nearest(input[point], room))
                if (neighbor.index != point)
                    around[count++] = (input[neighbor.index] - input[point]).cast<double>();
            const Vec3d normal = normal_from(std::span(around).first(count));
            double off = 0, reach = 0;
            for (const Vec3d& way : std::span(around).first(count)) {
                off = std::max(off, std::abs(normal.dot(way)));
                reach = std::max(reach, way.norm());
            }
            return off <= std::max(limit, kFlat * reach) ? std::optional(normal) : std::nullopt;
        };
        for (Vec3f& p : points.subspan(begin, end - begin)) {
            Index nearest = nearest_to(p);
            // On the way to the plane of one another point may become the nearest.
            for (unsigned round = 0;; ++round) {
                const auto normal = normal_at(nearest);
                if (!normal) {  // as at an edge: its neighbours lie about no plane
                    const Vec3d way = (p - input[nearest]).cast<double>();
                    if (const double length = way.norm(); length > limit)
                        p = input[nearest] + (way * (limit / length)).cast<float>();
                    break;
                }
                const double height = normal->dot((p - input[nearest]).cast<double>());
                const double excess = std::abs(height) - limit;
                if (excess <= 0) break;
                if (round == kRounds) {
                    p = input[nearest];
                    break;
                }
                p -= (std::copysign(excess, height) * *normal).cast<float>();
                if (const Index before = std::exchange(nearest, nearest_to(p)); nearest == before)
                    break;
            }
        }
    });
}

}  // namespace stipple
