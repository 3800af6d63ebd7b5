#include "stipple/voxel_clustering.hpp"

#include "base/first_touch.hpp"
#include "base/random.hpp"
#include "base/refuse.hpp"
#include "cloud/cloud_copy.hpp"
#include "clustering/cluster_splitting.hpp"
#include "clustering/representatives.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

// Follows: Rossignac and Borrel 1993 (one representative a cell); Whang et al. 1990 (linear
// counting: how many cells hold points, from how full a bitmap of their hashes is, so that a size
// of the search costs one look at each point and no table).

namespace stipple {

namespace {

constexpr std::size_t kBlock = 262'144;  // points between two looks at the context
constexpr unsigned kAxisBits = 21;       // of a cell's number along an axis
constexpr double kMostCells = static_cast<double>(1U << kAxisBits);

/// Cubes of one size over the box of some points.
class VoxelGrid {
public:
    VoxelGrid(const Vec3d& low, double voxel_size) : low_(low), voxels_per_unit_(1 / voxel_size) {}

    /// The cell of a point, its three numbers packed.
    std::uint64_t key(const Vec3f& p) const noexcept {
        const auto along = [&](int axis) {
            const double c = (static_cast<double>(p[axis]) - low_[axis]) * voxels_per_unit_;
            return static_cast<std::uint64_t>(
                static_cast<std::int64_t>(std::min(c, kMostCells - 1)));
        };
        return along(0) | along(1) << kAxisBits | along(2) << 2 * kAxisBits;
    }

private:
    Vec3d low_;
    double voxels_per_unit_;
};

std::uint64_t hash(std::uint64_t key) noexcept {
    constexpr std::uint64_t kFirst = 0xa0761d6478bd642fULL, kSecond = 0xe7037ed1a0b428dbULL;
    const std::uint64_t a = key ^ kFirst;
    return high_product(a, kSecond) ^ a * kSecond;
}

/// About how many cells of a grid hold any of every `stride`-th point.
double estimated_cells(std::span<const Vec3f> points, std::size_t stride, const VoxelGrid& grid,
                       std::vector<std::uint64_t>& bitmap, const RunContext& context) {
    std::ranges::fill(bitmap, 0);
    const unsigned shift = 64U - static_cast<unsigned>(std::countr_zero(64 * bitmap.size()));
    for (std::size_t begin = 0; begin < points.size(); begin += kBlock * stride) {
        context.throw_if_stopped();
        const std::size_t end = std::min(points.size(), begin + kBlock * stride);
        for (std::size_t i = begin; i < end; i += stride) {
            const std::uint64_t bit = hash(grid.key(points[i])) >> shift;
            bitmap[bit / 64] |= std::uint64_t{1} << bit % 64;
        }
    }
    std::size_t full = 0;
    for (const std::uint64_t word : bitmap) full += static_cast<std::size_t>(std::popcount(word));
    const double bits = 64.0 * static_cast<double>(bitmap.size());
    return -bits * std::log1p(-std::min(static_cast<double>(full), bits - 1) / bits);
}

/// The number of each key, given out in the order in which they come.
class KeyNumbers {
public:
    KeyNumbers(std::size_t expected, const RunContext& context)
        : context_(context),
          slots_(made_in_blocks<std::vector<Slot>>(std::bit_ceil(2 * expected + 16), context)) {}

    Index number_of(std::uint64_t key) {
        if (count_ >= slots_.size() / 2) grow();
        Slot& slot = find(key);
        if (slot.number == kEmpty) slot = {key, count_++};
        return slot.number;
    }

private:
    static constexpr Index kEmpty = std::numeric_limits<Index>::max();
    struct Slot {
        std::uint64_t key = 0;
        Index number = kEmpty;
    };

    Slot& find(std::uint64_t key) noexcept {
        std::size_t at = hash(key) & (slots_.size() - 1);
        while (slots_[at].number != kEmpty && slots_[at].key != key)
            at = (at + 1) & (slots_.size() - 1);
        return slots_[at];
    }
    void grow() {
        auto old = made_in_blocks<std::vector<Slot>>(2 * slots_.size(), context_);
        old.swap(slots_);
        for_blocks_in_order(old.size(), context_, [&](std::size_t begin, std::size_t end) {
            for (const Slot& slot : std::span(old).subspan(begin, end - begin))
                if (slot.number != kEmpty) find(slot.key) = slot;
        });
    }

    const RunContext& context_;
    std::vector<Slot> slots_;
    Index count_ = 0;
};

/// The points of each cell of the grid, cells in the order of their first points.
Clusters clusters_of(std::span<const Vec3f> points, const VoxelGrid& grid, std::size_t expected,
                     const RunContext& context) {
    KeyNumbers numbers(expected, context);
    auto cell = made_in_blocks<std::vector<Index>>(points.size(), context);
    std::vector<Index> sizes;
    for_blocks_in_order(points.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            cell[i] = numbers.number_of(grid.key(points[i]));
            if (cell[i] == sizes.size()) sizes.push_back(0);
            ++sizes[cell[i]];
        }
    });
    Clusters clusters;
    resize_in_blocks(clusters.offsets, sizes.size() + 1, context);
    std::vector<Index>& next = sizes;  // where the next point of a cell goes
    for_blocks_in_order(sizes.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t c = begin; c < end; ++c) {
            clusters.offsets[c + 1] = clusters.offsets[c] + sizes[c];
            next[c] = clusters.offsets[c];
        }
    });
    resize_in_blocks(clusters.members, points.size(), context);
    for_blocks_in_order(points.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            clusters.members[next[cell[i]]++] = static_cast<Index>(i);
    });
    return clusters;
}

