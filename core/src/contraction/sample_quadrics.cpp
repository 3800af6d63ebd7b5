#include "contraction/sample_quadrics.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "cloud/float4.hpp"
#include "clustering/gather.hpp"
#include "contraction/contraction.hpp"
#include "contraction/contraction_quadrics.hpp"
#include "neighbors/leaf_query.hpp"
#include "neighbors/point_tree.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 512;
constexpr std::size_t kLeaves = 64;  // of eight clusters
constexpr std::size_t kMost = 32;    // neighbours

/// What is kept of a cluster's points beside their centroid: their scatter and number.
struct Summary {
    Float4 scatter{};  ///< xx, xy, xz, yy
    Float4 others{};   ///< yz, zz, the number, 0

    double mean_radius_sq() const noexcept {
        return static_cast<double>(scatter[0] + scatter[3] + others[1]) /
               static_cast<double>(others[2]);
    }
    /// Variance of the points' heights over the plane through them, on which three always are: of
    /// round clusters l0 = l0 l1 l2 / (l1 l2), and somewhat less of long ones.
    double height_variance() const noexcept {
        const auto entry = [](float v) { return static_cast<double>(v); };
        const double xx = entry(scatter[0]), xy = entry(scatter[1]), xz = entry(scatter[2]),
                     yy = entry(scatter[3]), yz = entry(others[0]), zz = entry(others[1]);
        const double determinant =
            xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
        const double half = (xx + yy + zz) / 2, free = entry(others[2]) - 3;
        return half > 0 ? std::max(0.0, determinant / (half * half)) / free : 0;
    }
};

Summary summary_of(const SampleMoments& moments) {
    const auto entry = [](double value) { return static_cast<float>(value); };
    const Symmetric3& s = moments.scatter;
    return {Float4{entry(s.xx), entry(s.xy), entry(s.xz), entry(s.yy)},
            Float4{entry(s.yz), entry(s.zz), static_cast<float>(moments.count), 0}};
}

/// Sums over the points of some clusters.
class SummarySums {
public:
    /// @param d  from the place to which the sums refer to the centroid of the cluster.
    void add(const Summary& s, float x, float y, float z) noexcept {
        const Float4 nd = s.others[2] * Float4{x, y, z, 1};
        first_ += nd;
        scatter_ += s.scatter + __builtin_shufflevector(nd, nd, 0, 0, 0, 1) * Float4{x, y, z, y};
        others_ += s.others + __builtin_shufflevector(nd, nd, 1, 2, 3, 3) * Float4{z, z, 0, 0};
    }
    /// About the centroid.
    Symmetric3 scatter() const noexcept {
        const auto about = [this](float sum, int i, int k) {
            return static_cast<double>(sum) - at(i) * at(k) / at(3);
        };
        return {about(scatter_[0], 0, 0), about(scatter_[1], 0, 1), about(scatter_[2], 0, 2),
                about(scatter_[3], 1, 1), about(others_[0], 1, 2),  about(others_[1], 2, 2)};
    }
    Vec3d centroid() const noexcept { return Vec3d(at(0), at(1), at(2)) / at(3); }
    double mean_radius_sq() const noexcept {
        return static_cast<double>(scatter_[0] + scatter_[3] + others_[1]) / at(3);
    }

private:
    double at(int i) const noexcept { return static_cast<double>(first_[i]); }

    Float4 first_{};  ///< x, y, z, the number
    Float4 scatter_{}, others_{};
};

/// The neighbours of a sample: which they are, and the edges to them.
struct Around {
    alignas(16) std::array<float, kMost> x{}, y{}, z{};  ///< those behind the last are 0
    std::array<Index, kMost> index;
    SummarySums sums;

    Vec3d edge(std::size_t j) const { return Vec3f(x[j], y[j], z[j]).cast<double>(); }
};

/// The matrix whose largest eigenvector is the smallest one of `m`.
Symmetric3 reversed(const Symmetric3& m) noexcept {
    const double t = m.trace();
    return {t - m.xx, -m.xy, -m.xz, t - m.yy, -m.yz, t - m.zz};
}

