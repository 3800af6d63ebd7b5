#include "error/error_samples.hpp"

#include "analysis/tangent_plane.hpp"
#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/random.hpp"
#include "neighbors/nearby_search.hpp"
#include "neighbors/nearest_kernels.hpp"
#include "neighbors/tree_search.hpp"
#include "stipple/particle_simulation.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <ranges>
#include <span>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 4096, kBetweenChecks = 65'536;
constexpr std::size_t kThird = 3, kAround = 8;  // neighbours

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

/// Which of some areas each of `count` draws falls on, ascending: draw i is somewhere in the i-th
/// of `count` equal parts of all areas.
/// @param chances  by which each eight areas are divided; none: by nothing.
std::vector<std::size_t> draw_by_area(std::span<const float> areas, std::span<const float> chances,
                                      std::uint64_t count, std::uint64_t seed,
                                      const RunContext& context) {
    // Eight at once, since a sum waits for the one before.
    constexpr std::size_t kEight = 8;
    const auto chance_of = [&](std::size_t i) {
        return chances.empty() ? 1.0 : static_cast<double>(chances[i / kEight]);
    };
    const auto eight_from = [&](std::size_t first) {
        double sum = 0;
        for (const float area : areas.subspan(first, std::min(kEight, areas.size() - first)))
            sum += area;
        return sum / chance_of(first);
    };
    double total = 0;
    for (std::size_t first = 0; first < areas.size(); first += kEight) total += eight_from(first);
    std::vector<std::size_t> drawn;
    drawn.reserve(count);
    std::size_t first = 0;
    double before = 0, eight = eight_from(0);
    for (std::uint64_t i = 0; i < count; ++i) {
        if (i % kBetweenChecks == 0) context.throw_if_stopped();
        const double where =
            total * (static_cast<double>(i) + random_unit(seed, i)) / static_cast<double>(count);
        while (before + eight < where && first + kEight < areas.size()) {
            before += eight;
            eight = eight_from(first += kEight);
        }
        const std::size_t last = std::min(first + kEight, areas.size()) - 1;
        const double chance = chance_of(first);
        std::size_t at = first;
        for (double up_to = before + areas[at] / chance; up_to < where && at < last;)
            up_to += areas[++at] / chance;
        while (areas[at] == 0 && at > first) --at;  // where rounding led behind all areas
        drawn.push_back(at);
    }
    return drawn;
}

/// For each leaf of a tree the area of the largest side of its box, and some more, so that none is
/// zero.
std::vector<float> leaf_sizes(const LonePoints& points, const RunContext& context) {
    const PointTree& tree = points.tree();
    constexpr std::size_t kWidth = PointTree::kWidth;
    constexpr double kLeast = 0.1;  // of the mean
    auto sizes = made_in_blocks<std::vector<float>>(tree.leaf_count(), context);
    parallel_for_blocks(sizes.size(), kBlock * kWidth, context,
                        [&](std::size_t begin, std::size_t end) {
                            for (std::size_t l = begin; l < end; ++l) {
                                const PointTree::Node& node = tree.node(0, l / kWidth);
                                const auto side = [&](std::size_t axis) {
                                    return node.high[axis][l % kWidth] - node.low[axis][l % kWidth];
                                };
                                const float x = side(0), y = side(1), z = side(2);
                                sizes[l] = std::max({x * y, y * z, z * x});
                            }
                        });
    const float largest = PointTree::kWidth * points.largest();
    for (float& size : sizes) size = std::min(size, largest);
    const double total = std::accumulate(sizes.begin(), sizes.end(), 0.0);
    const double least = total > 0 ? kLeast * total / static_cast<double>(sizes.size()) : 1.0;
    for (float& size : sizes) size += static_cast<float>(least);
    return sizes;
}

/// Some leaves of a tree, ascending, maybe some of them twice.
struct DrawnLeaves {
    std::vector<std::uint32_t> leaves;
    std::vector<float> chances;  ///< how likely each was to be drawn, up to a common factor
};

