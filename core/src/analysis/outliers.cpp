#include "stipple/outliers.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "base/symmetric_eigen.hpp"
#include "cloud/kept_points.hpp"
#include "neighbors/leaf_query.hpp"
#include "neighbors/point_tree.hpp"
#include "neighbors/tree_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

// Follows: Rusu, Marton, Blodow, Dolha and Beetz 2008, "Towards 3D point cloud based object maps
// for household environments", whose rule (d above the mean by some standard deviations) PCL,
// Open3D and CloudCompare have. It loses 3 to 4 % of a clean scan, takes sparse parts for outliers,
// and finds none among dense ones, where density varies. So logarithms of d take the place of d, as
// densities differ by factors; flat and thin neighbourhoods are kept; and d is also compared with
// that of the neighbours, as Breunig, Kriegel, Ng and Sander 2000 (LOF) do.

namespace stipple {

namespace {

constexpr std::size_t kWidth = PointTree::kWidth;
constexpr std::size_t kLeavesPerBlock = 128;
constexpr unsigned kNeighbors = 12;

/// Sums over the points of a block, of the logarithms of their distances.
struct LogSums {
    double sum = 0, squares = 0;
};

/// Mean distances of the points from their neighbours, by place in the tree, and what usual ones
/// are.
struct Distances {
    std::vector<float> of_place;
    double usual_log = 0, spread = 0;  ///< mean and standard deviation of their logarithms
};

Distances mean_distances(std::span<const Vec3f> points, const PointTree& tree,
                         const RunContext& context) {
    Distances distances;
    resize_in_blocks(distances.of_place, tree.leaf_count() * kWidth, context);
    std::vector<LogSums> blocks((tree.leaf_count() + kLeavesPerBlock - 1) / kLeavesPerBlock);
    parallel_for_blocks(
        tree.leaf_count(), kLeavesPerBlock, context, [&](std::size_t begin, std::size_t end) {
            LeafQuery query(tree, points, kNeighbors);
            std::vector<float> distances_sq(query.most_chosen());
            LogSums sums;
            for (std::size_t l = begin; l < end; ++l) {
                query.run(l, [&](std::size_t lane, const Candidates&, const Chosen& chosen) {
                    for (std::uint32_t i = 0; i < chosen.count; ++i)
                        distances_sq[chosen.rank[i]] = chosen.distance_sq[i];
                    using Nearest = Eigen::Array<float, kNeighbors, 1>;
                    const float mean = Eigen::Map<const Nearest>(distances_sq.data()).sqrt().mean();
                    // Squares of distinct points can still be 0.
                    const float d = std::max(mean, std::numeric_limits<float>::min());
                    distances.of_place[l * kWidth + lane] = d;
                    const double log = std::log(d);
                    sums.sum += log;
                    sums.squares += log * log;
                });
            }
            blocks[begin / kLeavesPerBlock] = sums;
        });
    LogSums all;
    for (const LogSums& block : blocks) {
        all.sum += block.sum;
        all.squares += block.squares;
    }
    const auto n = static_cast<double>(tree.size());
    distances.usual_log = all.sum / n;
    distances.spread =
        std::sqrt(std::max(0.0, all.squares / n - distances.usual_log * distances.usual_log));
    return distances;
}

/// A point and its neighbours.
using Nearest = std::array<Neighbor, kNeighbors + 1>;

/// Whether it is neither a piece of a surface nor of a line.
bool is_thick(std::span<const Neighbor> nearest, std::span<const Vec3f> points) {
    constexpr double kFlat = 0.1;  // λ0 / λ1
    Vec3d mean = Vec3d::Zero();
    for (const Neighbor& neighbor : nearest) mean += points[neighbor.index].cast<double>();
    mean /= static_cast<double>(nearest.size());
    Symmetric3 covariance;
    for (const Neighbor& neighbor : nearest) {
        const Vec3d way = points[neighbor.index].cast<double>() - mean;
        covariance.xx += way.x() * way.x();
        covariance.xy += way.x() * way.y();
        covariance.xz += way.x() * way.z();
        covariance.yy += way.y() * way.y();
        covariance.yz += way.y() * way.z();
        covariance.zz += way.z() * way.z();
    }
    const auto values = eigenvalues(covariance);
    return values[0] > kFlat * values[1];
}

/// Tells outliers by the distances of all points.
class OutlierRule {
public:
    OutlierRule(std::span<const Vec3f> points, const PointTree& tree, const Distances& distances,
                double deviations, const RunContext& context)
        : points_(points), tree_(tree), distances_(distances.of_place) {
        const double times = 1.0 + deviations / 2;
        times_ = static_cast<float>(times);
        far_ = static_cast<float>(std::exp(
            distances.usual_log + std::max(std::log(times), deviations * distances.spread)));
        resize_in_blocks(of_point_, points.size(), context);
        parallel_for_blocks(
            tree.leaf_count(), kLeavesPerBlock, context, [&](std::size_t begin, std::size_t end) {
                for (std::size_t l = begin; l < end; ++l)
                    for (std::size_t lane = 0; lane < tree.points_in(l); ++lane)
                        of_point_[tree.leaf(l).index[lane]] = distances_[l * kWidth + lane];
            });
    }