/// The planes of the first edges, of a weight of `area` together, and the sample itself: the more,
/// the steeper the edges are, since the planes of a rough surface tell little of it (Trettner and
/// Kobbelt 2020) and there have to be more points.
void add_edges(Quadric& q, const Around& around, std::size_t count, const Vec3d& normal,
               double area) {
    constexpr float kUpright = 1e-6F;
    const Vec3f n = normal.cast<float>();
    Float4 xx{}, xy{}, xz{}, yy{}, yz{}, zz{}, slopes_sq{};
    for (std::size_t j = 0; j < count; j += 4) {
        const Float4 x = load(&around.x[j]), y = load(&around.y[j]), z = load(&around.z[j]);
        const Float4 length_sq = x * x + y * y + z * z, height = n.x() * x + n.y() * y + n.z() * z;
        const Float4 share = length_sq > 0.0F ? height / length_sq : Float4{};
        slopes_sq += height * share;
        // (e x n) x e, over the square of e
        const Float4 u = n.x() - share * x, v = n.y() - share * y, w = n.z() - share * z;
        const Float4 square = u * u + v * v + w * w;
        const Float4 by = (length_sq > 0.0F) & (square > kUpright) ? 1.0F / square : Float4{};
        xx += by * u * u;
        xy += by * u * v;
        xz += by * u * w;
        yy += by * v * v;
        yz += by * v * w;
        zz += by * w * w;
    }
    const double each = area / static_cast<double>(count);
    q.xx += each * sum(xx);
    q.xy += each * sum(xy);
    q.xz += each * sum(xz);
    q.yy += each * sum(yy);
    q.yz += each * sum(yz);
    q.zz += each * sum(zz);
    add_point(q, Vec3d::Zero(), kPointTerm * area + kRoughnessTerm * each * sum(slopes_sq));
}

/// The points around a sample on a straight border lie in a half disc, whose centroid is 0.6 of the
/// root mean square of their distances away; inside a surface only chance moves it.
void add_border_plane(Quadric& q, const SummarySums& around, const Vec3d& normal, double area) {
    constexpr double kInside = 0.35, kBorder = 0.6;
    const Vec3d offset = around.centroid() - normal * normal.dot(around.centroid());
    const double offset_sq = offset.squaredNorm(), radius_sq = around.mean_radius_sq();
    if (!(offset_sq > kInside * kInside * radius_sq)) return;
    const double one_sided = std::sqrt(offset_sq / radius_sq);
    const double share = std::min(1.0, (one_sided - kInside) / (kBorder - kInside));
    add_plane(q, offset, Vec3d::Zero(), area * share / offset_sq);
}

/// How high the surface is over the centroid of a cluster. On a paraboloid the mean height of
/// points falls with their mean squared distance from its top: what is seen between the cluster and
/// its surroundings tells what there is between the cluster and the top. The cluster's own points
/// must show as much, or else what is seen is another sheet: the deviation of their heights is
/// 1 / sqrt(3) of that, if they are enough to tell.
double height_over(const Summary& cluster, const SummarySums& around, const Vec3d& normal) {
    constexpr double kMostDeviations = 4;
    const double own_sq = cluster.mean_radius_sq(), radius_sq = around.mean_radius_sq();
    if (!(radius_sq > 2 * own_sq)) return 0;
    const double height = -normal.dot(around.centroid()) * own_sq / (radius_sq - own_sq);
    if (cluster.others[2] <= 3) return height;
    const double most = kMostDeviations * std::sqrt(cluster.height_variance());
    return std::clamp(height, -most, most);
}

