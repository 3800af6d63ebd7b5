#include "contraction/sibling_contraction.hpp"

#include "clustering/cluster_tree.hpp"
#include "contraction/contraction.hpp"
#include "contraction/sample_quadrics.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace stipple {
namespace {

/// Samples at the leaves of a tree.
struct Grown {
    std::vector<Vec3f> points;
    std::vector<Index> members;
    Cut cut;
    QuadricSamples samples;

    Grown(const PointCloud& cloud, std::uint64_t size)
        : points(cloud.positions),
          cut([&] {
              ClusterTree tree(points);
              Cut result = tree.cut(size, {});
              members.assign(tree.members().begin(), tree.members().end());
              return result;
          }()),
          samples(points, {members.data(), cut.offsets}, 8, Features(cloud, {}), {}) {}
};

TEST(QuadricSamples, OfAPlaneCostNothingAlongIt) {
    const Grown grown(test::plane(4000), 400);
    for (Index i = 0; i < grown.samples.size(); ++i) {
        const Quadric q = grown.samples.quadric(i);
        EXPECT_NEAR(grown.samples.position(i).z(), 0.0, 1e-7);
        EXPECT_GT(q.zz, 0);
        EXPECT_EQ(value(q, Vec3d::Zero()), 0);
    }
    // Inside it, all but the point term is across it; on its border a plane holds that, too.
    const auto holds_along = [&](Index i) {
        const Quadric q = grown.samples.quadric(i);
        return std::max(q.xx, q.yy) / q.zz;
    };
    for (Index i = 0; i < grown.samples.size(); ++i) {
        const Vec3d p = grown.samples.position(i);
        const double depth = std::min({p.x(), p.y(), 1 - p.x(), 1 - p.y()});
        if (depth > 0.2) {
            EXPECT_LT(holds_along(i), 0.3);
        }
        if (depth < 0.01) {
            EXPECT_GT(holds_along(i), 0.1);
        }
    }
}

TEST(QuadricSamples, OfASphereLieOnIt) {
    // The centroids of 100 points each lie inside by a quarter of the squared radius of a cluster.
    const Grown grown(test::sphere(40'000), 400);
    double height = 0;
    for (Index i = 0; i < grown.samples.size(); ++i) {
        height += (grown.samples.position(i).norm() - 1.0) / 400;
        const Vec3d n = grown.samples.position(i).normalized();
        const Quadric q = grown.samples.quadric(i);
        const double across = n.dot(half_gradient(q, n) - Vec3d(q.x, q.y, q.z));
        EXPECT_GT(across, 0.9 * (q.xx + q.yy + q.zz));
    }
    EXPECT_LT(std::abs(height), 0.25 * 0.01 / 4);
}

TEST(QuadricSamples, OfSinglePointsLieThereOrVeryNear) {
    const PointCloud cloud = test::sphere(500);
    const Grown grown(cloud, 500);
    for (Index i = 0; i < 500; ++i) {
        const Vec3f& p = cloud.positions[grown.members[i]];
        EXPECT_EQ(grown.samples.position(i).cast<float>(), p);
    }
}

/// The slow obvious way: the matrix of the planes of §3.2 at one of some single points, and of the
/// point itself; none where the neighbours may be on one side.
std::optional<Eigen::Matrix3d> matrix_by_definition(const QuadricSamples& samples, Index i,
                                                    std::size_t k, double diagonal) {
    std::vector<Vec3d> edges;
    for (Index j = 0; j < samples.size(); ++j)
        edges.push_back(samples.position(j) - samples.position(i));
    std::ranges::partial_sort(edges, edges.begin() + static_cast<std::ptrdiff_t>(k) + 1, {},
                              [](const Vec3d& e) { return e.norm(); });
    edges.resize(k + 1);  // and the point itself
    Vec3d mean = Vec3d::Zero();
    for (const Vec3d& e : edges) mean += e / static_cast<double>(k + 1);
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    double square = 0;
    for (const Vec3d& e : edges) {
        spread += (e - mean) * (e - mean).transpose();
        square += e.squaredNorm();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(spread);
    const Vec3d n = solver.eigenvectors().col(0);
    constexpr double kOneSided = 0.3;
    const double aside = (mean - n * n.dot(mean)).norm();
    if (aside > kOneSided * std::sqrt(square / static_cast<double>(k + 1))) return std::nullopt;
    const double weight = square / (static_cast<double>(k * k) * diagonal * diagonal);
    Eigen::Matrix3d result = kPointTerm * static_cast<double>(k) * weight * spread.Identity();
    for (const Vec3d& e : std::span(edges).subspan(1)) {
        const Vec3d plane = e.cross(e.cross(n)).normalized();
        result += weight * plane * plane.transpose();
        result += kRoughnessTerm * weight * std::pow(n.dot(e.normalized()), 2) * spread.Identity();
    }
    return result;
}

TEST(QuadricSamples, AreThePlanesOfTheEdgesAndThePoint) {
    for (const float size : {1.0F, 1e-12F, 1e12F}) {
        PointCloud cloud = test::sphere(500);
        for (Vec3f& p : cloud.positions) p *= size;
        const Grown grown(cloud, 500);
        const double diagonal = bounds(cloud).diagonal();
        std::size_t compared = 0;
        for (Index i = 0; i < 500; ++i) {
            const auto expected = matrix_by_definition(grown.samples, i, 8, diagonal);
            if (!expected) continue;
            ++compared;
            const Quadric q = grown.samples.quadric(i);
            Eigen::Matrix3d found;
            found << q.xx, q.xy, q.xz, q.xy, q.yy, q.yz, q.xz, q.yz, q.zz;
            EXPECT_LT((found - *expected).norm(), 1e-4 * expected->norm()) << i << ", " << size;
        }
        EXPECT_GT(compared, 250U);
    }
}

/// The slow obvious way: contracts the cheapest pair of halves that are one point each, again and
/// again; those that make a point of more than twice as many samples as points have on average
/// last.
std::vector<Index> greedily_left(const SiblingContraction& contraction,
                                 std::span<const Index> samples_of, std::size_t size) {
    std::vector<char> is_point(samples_of.size());
    for (std::size_t i = 0; i < samples_of.size(); ++i) is_point[i] = samples_of[i] == 1;
    const auto key = [&](std::size_t i) {
        return std::pair(samples_of[i] * size > 2 * samples_of.front(), contraction.costs()[i]);
    };
    for (std::size_t left = samples_of.front(); left > size; --left) {
        std::size_t best = samples_of.size();
        for (std::size_t i = 0; i < samples_of.size(); ++i) {
            if (is_point[i]) continue;
            const std::size_t a = i + 1, b = i + 2 * std::size_t{samples_of[a]};
            if (!is_point[a] || !is_point[b]) continue;
            // The later node among equals, as parents must come last.
            if (best == samples_of.size() || key(i) <= key(best)) best = i;
        }
        is_point[best] = 1;
    }
    std::vector<Index> first;
    Index sample = 0;
    for (std::size_t i = 0; i < samples_of.size();) {
        if (!is_point[i]) {
            ++i;
            continue;
        }
        first.push_back(sample);
        sample += samples_of[i];
        i += 2 * std::size_t{samples_of[i]} - 1;
    }
    first.push_back(sample);
    return first;
}

TEST(SiblingContraction, LeavesWhatContractingTheCheapestPairsLeaves) {
    const Grown grown(test::sphere(2000, 0.05), 150);
    const SiblingContraction contraction(grown.samples, grown.cut.clusters_of, {});
    for (std::size_t size = 1; size <= 150; ++size) {
        EXPECT_EQ(contraction.nodes_left(size, {}),
                  greedily_left(contraction, grown.cut.clusters_of, size));
    }
}

TEST(SiblingContraction, FlatPartsKeepTheirShare) {
    // A plane costs nothing but the point term, and would keep next to no points beside a rough
    // sphere.
    PointCloud cloud = test::sphere(3000, 0.05);
    for (const Vec3f& p : test::plane(1000).positions)
        cloud.positions.push_back(p + Vec3f(3, 0, 0));
    const Grown grown(cloud, 600);
    const SiblingContraction contraction(grown.samples, grown.cut.clusters_of, {});
    const auto first = contraction.nodes_left(200, {});
    for (std::size_t i = 0; i < 200; ++i) EXPECT_LE(first[i + 1] - first[i], 2 * 600 / 200);
}

TEST(SiblingContraction, CostsAreTheErrorWhereThePointGoesTimesTheDistance) {
    // Two samples: nothing below them that may cost more.
    const Grown grown(test::sphere(2000, 0.05), 2);
    const SiblingContraction contraction(grown.samples, grown.cut.clusters_of, {});
    const Vec3d a = grown.samples.position(0), b = grown.samples.position(1);
    const Vec3d place = contraction.place_of(0, 2).cast<double>();
    const double error =
        value(grown.samples.quadric(0), place - a) + value(grown.samples.quadric(1), place - b);
    EXPECT_NEAR(contraction.costs()[0], error * (b - a).norm(), 1e-5 * contraction.costs()[0]);
}

TEST(SiblingContraction, CostsNeverFallTowardsTheRoot) {
    const Grown grown(test::sphere(5000, 0.05), 1000);
    const SiblingContraction contraction(grown.samples, grown.cut.clusters_of, {});
    const auto& samples_of = grown.cut.clusters_of;
    for (std::size_t i = 0; i < samples_of.size(); ++i) {
        if (samples_of[i] == 1) continue;
        EXPECT_GE(contraction.costs()[i], contraction.costs()[i + 1]);
        EXPECT_GE(contraction.costs()[i],
                  contraction.costs()[i + 2 * std::size_t{samples_of[i + 1]}]);
    }
}

}  // namespace
}  // namespace stipple