    /// Marks the outliers of a leaf. Only points far in the whole cloud are looked at, and those
    /// much farther from their neighbours than some of the points beside them on the curve are:
    /// such points mostly are neighbours.
    void mark(std::size_t leaf, std::vector<std::uint8_t>& marks) const {
        const std::size_t from = leaf == 0 ? 0 : (leaf - 1) * kWidth,
                          to = std::min((leaf + 2) * kWidth, tree_.size());
        const float least =
            *std::min_element(distances_.begin() + static_cast<std::ptrdiff_t>(from),
                              distances_.begin() + static_cast<std::ptrdiff_t>(to));
        for (std::size_t lane = 0; lane < tree_.points_in(leaf); ++lane) {
            const float d = distances_[leaf * kWidth + lane];
            if (d <= far_ && d <= times_ * least) continue;
            if (is_outlier(tree_.leaf(leaf).position(lane), d))
                marks[tree_.leaf(leaf).index[lane]] = 1;
        }
    }

    /// Whether a point is far in the whole cloud.
    bool is_far(Index i) const noexcept { return of_point_[i] > far_; }

    /// Whether most of a point's neighbours are outliers.
    bool is_among(Index i, const std::vector<std::uint8_t>& marks) const {
        Nearest room;
        const std::span<const Neighbor> nearest = find_nearest(tree_, points_[i], room);
        return std::ranges::count_if(nearest, [&](const Neighbor& neighbor) {
                   return marks[neighbor.index] != 0;
               }) > std::ptrdiff_t{kNeighbors / 2};
    }

private:
    bool is_outlier(const Vec3f& position, float d) const {
        Nearest room;
        const std::span<const Neighbor> nearest = find_nearest(tree_, position, room);
        if (d > far_ && is_thick(nearest, points_)) return true;
        std::array<float, kNeighbors> others{};
        for (std::size_t i = 0; i < kNeighbors; ++i)
            others[i] = of_point_[nearest[i + 1].index];  // the first is the point itself
        std::ranges::nth_element(others, others.begin() + kNeighbors / 2);
        return d > times_ * others[kNeighbors / 2];
    }

    std::span<const Vec3f> points_;
    const PointTree& tree_;
    const std::vector<float>& distances_;  ///< by place in the tree
    std::vector<float> of_point_;
    float times_ = 0;  ///< so much farther than neighbours
    float far_ = 0;    ///< farther than this from them is far in the whole cloud
};

/// Marks what looks like a piece of a surface by chance: far points, mostly among outliers.
void mark_flat_outliers(const OutlierRule& rule, std::vector<std::uint8_t>& marks,
                        const RunContext& context) {
    std::vector<Index> unmarked;
    for_blocks_in_order(marks.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            if (marks[i] == 0 && rule.is_far(static_cast<Index>(i)))
                unmarked.push_back(static_cast<Index>(i));
    });
    auto among = made_in_blocks<std::vector<std::uint8_t>>(unmarked.size(), context);
    parallel_for_blocks(unmarked.size(), 1024, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) among[i] = rule.is_among(unmarked[i], marks);
    });
    for (std::size_t i = 0; i < unmarked.size(); ++i) marks[unmarked[i]] = among[i];
}

/// 1 for each outlier; empty if none can be.
std::vector<std::uint8_t> marks_of_outliers(std::span<const Vec3f> points,
                                            const OutlierOptions& options,
                                            const RunContext& context) {
    validate(options);
    std::vector<std::uint8_t> marks;
    if (points.size() <= kNeighbors) return marks;
    resize_in_blocks(marks, points.size(), context);
    const PointTree tree(points, PointTree::Leaves::Quick, context);
    context.checkpoint(0.4);
    const Distances distances = mean_distances(points, tree, context);
    context.checkpoint(0.9);
    const OutlierRule rule(points, tree, distances, options.deviations, context);
    parallel_for_blocks(tree.leaf_count(), kLeavesPerBlock, context,
                        [&](std::size_t begin, std::size_t end) {
                            for (std::size_t l = begin; l < end; ++l) rule.mark(l, marks);
                        });
    mark_flat_outliers(rule, marks, context);
    return marks;
}

}  // namespace

void validate(const OutlierOptions& options) {
    require(options.deviations >= 1 && options.deviations <= 100, "remove_outliers",
            options.deviations, "1..100 standard deviations");
}

std::vector<Index> find_outliers(std::span<const Vec3f> points, const OutlierOptions& options,
                                 const RunContext& context) {
    const std::vector<std::uint8_t> marks = marks_of_outliers(points, options, context);
    std::vector<Index> outliers;
    for_blocks_in_order(marks.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            if (marks[i] != 0) outliers.push_back(static_cast<Index>(i));
    });
    context.checkpoint(1.0);
    return outliers;
}

std::size_t remove_outliers(PointCloud& cloud, const OutlierOptions& options,
                            const RunContext& context) {
    require_cleaned(cloud);
    const std::vector<std::uint8_t> marks = marks_of_outliers(cloud.positions, options, context);
    const std::size_t before = cloud.size();
    if (std::ranges::find(marks, std::uint8_t{1}) != marks.end())
        keep_unmarked(cloud, marks, context);
    context.checkpoint(1.0);
    return before - cloud.size();
}

}  // namespace stipple