/// The mean features of each cluster.
std::vector<float> features_of(const MemberLists& clusters, const Features& features,
                               const RunContext& context) {
    const std::size_t channels = features.channels;
    std::vector<float> means(clusters.size() * channels);
    if (channels == 0) return means;
    parallel_for_blocks(clusters.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        std::vector<double> sums(channels);
        for (std::size_t i = begin; i < end; ++i) {
            std::ranges::fill(sums, 0.0);
            for (const Index member : clusters.of(i))
                for (std::size_t c = 0; c < channels; ++c)
                    sums[c] += static_cast<double>(features.values[member * channels + c]);
            for (std::size_t c = 0; c < channels; ++c)
                means[i * channels + c] =
                    static_cast<float>(sums[c] / static_cast<double>(clusters.of(i).size()));
        }
    });
    return means;
}

/// What the features of the first neighbours are more than those of sample i, times `scale`.
void set_steps(std::vector<float>& steps, std::span<const float> features, unsigned channels,
               std::size_t i, std::span<const Index> neighbors, float scale) {
    steps.clear();
    for (const Index j : neighbors)
        for (unsigned c = 0; c < channels; ++c)
            steps.push_back(scale *
                            (features[j * std::size_t{channels} + c] - features[i * channels + c]));
}

double diagonal(std::span<const Vec3f> points) {
    Vec3f low = points.front(), high = low;
    for (const Vec3f& p : points) {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
    }
    return (high.cast<double>() - low.cast<double>()).norm();
}

/// A power of two that makes a length about 1, and of which the square is no more than a float can
/// hold.
float scale_for(double length) {
    constexpr int kLargest = 60;
    return length > 0 ? std::ldexp(1.0F, std::clamp(-std::ilogb(length), -kLargest, kLargest))
                      : 1.0F;
}

/// Across the surface at each of up to eight places.
std::array<Vec3d, PointTree::kWidth> normals_of(std::span<const Around> places) {
    std::array<Vec3d, PointTree::kWidth> normals;
    for (std::size_t first = 0; first < places.size(); first += kSpreads) {
        const auto some = places.subspan(first, std::min(kSpreads, places.size() - first));
        std::array<Symmetric3, kSpreads> matrices;
        for (std::size_t lane = 0; lane < some.size(); ++lane)
            matrices[lane] = reversed(some[lane].sums.scatter());
        const auto spreads = cluster_kernels().spreads(matrices);
        for (std::size_t lane = 0; lane < some.size(); ++lane)
            normals[first + lane] = spreads[lane].direction;
    }
    return normals;
}

double mean_square(const Around& around, std::size_t count) {
    double total = 0;
    for (std::size_t j = 0; j < count; j += 4) {
        const Float4 x = load(&around.x[j]), y = load(&around.y[j]), z = load(&around.z[j]);
        total += sum(x * x + y * y + z * z);
    }
    return total / static_cast<double>(count);
}

/// Looks at the neighbours of clusters.
class Surveyor {
public:
    Surveyor(const PointTree& tree, std::span<const Vec3f> centroids,
             std::span<const Summary> summaries, unsigned k, float scale)
        : tree_(tree), summaries_(summaries), query_(tree, centroids, k), k_(k), scale_(scale) {}

    /// What is around each cluster of a leaf.
    std::span<const Around> look(std::size_t leaf) {
        const PointTree::Leaf& own = tree_.leaf(leaf);
        query_.run(leaf, [&](std::size_t lane, const Candidates& near, const Chosen& chosen) {
            Around& around = around_[lane];
            const Vec3f from = own.position(lane);
            std::array<std::uint32_t, kMost + 1> slots;  // by rank; those too many in the last
            for (std::uint32_t i = 0; i < chosen.count; ++i)
                slots[std::min(chosen.rank[i], k_)] = chosen.slot[i];
            for (unsigned j = 0; j < k_; ++j) {
                const std::uint32_t slot = slots[j];
                around.x[j] = scale_ * (near.x[slot] - from.x());
                around.y[j] = scale_ * (near.y[slot] - from.y());
                around.z[j] = scale_ * (near.z[slot] - from.z());
                around.index[j] = near.index[slot];
            }
            around.sums = {};
            around.sums.add(summaries_[own.index[lane]], 0, 0, 0);
            for (unsigned j = 0; j < k_; ++j)
                around.sums.add(summaries_[around.index[j]], around.x[j], around.y[j], around.z[j]);
        });
        return std::span(around_).first(tree_.points_in(leaf));
    }

private:
    const PointTree& tree_;
    std::span<const Summary> summaries_;
    LeafQuery query_;
    unsigned k_;
    float scale_;
    std::array<Around, PointTree::kWidth> around_;
};

}  // namespace

