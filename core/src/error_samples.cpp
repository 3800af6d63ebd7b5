#include "error_samples.hpp"

#include "first_touch.hpp"
#include "nearby_search.hpp"
#include "parallel_for.hpp"
#include "random.hpp"
#include "stipple/particle_simulation.hpp"
#include "tree_search.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 4096, kBetweenChecks = 65'536;

/// The i-th random number of a seed, in [0, 1).
double random_unit(std::uint64_t seed, std::uint64_t i) noexcept {
    return static_cast<double>(random_bits(seed, i) >> 11U) * 0x1p-53;
}

Vec3f position(const PointTree& tree, std::size_t at) noexcept {
    return tree.leaf(at / PointTree::kWidth).position(at % PointTree::kWidth);
}

/// The i-th random place of a seed in the unit disk.
Eigen::Vector2f in_disk(std::uint64_t seed, std::uint64_t i) noexcept {
    constexpr std::uint64_t kTries = 32;  // more than a fifth of the square is outside, each time
    Eigen::Vector2f place;
    for (std::uint64_t t = 0; t < kTries; ++t) {
        const std::uint64_t bits = random_bits(seed, kTries * i + t);
        place = {static_cast<float>(bits >> 40U) * 0x1p-23F - 1.0F,
                 static_cast<float>(bits & 0xFFFFFFU) * 0x1p-23F - 1.0F};
        if (place.squaredNorm() <= 1.0F) return place;
    }
    return 0.5F * place;
}

constexpr std::size_t kGroup = 16;
using GroupFloats = std::array<float, 2 * kGroup>;

/// Of each of n points the squared distance to the third neighbour among them, or to the farthest
/// when there are fewer.
template <typename Floats>
Floats third_distances_sq(const Floats& x, const Floats& y, const Floats& z, std::size_t n) {
    constexpr std::size_t kNearest = 4;  // the point itself is the first
    std::array<Floats, kNearest> nearest;
    for (Floats& values : nearest) values.fill(std::numeric_limits<float>::infinity());
    for (std::size_t j = 0; j < n; ++j) {
        for (std::size_t i = 0; i < n; ++i) {
            const float dx = x[i] - x[j], dy = y[i] - y[j], dz = z[i] - z[j];
            float d = dx * dx + dy * dy + dz * dz;
            for (Floats& values : nearest) {
                const float lower = values[i] < d ? values[i] : d;
                d = values[i] < d ? d : values[i];
                values[i] = lower;
            }
        }
    }
    return nearest[std::min(kNearest, n) - 1];
}

template <typename Floats>
float median(Floats values, std::size_t n) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(n / 2);
    std::nth_element(values.begin(), middle, values.begin() + static_cast<std::ptrdiff_t>(n));
    return *middle;
}

/// The sixteen points of two leaves that follow each other; the last group has what is left, too.
struct Group {
    std::size_t first, last;

    static std::size_t count(const PointTree& tree) noexcept {
        return std::max<std::size_t>(1, tree.size() / kGroup);
    }
    static Group at(const PointTree& tree, std::size_t number) noexcept {
        const std::size_t first = number * kGroup;
        return {first, number + 1 == count(tree) ? tree.size() : first + kGroup};
    }
    float area(const PointTree& tree) const {
        GroupFloats x, y, z;
        for (std::size_t at = first; at < last; ++at) {
            const Vec3f p = position(tree, at);
            x[at - first] = p.x();
            y[at - first] = p.y();
            z[at - first] = p.z();
        }
        return median(third_distances_sq(x, y, z, last - first), last - first);
    }
};

/// Some leaves of a tree, evenly drawn: about `count`, or all where there are not many more.
std::vector<std::uint32_t> draw_leaves(const PointTree& tree, std::uint64_t count,
                                       std::uint64_t seed, const RunContext& context) {
    const std::size_t step = std::max<std::size_t>(1, tree.leaf_count() / count);
    auto leaves =
        made_in_blocks<std::vector<std::uint32_t>>((tree.leaf_count() + step - 1) / step, context);
    parallel_for_blocks(leaves.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            const std::size_t leaf = step * i + random_bits(seed, i) % step;
            leaves[i] = static_cast<std::uint32_t>(std::min(leaf, tree.leaf_count() - 1));
        }
    });
    return leaves;
}

