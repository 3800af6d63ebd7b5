#include "sample_quadrics.hpp"

#include "contraction.hpp"
#include "contraction_quadrics.hpp"
#include "first_touch.hpp"
#include "gather.hpp"
#include "parallel_for.hpp"
#include "stipple/neighbors.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 512;

/// What is kept of a cluster's points beside their centroid.
struct Summary {
    float count = 0;
    std::array<float, 6> scatter{};

    double mean_radius_sq() const noexcept {
        return static_cast<double>(scatter[0] + scatter[3] + scatter[5]) /
               static_cast<double>(count);
    }
};

Summary summary_of(const SampleMoments& moments) {
    const Symmetric3& s = moments.scatter;
    return {static_cast<float>(moments.count),
            {static_cast<float>(s.xx), static_cast<float>(s.xy), static_cast<float>(s.xz),
             static_cast<float>(s.yy), static_cast<float>(s.yz), static_cast<float>(s.zz)}};
}

/// Sums over the points of some clusters.
class SummarySums {
public:
    /// @param d  from the place to which the sums refer to the centroid of the cluster.
    void add(const Summary& s, const Vec3d& d) noexcept {
        const double n = static_cast<double>(s.count);
        const Vec3d nd = n * d;
        const auto scatter = [&s](std::size_t k) { return static_cast<double>(s.scatter[k]); };
        const SampleSums terms = {nd.x(),
                                  nd.y(),
                                  nd.z(),
                                  nd.x() * d.x() + scatter(0),
                                  nd.x() * d.y() + scatter(1),
                                  nd.x() * d.z() + scatter(2),
                                  nd.y() * d.y() + scatter(3),
                                  nd.y() * d.z() + scatter(4),
                                  nd.z() * d.z() + scatter(5)};
        for (std::size_t k = 0; k < sums_.size(); ++k) sums_[k] += terms[k];
        count_ += n;
    }
    /// About the centroid.
    Symmetric3 scatter() const noexcept {
        const auto& s = sums_;
        const Vec3d c = centroid();
        return {s[3] - s[0] * c.x(), s[4] - s[0] * c.y(), s[5] - s[0] * c.z(),
                s[6] - s[1] * c.y(), s[7] - s[1] * c.z(), s[8] - s[2] * c.z()};
    }
    Vec3d centroid() const noexcept { return Vec3d(sums_[0], sums_[1], sums_[2]) / count_; }
    double mean_radius_sq() const noexcept { return (sums_[3] + sums_[6] + sums_[8]) / count_; }

private:
    SampleSums sums_{};
    double count_ = 0;
};

/// The matrix whose largest eigenvector is the smallest one of `m`.
Symmetric3 reversed(const Symmetric3& m) noexcept {
    const double t = m.trace();
    return {t - m.xx, -m.xy, -m.xz, t - m.yy, -m.yz, t - m.zz};
}

/// The planes of the edges to the neighbours at these offsets, of a weight of `area` together, and
/// the sample itself: the more, the steeper the edges are, since the planes of a rough surface tell
/// little of it (Trettner and Kobbelt 2020) and there have to be more points.
void add_edges(Quadric& q, std::span<const Vec3d> edges, const Vec3d& normal, double area) {
    const double each = area / static_cast<double>(edges.size());
    constexpr double kUpright = 1e-6;
    double roughness = 0;  // the mean squared slope, times the area
    for (const Vec3d& e : edges) {
        const double height = normal.dot(e), length_sq = e.squaredNorm();
        const Vec3d across = length_sq * normal - height * e;  // (e x n) x e
        const double across_sq = across.squaredNorm();
        if (across_sq > kUpright * length_sq * length_sq)
            add_plane(q, across, Vec3d::Zero(), each / across_sq);
        if (length_sq > 0) roughness += each * height * height / length_sq;
    }
    add_point(q, Vec3d::Zero(), kPointTerm * area + kRoughnessTerm * roughness);
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
/// its surroundings tells what there is between the cluster and the top.
double height_over(const Summary& cluster, const SummarySums& around, const Vec3d& normal) {
    const double own_sq = cluster.mean_radius_sq(), radius_sq = around.mean_radius_sq();
    if (!(radius_sq > 2 * own_sq)) return 0;
    return -normal.dot(around.centroid()) * own_sq / (radius_sq - own_sq);
}

double mean_square(std::span<const Vec3d> edges) {
    double sum = 0;
    for (const Vec3d& e : edges) sum += e.squaredNorm();
    return sum / static_cast<double>(edges.size());
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

/// The quadric of a sample, as far as its shape makes it.
Quadric quadric_of(std::span<const Vec3d> edges, const SummarySums& around, const Vec3d& normal,
                   double area) {
    Quadric q;
    add_edges(q, edges, normal, area);
    add_border_plane(q, around, normal, area);
    return q;
}

/// The features of the neighbours less those of sample i.
void set_steps(std::vector<float>& steps, std::span<const float> features, unsigned channels,
               std::size_t i, std::span<const Index> neighbors) {
    steps.clear();
    for (const Index j : neighbors)
        for (unsigned c = 0; c < channels; ++c)
            steps.push_back(features[j * std::size_t{channels} + c] - features[i * channels + c]);
}

double squared_diagonal(std::span<const Vec3f> points) {
    Vec3f low = points.front(), high = low;
    for (const Vec3f& p : points) {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
    }
    return (high.cast<double>() - low.cast<double>()).squaredNorm();
}

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
    const std::vector<float> means = features_of(clusters, features, context);
    const NeighborLists lists = k_nearest_neighbors(centroids, k, context);
    const double unit_sq = squared_diagonal(centroids);
    parallel_for_blocks(size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        std::array<std::vector<Vec3d>, kSpreads> edges;
        std::vector<float> steps;
        for (std::size_t first = begin; first < end; first += kSpreads) {
            const std::size_t lanes = std::min(kSpreads, end - first);
            std::array<SummarySums, kSpreads> around;
            std::array<Symmetric3, kSpreads> matrices;
            for (std::size_t lane = 0; lane < lanes; ++lane) {
                const std::size_t i = first + lane;
                around[lane].add(summaries[i], Vec3d::Zero());
                edges[lane].clear();
                for (const Index j : lists.of(i)) {
                    edges[lane].push_back(centroids[j].cast<double>() -
                                          centroids[i].cast<double>());
                    around[lane].add(summaries[j], edges[lane].back());
                }
                matrices[lane] = reversed(around[lane].scatter());
            }
            const auto spreads = cluster_kernels().spreads(matrices);
            for (std::size_t lane = 0; lane < lanes; ++lane) {
                const std::size_t i = first + lane;
                const Vec3d& normal = spreads[lane].direction;
                const double height = height_over(summaries[i], around[lane], normal);
                positions_[i] = (centroids[i].cast<double>() + height * normal).cast<float>();
                if (edges[lane].empty()) continue;
                const double area = mean_square(edges[lane]) / unit_sq;
                Quadric q = quadric_of(edges[lane], around[lane], normal, area);
                if (features.channels > 0) {
                    set_steps(steps, means, features.channels, i, lists.of(i));
                    add_gradients(q, edges[lane], steps, features.channels, normal, area);
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