QuadricSamples::QuadricSamples(std::span<const Vec3f> points, const MemberLists& clusters,
                               unsigned k, const Features& features, const RunContext& context)
    : positions_(made_in_blocks<decltype(positions_)>(clusters.size(), context)),
      matrices_(made_in_blocks<decltype(matrices_)>(clusters.size(), context)) {
    auto summaries = made_in_blocks<std::vector<Summary>>(size(), context);
    auto centroids = made_in_blocks<std::vector<Vec3f>>(size(), context);
    parallel_for_blocks(size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        Gathered gathered(points);
        for (std::size_t i = begin; i < end; ++i) {
            const SampleMoments moments = gathered.moments_of(clusters.of(i));
            centroids[i] = moments.centroid.cast<float>();
            summaries[i] = summary_of(moments);
        }
    });
    if (size() == 1) {
        positions_ = centroids;
        return;
    }
    const auto count = static_cast<unsigned>(std::min<std::size_t>(k, size() - 1));
    const std::vector<float> means = features_of(clusters, features, context);
    const double length = diagonal(centroids);
    const float scale = scale_for(length);
    const double unit_area = length > 0 ? std::pow(length * static_cast<double>(scale), 2) : 1;
    parallel_for_blocks(size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            summaries[i].scatter *= scale * scale;
            summaries[i].others *= Float4{scale * scale, scale * scale, 1, 1};
        }
    });
    const PointTree tree(centroids, PointTree::Leaves::Given, context);
    parallel_for_blocks(
        tree.leaf_count(), kLeaves, context, [&](std::size_t begin, std::size_t end) {
            Surveyor surveyor(tree, centroids, summaries, count, scale);
            std::vector<Vec3d> edges;
            std::vector<float> steps;
            for (std::size_t l = begin; l < end; ++l) {
                const std::span<const Around> leaf = surveyor.look(l);
                const auto normals = normals_of(leaf);
                for (std::size_t lane = 0; lane < leaf.size(); ++lane) {
                    const Around& around = leaf[lane];
                    const Vec3d& normal = normals[lane];
                    const Index i = tree.leaf(l).index[lane];
                    const double height =
                        height_over(summaries[i], around.sums, normal) / static_cast<double>(scale);
                    positions_[i] = (centroids[i].cast<double>() + height * normal).cast<float>();
                    const double area = mean_square(around, count) / unit_area;
                    Quadric q;
                    add_edges(q, around, count, normal, area);
                    add_border_plane(q, around.sums, normal, area);
                    if (features.channels > 0) {
                        edges.clear();
                        for (std::size_t j = 0; j < count; ++j) edges.push_back(around.edge(j));
                        set_steps(steps, means, features.channels, i,
                                  std::span(around.index).first(count), scale);
                        add_gradients(q, edges, steps, features.channels, normal, area);
                    }
                    matrices_[i] = Matrix(q);
                }
            }
        });
}

QuadricSamples::Matrix::Matrix(const Quadric& q) noexcept
    : xx(static_cast<float>(q.xx)),
      xy(static_cast<float>(q.xy)),
      xz(static_cast<float>(q.xz)),
      yy(static_cast<float>(q.yy)),
      yz(static_cast<float>(q.yz)),
      zz(static_cast<float>(q.zz)) {}

Quadric QuadricSamples::quadric(Index i) const noexcept {
    const Matrix& m = matrices_[i];
    Quadric q;
    q.xx = static_cast<double>(m.xx);
    q.xy = static_cast<double>(m.xy);
    q.xz = static_cast<double>(m.xz);
    q.yy = static_cast<double>(m.yy);
    q.yz = static_cast<double>(m.yz);
    q.zz = static_cast<double>(m.zz);
    return q;
}

}  // namespace stipple