/// An area around each point of some leaves by its leaf alone, positive unless all points coincide:
/// the median of the leaf, or what is left of the point's own where it is much larger than that; 0
/// for those that the last leaf is short of.
std::vector<float> leaf_areas(const PointTree& tree, std::span<const std::uint32_t> leaves,
                              const RunContext& context) {
    constexpr float kOfOwn = 0.125F;
    auto areas = made_in_blocks<std::vector<float>>(leaves.size() * PointTree::kWidth, context);
    parallel_for_blocks(leaves.size(), kBlock / PointTree::kWidth, context,
                        [&](std::size_t begin, std::size_t end) {
                            for (std::size_t l = begin; l < end; ++l) {
                                const PointTree::Leaf& leaf = tree.leaf(leaves[l]);
                                const std::size_t n = tree.points_in(leaves[l]);
                                const auto own = third_distances_sq(leaf.x, leaf.y, leaf.z, n);
                                const float middle = median(own, n);
                                for (std::size_t lane = 0; lane < n; ++lane)
                                    areas[l * PointTree::kWidth + lane] =
                                        std::max(middle, kOfOwn * own[lane]);
                            }
                        });
    // Some for each, so that no weight is beyond measure.
    const double total = std::accumulate(areas.begin(), areas.end(), 0.0);
    const double least = total > 0 ? 0.1 * total / static_cast<double>(areas.size()) : 1.0;
    for (float& area : areas) area += static_cast<float>(least);
    for (std::size_t lane = tree.points_in(leaves.back()); lane < PointTree::kWidth; ++lane)
        areas[areas.size() - PointTree::kWidth + lane] = 0;
    return areas;
}

/// How far from each of some points of the tree its third neighbour is.
std::vector<float> third_distances(const PointTree& tree, std::span<const Vec3f> points,
                                   const RunContext& context) {
    std::vector<float> distances(points.size());
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        std::array<Neighbor, 4> nearest;  // the point itself is the first
        const std::span<Neighbor> found =
            std::span(nearest).first(std::min(nearest.size(), tree.size()));
        for (std::size_t i = begin; i < end; ++i) {
            find_nearest(tree, points[i], found);
            distances[i] = std::sqrt(found.back().distance_sq);
        }
    });
    return distances;
}

/// The point of the tree that each of `count` draws falls on, in the order of the tree: draw i is
/// somewhere in the i-th of `count` equal parts of all areas.
std::vector<std::size_t> draw_by_area(std::span<const float> areas, std::uint64_t count,
                                      std::uint64_t seed, const RunContext& context) {
    const double total = std::accumulate(areas.begin(), areas.end(), 0.0);
    std::vector<std::size_t> drawn;
    drawn.reserve(count);
    std::size_t at = 0;
    double up_to = areas[0];
    for (std::uint64_t i = 0; i < count; ++i) {
        if (i % kBetweenChecks == 0) context.throw_if_stopped();
        const double where =
            total * (static_cast<double>(i) + random_unit(seed, i)) / static_cast<double>(count);
        while (up_to < where && at + 1 < areas.size()) up_to += areas[++at];
        drawn.push_back(at);
    }
    return drawn;
}

/// The feet of places near a surface; not a number where there is none.
std::vector<Vec3f> feet_on(const FootFinder& surface, std::span<const Vec3f> places,
                           const RunContext& context) {
    auto feet = made_in_blocks<std::vector<Vec3f>>(places.size(), context);
    const auto found = [&](std::size_t i, const Foot& foot) {
        feet[i] = foot.on_surface() ? Vec3f(foot.point.cast<float>())
                                    : Vec3f::Constant(std::numeric_limits<float>::quiet_NaN());
    };
    surface.find(places, found, context);
    return feet;
}

}  // namespace

void ErrorSamples::resize(std::size_t n, const RunContext& context) {
    resize_in_blocks(positions, n, context);
    resize_in_blocks(areas, n, context);
}

void ErrorSamples::append(const ErrorSamples& more) {
    positions.insert(positions.end(), more.positions.begin(), more.positions.end());
    areas.insert(areas.end(), more.areas.begin(), more.areas.end());
}

std::vector<float> point_areas(const PointTree& tree, const RunContext& context) {
    const std::size_t n = tree.size();
    auto areas = made_in_blocks<std::vector<float>>(n, context);
    parallel_for_blocks(Group::count(tree), kBlock / kGroup, context,
                        [&](std::size_t begin, std::size_t end) {
                            for (std::size_t g = begin; g < end; ++g) {
                                const Group group = Group::at(tree, g);
                                std::fill(areas.begin() + static_cast<std::ptrdiff_t>(group.first),
                                          areas.begin() + static_cast<std::ptrdiff_t>(group.last),
                                          group.area(tree));
                            }
                        });
    if (std::ranges::none_of(areas, [](float a) { return a > 0; })) std::ranges::fill(areas, 1.0F);
    return areas;
}

ErrorSamples take_points(const PointTree& tree, std::uint64_t count, std::uint64_t seed,
                         const RunContext& context) {
    const std::size_t n = tree.size(), m = std::min<std::uint64_t>(count, n);
    ErrorSamples samples;
    samples.resize(m, context);
    if (m == n) {
        for_blocks_in_order(n, context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t at = begin; at < end; ++at) samples.positions[at] = position(tree, at);
        });
        samples.areas = point_areas(tree, context);
        return samples;
    }
    const double step = static_cast<double>(n) / static_cast<double>(m);
    parallel_for_blocks(m, kBlock, context, [&](std::size_t begin, std::size_t end) {
        constexpr std::size_t kNearest = 9;  // the point itself is the first
        std::array<Neighbor, kNearest> nearest;
        const std::span<Neighbor> found = std::span(nearest).first(std::min(kNearest, n));
        for (std::size_t i = begin; i < end; ++i) {
            const double drawn = step * (static_cast<double>(i) + random_unit(seed, i));
            const std::size_t at = std::min(n - 1, static_cast<std::size_t>(drawn));
            samples.positions[i] = position(tree, at);
            find_nearest(tree, samples.positions[i], found);
            samples.areas[i] = found.back().distance_sq;
        }
    });
    if (std::ranges::none_of(samples.areas, [](float a) { return a > 0; }))
        std::ranges::fill(samples.areas, 1.0F);
    return samples;
}