/// Leaves to draw `count` points from: large ones more often, or all where there are not many.
DrawnLeaves draw_leaves(const LonePoints& points, std::uint64_t count, std::uint64_t seed,
                        const RunContext& context) {
    const PointTree& tree = points.tree();
    constexpr std::uint64_t kOfEach = 8;
    DrawnLeaves drawn;
    if (tree.leaf_count() <= kOfEach * count) {
        drawn.leaves.resize(tree.leaf_count());
        std::iota(drawn.leaves.begin(), drawn.leaves.end(), 0U);
        drawn.chances.assign(tree.leaf_count(), 1.0F);
        return drawn;
    }
    const std::vector<float> sizes = leaf_sizes(points, context);
    for (const std::size_t leaf : draw_by_area(sizes, {}, kOfEach * count, seed, context)) {
        drawn.leaves.push_back(static_cast<std::uint32_t>(leaf));
        drawn.chances.push_back(sizes[leaf]);
    }
    return drawn;
}

/// An area around each point of some leaves, up to a common factor, positive unless all points
/// coincide: as `areas_around` has it, by neighbours in the leaf and beside it on the curve alone;
/// 0 for those that the last leaf is short of.
std::vector<float> leaf_areas(const LonePoints& points, const DrawnLeaves& drawn,
                              const RunContext& context) {
    const PointTree& tree = points.tree();
    const auto& [leaves, chances] = drawn;
    const float largest = points.largest();
    auto areas = made_in_blocks<std::vector<float>>(leaves.size() * PointTree::kWidth, context);
    parallel_for_blocks(leaves.size(), kBlock / PointTree::kWidth, context,
                        [&](std::size_t begin, std::size_t end) {
                            const NearestKernels& kernels = nearest_kernels();
                            for (std::size_t l = begin; l < end; ++l) {
                                float* const here = &areas[l * PointTree::kWidth];
                                kernels.spread(tree.view(), leaves[l], here);
                                for (std::size_t lane = 0; lane < PointTree::kWidth; ++lane)
                                    here[lane] = std::min(here[lane], largest);
                                const std::size_t n = tree.points_in(leaves[l]);
                                std::fill(here + n, here + PointTree::kWidth, 0.0F);
                            }
                        });
    // Some for each, so that no weight is beyond measure.
    double total = 0, count = 0;
    for (std::size_t l = 0; l < leaves.size(); ++l) {
        double sum = 0;
        for (std::size_t lane = 0; lane < PointTree::kWidth; ++lane)
            sum += areas[l * PointTree::kWidth + lane];
        total += sum / chances[l];
        count += PointTree::kWidth / static_cast<double>(chances[l]);
    }
    const double least = total > 0 ? 0.1 * total / count : 1.0;
    for (std::size_t l = 0; l < leaves.size(); ++l) {
        const std::size_t n = tree.points_in(leaves[l]);
        for (std::size_t lane = 0; lane < n; ++lane)
            areas[l * PointTree::kWidth + lane] += static_cast<float>(least);
    }
    return areas;
}

/// Finds the squared distances of places to the points nearest to them; quickest for places that
/// follow each other in the tree.
class NearestDistances {
public:
    NearestDistances(const PointTree& tree, std::size_t count)
        : count_(std::min(count, tree.size())),
          search_(tree, count, 2 * count),
          distances_sq_(2 * count) {}

    /// The sum of the `count` least, or of all where there are fewer.
    double sum_of_least(const Vec3f& place) {
        const std::span<const Neighbor> found = search_.find(place);
        const std::span<float> distances_sq = std::span(distances_sq_).first(found.size());
        std::ranges::transform(found, distances_sq.begin(), &Neighbor::distance_sq);
        double sum = 0;
        float largest = 0;
        std::size_t n = 0;
        for (const float d : distances_sq) {
            // Counting the nearer ones of so few takes less time than sorting.
            std::uint32_t nearer = 0;
            for (const float other : distances_sq) nearer += static_cast<std::uint32_t>(other < d);
            if (nearer >= count_) continue;
            largest = std::max(largest, d);
            sum += d;
            ++n;
        }
        return sum - static_cast<double>(n - count_) * largest;  // of those as far as the last
    }

private:
    std::size_t count_;
    NearbySearch search_;
    std::vector<float> distances_sq_;
};

/// The points of the tree that an array of their numbers, or such a range, names.
template <typename Numbers>
std::vector<Vec3f> points_of(const PointTree& tree, const Numbers& numbers,
                             const RunContext& context) {
    auto points = made_in_blocks<std::vector<Vec3f>>(numbers.size(), context);
    for_blocks_in_order(points.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) points[i] = tree.position(numbers[i]);
    });
    return points;
}