struct Box {
    Vec3d low;
    double longest;  ///< side
};

Box box_of(std::span<const Vec3f> points, const RunContext& context) {
    Vec3f low = points.front(), high = low;
    for_blocks_in_order(points.size(), context, [&](std::size_t begin, std::size_t end) {
        for (const Vec3f& p : points.subspan(begin, end - begin)) {
            low = low.cwiseMin(p);
            high = high.cwiseMax(p);
        }
    });
    return {low.cast<double>(), (high.cast<double>() - low.cast<double>()).maxCoeff()};
}

/// The size of voxels of which about `wanted` hold points: along a secant, in logarithms, where
/// surfaces have a slope of -2 and lines of -1.
double searched_size(std::span<const Vec3f> points, const Box& box, double wanted,
                     const RunContext& context) {
    if (!(box.longest > 0)) return 1;
    constexpr double kNear = 0.05;         // from here the secant is trusted
    constexpr double kPointsForRough = 8;  // a voxel
    constexpr int kMostSteps = 16;
    std::vector<std::uint64_t> bitmap(
        std::bit_ceil(static_cast<std::size_t>(0.25 * wanted) + 64));  // 16 bits a voxel
    const double smallest = box.longest / kMostCells;
    std::size_t stride = std::max<std::size_t>(
        1,
        static_cast<std::size_t>(static_cast<double>(points.size()) / (kPointsForRough * wanted)));
    double log_size = std::log(box.longest / std::sqrt(wanted)), slope = -2;
    double last_log_size = 0, last_log_count = 0;
    for (int step = 0; step < kMostSteps; ++step) {
        const double count = estimated_cells(points, stride, VoxelGrid(box.low, std::exp(log_size)),
                                             bitmap, context);
        const double log_count = std::log(count), miss = std::log(wanted) - log_count;
        if (step > 0 && std::abs(log_size - last_log_size) > 0.1 * kNear) {
            slope =
                std::clamp((log_count - last_log_count) / (log_size - last_log_size), -3.0, -0.3);
        }
        last_log_size = log_size;
        last_log_count = log_count;
        log_size = std::max(log_size + std::clamp(miss / slope, -2.0, 2.0), std::log(smallest));
        if (std::abs(miss) < kNear && std::exchange(stride, 1) == 1) break;
    }
    return std::exp(log_size);
}

/// Voxels of one size, at most `target` of them and about as many.
Clusters searched_clusters(std::span<const Vec3f> points, const Box& box, std::uint64_t target,
                           const RunContext& context) {
    constexpr double kAim = 0.99;  // of the target: a little too low does, too high does not
    const auto wanted = static_cast<double>(target);
    double size = searched_size(points, box, std::max(1.0, kAim * wanted), context);
    for (double step = 1.01;; step *= 1.5) {
        Clusters clusters = clusters_of(points, VoxelGrid(box.low, size), target, context);
        if (clusters.size() <= target) return clusters;
        size *= step * std::sqrt(static_cast<double>(clusters.size()) / wanted);
    }
}

void check(const VoxelClusteringOptions& options, std::size_t points) {
    if (points == 0) refuse("the cloud has no points: expected at least 1");
    if (options.target_size.has_value() == options.voxel_size.has_value()) {
        refuse("voxel: expected either a target size or a voxel_size");
    }
    if (options.target_size && *options.target_size == 0) {
        refuse("target_size 0: expected 1..", points);
    }
}

void check_voxel_size(double size, double longest) {
    const double least = longest / kMostCells;
    if (size > 0 && size >= least && std::isfinite(size)) return;
    refuse("voxel_size ", size, ": expected a finite number above 0, at least ", least,
           ", 2^-21 of the longest side of the cloud");
}

}  // namespace

Clusters voxel_clusters(std::span<const Vec3f> points, const VoxelClusteringOptions& options,
                        const RunContext& context) {
    check(options, points.size());
    const Box box = box_of(points, context);
    if (!options.voxel_size) return searched_clusters(points, box, *options.target_size, context);
    check_voxel_size(*options.voxel_size, box.longest);
    return clusters_of(points, VoxelGrid(box.low, *options.voxel_size), 0, context);
}

PointCloud voxel_clustering(const PointCloud& cloud, const VoxelClusteringOptions& options,
                            const RunContext& context) {
    require_cleaned(cloud);
    check(options, cloud.size());
    const Reductions reductions = reductions_for(cloud, options.reductions, options.representative);
    if (options.target_size && *options.target_size >= cloud.size()) return copy_of(cloud, context);
    context.checkpoint(0.0);
    Clusters clusters = voxel_clusters(cloud.positions, options, context);
    context.checkpoint(0.6);
    if (options.target_size)
        split_clusters(cloud.positions, *options.target_size, clusters, context);
    context.checkpoint(0.85);
    PointCloud result = representatives(cloud, {clusters.members.data(), clusters.offsets},
                                        options.representative, reductions, context);
    context.checkpoint(1.0);
    return result;
}

}  // namespace stipple