ErrorSamples take_points_by_area(const PointTree& tree, std::uint64_t count, std::uint64_t seed,
                                 const RunContext& context) {
    const std::size_t n = tree.size();
    if (n <= count) return take_points(tree, count, seed, context);
    constexpr std::uint64_t kLeavesEach = 4;  // for each sample, to draw it from
    const std::vector<std::uint32_t> leaves = draw_leaves(tree, kLeavesEach * count, seed, context);
    const std::vector<float> areas = leaf_areas(tree, leaves, context);
    const std::vector<std::size_t> drawn = draw_by_area(areas, count, seed, context);
    ErrorSamples samples;
    samples.resize(count, context);
    parallel_for_blocks(count, kBlock, context, [&](std::size_t begin, std::size_t end) {
        constexpr std::size_t kNearest = 7, kRoom = 16;  // the point itself is one of them
        NearbySearch search(tree, kNearest, kRoom);
        for (std::size_t i = begin; i < end; ++i) {
            samples.positions[i] = tree.leaf(leaves[drawn[i] / PointTree::kWidth])
                                       .position(drawn[i] % PointTree::kWidth);
            const auto found = search.find_nearest_few(samples.positions[i]);
            const float sixth = std::ranges::max(found, {}, &Neighbor::distance_sq).distance_sq;
            samples.areas[i] = sixth / areas[drawn[i]];
        }
    });
    if (std::ranges::none_of(samples.areas, [](float a) { return a > 0; }))
        std::ranges::fill(samples.areas, 1.0F);
    return samples;
}

ErrorSamples take_surface(const PointTree& tree, const FootFinder& surface, std::uint64_t count,
                          std::uint64_t seed, const RunContext& context) {
    const std::vector<float> areas = point_areas(tree, context);
    const std::vector<std::size_t> drawn = draw_by_area(areas, count, seed, context);
    std::vector<std::size_t> used;
    std::vector<Vec3f> bases;
    for_blocks_in_order(drawn.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            if (i > 0 && drawn[i] == drawn[i - 1]) continue;
            used.push_back(drawn[i]);
            bases.push_back(position(tree, drawn[i]));
        }
    });
    auto normals = made_in_blocks<std::vector<Vec3f>>(used.size(), context);
    const std::vector<float> spacings = third_distances(tree, bases, context);
    surface.find(
        bases, [&](std::size_t i, const Foot& foot) { normals[i] = foot.normal.cast<float>(); },
        context);

    ErrorSamples samples;
    samples.resize(count, context);
    std::size_t base = 0;
    for (std::uint64_t i = 0; i < count; ++i) {
        if (i % kBetweenChecks == 0) context.throw_if_stopped();
        if (used[base] != drawn[i]) ++base;
        const Vec3f n = normals[base], u = n.unitOrthogonal(), v = n.cross(u);
        constexpr float kReach =
            0.6F;  // of the way to the third neighbour; more leads beyond borders
        const Eigen::Vector2f move = kReach * spacings[base] * in_disk(~seed, i);
        samples.positions[i] = bases[base] + move.x() * u + move.y() * v;
        samples.areas[i] = 1.0F;
    }
    const std::vector<Vec3f> feet = feet_on(surface, samples.positions, context);
    for (std::uint64_t i = 0; i < count; ++i) {
        // Where the surface is not to be found there is at least the point.
        samples.positions[i] = feet[i].allFinite() ? feet[i] : position(tree, drawn[i]);
    }
    return samples;
}

ErrorSamples take_particles(std::span<const Vec3f> points, const PointTree& tree,
                            const FootFinder& surface, std::uint64_t count, std::uint64_t seed,
                            const RunContext& context) {
    PointCloud cloud;
    cloud.positions.assign(points.begin(), points.end());
    const ParticleSimulationOptions options = {.target_size = count, .seed = seed};
    const std::vector<Vec3f> particles = particle_simulation(cloud, options, context).positions;
    // They lie on a smoother surface than the one that is measured.
    const std::vector<Vec3f> feet = feet_on(surface, particles, context);
    ErrorSamples samples;
    samples.resize(count, context);
    for (std::uint64_t i = 0; i < count; ++i) {
        samples.positions[i] = feet[i];
        if (feet[i].allFinite()) continue;
        Neighbor nearest;
        find_nearest(tree, particles[i], {&nearest, 1});
        samples.positions[i] = points[nearest.index];
    }
    std::ranges::fill(samples.areas, 1.0F);
    return samples;
}

}  // namespace stipple