std::vector<Vec3f> all_points(const PointTree& tree, const RunContext& context) {
    return points_of(tree, std::views::iota(std::size_t{0}, tree.size()), context);
}

/// The feet of places near a surface; not a number where there is none, as beyond its border.
std::vector<Vec3f> feet_on(const FootFinder& surface, std::span<const Vec3f> places,
                           const RunContext& context) {
    auto feet = made_in_blocks<std::vector<Vec3f>>(places.size(), context);
    const auto found = [&](std::size_t i, const Foot& foot) {
        const Vec3f place = foot.point.cast<float>();
        const bool is_there = foot.on_surface() && surface.overhang_of(place, foot).way == 0;
        feet[i] = is_there ? place : Vec3f::Constant(std::numeric_limits<float>::quiet_NaN());
    };
    surface.find(places, found, context);
    return feet;
}

/// How the points nearest to one lie around it.
struct Around {
    Vec3f normal = Vec3f::UnitZ();
    Vec3f along = Vec3f::UnitX();  ///< the line that they lie on, as those of a wire do
    float across = 1;      ///< how far from it places are drawn: 1 on a surface, 0 on a line
    float spacing_sq = 0;  ///< the squared distance to the third
};

/// @param nearest  of `points` to one of them, that itself the first. @param ways  room.
Around around_point(std::span<const Neighbor> nearest, std::span<const Vec3f> points,
                    std::vector<Vec3d>& ways) {
    constexpr double kLine = 0.01, kSurface = 0.04;  // λ1 / λ2
    ways.clear();
    const Vec3f& point = points[nearest.front().index];
    for (const Neighbor& neighbor : nearest.subspan(1))
        ways.push_back((points[neighbor.index] - point).cast<double>());
    const Symmetric3 scatter = scatter_of(ways);
    const auto [least, middle, largest] = eigenvalues(scatter);
    Around around = {.normal = eigenvector(scatter, least).cast<float>(),
                     .spacing_sq = nearest[std::min(kThird, nearest.size() - 1)].distance_sq};
    if (middle < kSurface * largest) {
        around.along = eigenvector(scatter, largest).cast<float>();
        around.across =
            static_cast<float>(std::max(0.0, (middle / largest - kLine) / (kSurface - kLine)));
    }
    return around;
}

/// A point moved in its tangent plane by the i-th random way of a seed.
Vec3f moved(const Vec3f& point, const Around& around, std::uint64_t seed, std::uint64_t i) {
    const Vec3f& normal = around.normal;
    const Eigen::Vector2f move = kPlaceReach * std::sqrt(around.spacing_sq) * in_disk(~seed, i);
    if (around.across < 1) {
        // There the third neighbour is twice as far as the next.
        const float reach = 0.5F + 0.5F * around.across;
        const Vec3f v = normal.cross(around.along).stableNormalized();
        return point + reach * move.x() * around.along + around.across * move.y() * v;
    }
    const Vec3f u = normal.unitOrthogonal(), v = normal.cross(u);
    return point + move.x() * u + move.y() * v;
}

/// The feet of places; the base of one that has none, or whose base is alone.
std::vector<Vec3f> feet_or(std::span<const Vec3f> bases, std::span<const std::uint8_t> alone,
                           const FootFinder& surface, std::span<const Vec3f> places,
                           const RunContext& context) {
    std::vector<Vec3f> feet = feet_on(surface, places, context);
    for (std::size_t i = 0; i < feet.size(); ++i) {
        // Where the surface is not to be found there is at least the point.
        if (!feet[i].allFinite() || alone[i] != 0) feet[i] = bases[i];
    }
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
    numbers.insert(numbers.end(), more.numbers.begin(), more.numbers.end());
    doubtful_sq.insert(doubtful_sq.end(), more.doubtful_sq.begin(), more.doubtful_sq.end());
}

PointAreas areas_around(const LonePoints& points, std::span<const Vec3f> which,
                        const RunContext& context) {
    constexpr std::size_t kEight = 8;
    const PointTree& tree = points.tree();
    PointAreas around = {.areas = made_in_blocks<std::vector<float>>(which.size(), context),
                         .doubtful_sq = made_in_blocks<std::vector<float>>(which.size(), context)};
    auto& [areas, doubtful_sq] = around;
    parallel_for_blocks(which.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        NearestDistances nearest(tree, kEight + 1);
        const auto count = static_cast<double>(std::min(kEight + 1, tree.size()));
        for (std::size_t i = begin; i < end; ++i) {
            const auto mean = static_cast<float>(nearest.sum_of_least(which[i]) / count);
            const LonePoints::Area area = points.area_of(which[i], mean);
            areas[i] = area.area;
            doubtful_sq[i] = area.doubtful_sq;
        }
    });
    if (std::ranges::none_of(areas, [](float a) { return a > 0; })) std::ranges::fill(areas, 1.0F);
    return around;
}

