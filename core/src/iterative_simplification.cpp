#include "stipple/iterative_simplification.hpp"

#include "contraction.hpp"
#include "contraction_quadrics.hpp"
#include "parallel_for.hpp"
#include "representatives.hpp"
#include "stipple/clusters.hpp"
#include "stipple/error.hpp"
#include "stipple/neighbors.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <sstream>
#include <utility>
#include <vector>

// Follows: Pauly, Gross, Kobbelt 2002, §3.2. The contraction itself is in contraction.cpp.

namespace stipple {

namespace {

constexpr unsigned kMinK = 3, kMaxK = 32;

std::string number(double value) {
    std::ostringstream text;
    text << value;
    return text.str();
}

void check_weight(const std::string& name, double weight) {
    if (!(weight >= 0) || !std::isfinite(weight)) {
        throw Error(ErrorCode::InvalidArgument,
                    name + " " + number(weight) + ": expected a finite number, 0 or more");
    }
}

void check(const PointCloud& cloud, const IterativeSimplificationOptions& options) {
    if (cloud.empty()) throw Error(ErrorCode::InvalidArgument, "the cloud has no points");
    if (options.k < kMinK || options.k > kMaxK) {
        throw Error(ErrorCode::InvalidArgument,
                    "k " + std::to_string(options.k) + ": expected 3..32 neighbours");
    }
    if (options.max_displacement) check_weight("max_displacement", *options.max_displacement);
    check_weight("color_weight", options.color_weight);
    for (const auto& [name, weight] : options.attribute_weights) {
        check_weight("attribute_weights: " + name, weight);
        if (find_attribute(cloud, name) == nullptr) {
            throw Error(ErrorCode::InvalidArgument,
                        "attribute_weights: the cloud has no attribute " + name);
        }
    }
    reductions_for(cloud, options.reductions, Representative::Centroid);
}

/// Values that the contraction keeps together, point by point; a difference of 1 counts as a
/// distance of 1.
struct Features {
    std::vector<float> values;
    unsigned channels = 0;

    Features(const PointCloud& cloud, const IterativeSimplificationOptions& options) {
        if (options.color_weight == 0 && options.attribute_weights.empty()) return;
        const double diagonal = bounds(cloud).diagonal();
        std::vector<std::vector<float>> columns;
        if (options.color_weight > 0 && !cloud.colors.empty()) {
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

private:
    /// Its components, each over the range of its finite values; what is not finite counts as the
    /// least of them.
    static void add_attribute(std::vector<std::vector<float>>& columns, const Attribute& attribute,
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
                        const double share = std::isfinite(value)
                                                 ? (value / 2 - least / 2) / (most / 2 - least / 2)
                                                 : 0;
                        column.push_back(static_cast<float>(weight * share));
                    }
                }
            },
            attribute.values);
    }
};

/// The samples of each survivor, in their order.
Clusters clusters_of(const ContractionSnapshot& snapshot, const RunContext& context) {
    const std::vector<Index>& survivor_of = snapshot.survivor_of;
    Clusters clusters;
    clusters.offsets.assign(snapshot.positions.size() + 1, 0);
    const auto for_samples = [&](auto&& body) {
        for_blocks_in_order(survivor_of.size(), context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) body(i);
        });
    };
    for_samples([&](std::size_t i) { ++clusters.offsets[survivor_of[i]]; });
    Index begin = 0;
    for (Index& offset : clusters.offsets) begin += std::exchange(offset, begin);
    clusters.members.resize(survivor_of.size());
    std::vector<Index> next = clusters.offsets;
    for_samples(
        [&](std::size_t i) { clusters.members[next[survivor_of[i]]++] = static_cast<Index>(i); });
    return clusters;
}

/// Moves points towards the tangent planes of the input points nearest to them until they are at
/// most `limit` away.
void bound_displacement(std::span<Vec3f> points, const std::vector<Vec3f>& input,
                        const NeighborSearch& search, double limit, const RunContext& context) {
    constexpr std::size_t kBlock = 256, kNeighborhood = 16;
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        std::array<Neighbor, kNeighborhood> room;
        std::array<Vec3d, kNeighborhood> around;
        for (std::size_t i = begin; i < end; ++i) {
            const Index nearest = search.nearest(points[i], std::span(room).first(1))[0].index;
            const Vec3f foot = input[nearest];
            std::size_t count = 0;
            for (const Neighbor& neighbor : search.nearest(foot, room))
                if (neighbor.index != nearest)
                    around[count++] = (input[neighbor.index] - foot).cast<double>();
            const Vec3d normal = normal_from(std::span(around).first(count));
            const double height = normal.dot((points[i] - foot).cast<double>());
            const double excess = std::abs(height) - limit;
            if (excess > 0) points[i] -= (std::copysign(excess, height) * normal).cast<float>();
        }
    });
}

PointCloud cloud_of(const PointCloud& cloud, ContractionSnapshot&& snapshot,
                    const IterativeSimplificationOptions& options, const RunContext& context) {
    const Clusters clusters = clusters_of(snapshot, context);
    if (options.placement == Placement::Optimal) {
        return merged_cloud(cloud, clusters, std::move(snapshot.positions), options.reductions,
                            context);
    }
    const auto reductions = reductions_for(cloud, options.reductions, Representative::Nearest);
    return merged_cloud(cloud, std::move(snapshot.positions),
                        {clusters.members.data(), clusters.offsets}, snapshot.samples, reductions,
                        true, context);
}

}  // namespace

PointCloud iterative_simplification(const PointCloud& cloud,
                                    const IterativeSimplificationOptions& options,
                                    const RunContext& context) {
    if (options.target_size == 0) {
        throw Error(ErrorCode::InvalidArgument, "target_size 0: expected at least 1");
    }
    check(cloud, options);
    if (options.target_size >= cloud.size()) return cloud;
    PointCloud result;
    const std::uint64_t size = options.target_size;
    iterative_snapshots(
        cloud, std::span(&size, 1), options, [&](PointCloud&& c) { result = std::move(c); },
        context);
    return result;
}

void iterative_snapshots(const PointCloud& cloud, std::span<const std::uint64_t> sizes,
                         const IterativeSimplificationOptions& options,
                         const std::function<void(PointCloud&&)>& on_cloud,
                         const RunContext& context) {
    check(cloud, options);
    for (std::size_t i = 0; i < sizes.size(); ++i) {
        const std::uint64_t most = i == 0 ? cloud.size() : sizes[i - 1];
        if (sizes[i] < 1 || sizes[i] > most) {
            throw Error(ErrorCode::InvalidArgument, "size " + std::to_string(sizes[i]) +
                                                        ": expected 1.." + std::to_string(most) +
                                                        ", descending");
        }
    }
    for (; !sizes.empty() && sizes.front() == cloud.size(); sizes = sizes.subspan(1))
        on_cloud(PointCloud(cloud));
    if (sizes.empty()) return;
    const Features features(cloud, options);
    std::optional<NeighborSearch> search;
    if (options.max_displacement && options.placement == Placement::Optimal)
        search.emplace(cloud.positions, context);
    contract(
        cloud.positions, {}, sizes,
        {.k = options.k,
         .placement = options.placement,
         .features = features.values,
         .channels = features.channels},
        [&](ContractionSnapshot&& snapshot) {
            if (search) {
                bound_displacement(snapshot.positions, cloud.positions, *search,
                                   *options.max_displacement, context);
            }
            on_cloud(cloud_of(cloud, std::move(snapshot), options, context));
        },
        context);
}

}  // namespace stipple