ErrorSamples take_points(const LonePoints& points, std::uint64_t count, std::uint64_t seed,
                         const RunContext& context) {
    const PointTree& tree = points.tree();
    const std::size_t n = tree.size(), m = std::min<std::uint64_t>(count, n);
    ErrorSamples samples;
    if (m == n) {
        samples.positions = all_points(tree, context);
    } else {
        const double step = static_cast<double>(n) / static_cast<double>(m);
        samples.positions = made_in_blocks<std::vector<Vec3f>>(m, context);
        for_blocks_in_order(m, context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                const double drawn = step * (static_cast<double>(i) + random_unit(seed, i));
                const auto at = std::min(n - 1, static_cast<std::size_t>(drawn));
                samples.positions[i] = tree.position(at);
            }
        });
    }
    auto [areas, doubtful_sq] = areas_around(points, samples.positions, context);
    samples.areas = std::move(areas);
    samples.doubtful_sq = std::move(doubtful_sq);
    return samples;
}

ErrorSamples draw_points_by_area(const LonePoints& points, std::uint64_t count, std::uint64_t seed,
                                 const RunContext& context) {
    const DrawnLeaves some = draw_leaves(points, count, ~seed, context);
    const auto& [leaves, chances] = some;
    const std::vector<float> areas = leaf_areas(points, some, context);
    const std::vector<std::size_t> drawn = draw_by_area(areas, chances, count, seed, context);
    ErrorSamples samples;
    samples.numbers = made_in_blocks<std::vector<std::size_t>>(count, context);
    for (std::size_t i = 0; i < count; ++i)
        samples.numbers[i] =
            leaves[drawn[i] / PointTree::kWidth] * PointTree::kWidth + drawn[i] % PointTree::kWidth;
    samples.positions = points_of(points.tree(), samples.numbers, context);
    samples.areas = made_in_blocks<std::vector<float>>(count, context);
    for (std::size_t i = 0; i < count; ++i) samples.areas[i] = areas[drawn[i]];
    return samples;
}

ErrorSamples take_points_by_area(const LonePoints& points, std::uint64_t count, std::uint64_t seed,
                                 const RunContext& context) {
    if (points.tree().size() <= count) return take_points(points, count, seed, context);
    ErrorSamples samples = draw_points_by_area(points, count, seed, context);
    auto [areas, doubtful_sq] = areas_around(points, samples.positions, context);
    samples.doubtful_sq = std::move(doubtful_sq);
    for (std::size_t i = 0; i < count; ++i) samples.areas[i] = areas[i] / samples.areas[i];
    return samples;
}

SurfacePlaces random_places(const LonePoints& points, const FootFinder& surface,
                            std::span<const Vec3f> bases, std::uint64_t seed,
                            const RunContext& context) {
    std::vector<Vec3f> used;
    for_blocks_in_order(bases.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            if (i == 0 || bases[i] != bases[i - 1]) used.push_back(bases[i]);
    });
    auto around = made_in_blocks<std::vector<Around>>(used.size(), context);
    auto lone = made_in_blocks<std::vector<std::uint8_t>>(used.size(), context);
    parallel_for_blocks(used.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        NearbySearch search(points.tree(), kAround + 1, 2 * kAround + 2);
        std::vector<Vec3d> ways;
        for (std::size_t i = begin; i < end; ++i) {
            const std::span<Neighbor> nearest = search.find_nearest_few(used[i]);
            std::ranges::sort(nearest);  // the point itself comes first
            around[i] = around_point(nearest, surface.points(), ways);
            lone[i] = points.holds(used[i], std::sqrt(around[i].spacing_sq)) ? 1 : 0;
        }
    });
    surface.find(
        used,
        [&](std::size_t i, const Foot& foot) { around[i].normal = foot.normal.cast<float>(); },
        context);

    auto places = made_in_blocks<std::vector<Vec3f>>(bases.size(), context);
    auto alone = made_in_blocks<std::vector<std::uint8_t>>(bases.size(), context);
    std::size_t base = 0;
    for (std::size_t i = 0; i < bases.size(); ++i) {
        if (i % kBetweenChecks == 0) context.throw_if_stopped();
        if (i > 0 && bases[i] != bases[i - 1]) ++base;
        places[i] = moved(used[base], around[base], seed, i);
        alone[i] = lone[base];
    }
    SurfacePlaces found = {.positions = feet_or(bases, alone, surface, places, context),
                           .doubtful_sq = {}};
    for (const std::uint8_t is_alone : alone)
        found.doubtful_sq.push_back(is_alone != 0 ? 0 : std::numeric_limits<float>::infinity());
    return found;
}

std::vector<Vec3f> places_beside(const LonePoints& points, const FootFinder& surface,
                                 std::span<const Vec3f> bases, std::uint64_t seed,
                                 const RunContext& context) {
    auto places = made_in_blocks<std::vector<Vec3f>>(bases.size(), context);
    auto is_lone = made_in_blocks<std::vector<std::uint8_t>>(bases.size(), context);
    parallel_for_blocks(bases.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        NearbySearch search(points.tree(), kAround + 1, 2 * kAround + 2);
        std::vector<Vec3d> ways;
        for (std::size_t i = begin; i < end; ++i) {
            const std::span<Neighbor> nearest = search.find_nearest_few(bases[i]);
            std::ranges::sort(nearest);  // the point itself comes first
            const Around around = around_point(nearest, surface.points(), ways);
            places[i] = moved(bases[i], around, seed, i);
            is_lone[i] = points.holds(nearest) ? 1 : 0;
        }
    });
    return feet_or(bases, is_lone, surface, places, context);
}

std::vector<Vec3f> draw_points(const LonePoints& points, std::uint64_t count, std::uint64_t seed,
                               const RunContext& context) {
    const PointTree& tree = points.tree();
    const std::vector<float> areas = areas_around(points, all_points(tree, context), context).areas;
    return points_of(tree, draw_by_area(areas, {}, count, seed, context), context);
}

ErrorSamples take_surface(const LonePoints& points, const FootFinder& surface, std::uint64_t count,
                          std::uint64_t seed, const RunContext& context) {
    auto [positions, doubtful_sq] =
        random_places(points, surface, draw_points(points, count, seed, context), seed, context);
    return {.positions = std::move(positions),
            .areas = std::vector<float>(count, 1.0F),
            .numbers = {},
            .doubtful_sq = std::move(doubtful_sq)};
}

ErrorSamples take_surface_by_area(const LonePoints& points, const FootFinder& surface,
                                  std::uint64_t count, std::uint64_t seed,
                                  const RunContext& context) {
    ErrorSamples samples = take_points_by_area(points, count, seed, context);
    auto [positions, doubtful_sq] =
        random_places(points, surface, samples.positions, seed, context);
    samples.positions = std::move(positions);
    samples.doubtful_sq = std::move(doubtful_sq);
    samples.numbers.clear();
    return samples;
}

ErrorSamples take_particles(const LonePoints& points, const FootFinder& surface,
                            std::uint64_t count, std::uint64_t seed, const RunContext& context) {
    PointCloud cloud;
    cloud.positions.assign(surface.points().begin(), surface.points().end());
    const ParticleSimulationOptions options = {.target_size = count, .seed = seed};
    const std::vector<Vec3f> particles = particle_simulation(cloud, options, context).positions;
    // They lie on a smoother surface than the one that is measured.
    const std::vector<Vec3f> feet = feet_on(surface, particles, context);
    ErrorSamples samples;
    samples.resize(count, context);
    parallel_for_blocks(count, kBlock, context, [&](std::size_t begin, std::size_t end) {
        std::array<Neighbor, kThird + 1> room;
        for (std::size_t i = begin; i < end; ++i) {
            const std::span<const Neighbor> found = find_nearest(points.tree(), particles[i], room);
            const Vec3f nearest = surface.points()[found.front().index];
            const bool is_lone = points.holds(nearest, std::sqrt(found.back().distance_sq));
            samples.positions[i] = feet[i].allFinite() && !is_lone ? feet[i] : nearest;
        }
    });
    std::ranges::fill(samples.areas, 1.0F);
    return samples;
}

}  // namespace stipple
