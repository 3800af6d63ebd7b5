#include "analysis/curve_normals.hpp"

#include "analysis/normal_kernels.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

// Normals by the points beside each other on a curve (core/src/analysis/curve_normals.hpp).

namespace stipple {
namespace {

std::vector<NormalAndBend> normals_of(const PointCloud& cloud, unsigned threads = 1) {
    RunContext context;
    context.threads = threads;
    return curve_normals(PointTree(cloud.positions, PointTree::Leaves::Quick, context), context);
}

TEST(CurveNormals, AreThoseOfASphere) {
    const PointCloud cloud = test::sphere(20'003);
    const std::vector<NormalAndBend> normals = normals_of(cloud);
    ASSERT_EQ(normals.size(), cloud.size());
    double off = 0, bend = 0;
    for (std::size_t i = 0; i < normals.size(); ++i) {
        const auto& [normal, curvature] = normals[i];
        EXPECT_NEAR(normal.norm(), 1, 1e-5);
        const double cosine = normal.dot(cloud.positions[i]);
        EXPECT_GT(std::abs(cosine), 0.95) << i;  // where the curve leaves a corner, from one side
        off += std::acos(std::min(1.0, std::abs(cosine))) / static_cast<double>(normals.size());
        bend += (cosine > 0 ? -curvature : curvature) / static_cast<double>(normals.size());
    }
    EXPECT_LT(off, 0.02);  // a degree
    EXPECT_NEAR(bend, 0.6, 0.1);
}

TEST(CurveNormals, AreUpWhereThereIsNoPlane) {
    for (const std::size_t n : {1U, 2U, 40U})
        for (const NormalAndBend& up : normals_of(test::line(n)))
            EXPECT_EQ(up, NormalAndBend()) << n;
}

TEST(CurveNormals, OfThreePointsAreThatOfTheirPlane) {
    PointCloud cloud;
    cloud.positions = {{5, 1, 0}, {5, 0, 1}, {5, -1, -1}};
    for (const auto& [normal, bend] : normals_of(cloud)) {
        EXPECT_NEAR(std::abs(normal.x()), 1, 1e-5);
        EXPECT_NEAR(bend, 0, 1e-5);
    }
}

/// As the kernels have it, in doubles and one point at a time: of the first leaf, by the first
/// three.
Vec3d slow_normal(const PointTree& tree, std::size_t lane) {
    const Vec3d at = tree.position(lane).cast<double>();
    const std::size_t count = std::min<std::size_t>(tree.size(), 3 * PointTree::kWidth);
    double mean_sq = 0;
    for (std::size_t i = 0; i < count; ++i)
        mean_sq +=
            (tree.position(i).cast<double>() - at).squaredNorm() / static_cast<double>(count);
    double w = 0;
    Vec3d mean = Vec3d::Zero();
    Eigen::Matrix3d products = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < count; ++i) {
        const Vec3d d = tree.position(i).cast<double>() - at;
        const double weight =
            std::exp(-9 * d.squaredNorm() * static_cast<double>(count) / (14.4 * mean_sq));
        w += weight;
        mean += weight * d;
        products += weight * d * d.transpose();
    }
    mean /= w;
    return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(products / w - mean * mean.transpose())
        .eigenvectors()
        .col(0);
}

TEST(NormalKernels, GiveTheSameBitsAndThePlaneOfTheSlowForm) {
    const auto kernels = available_normal_kernels();
    using Floats = std::array<float, PointTree::kWidth>;
    for (const std::size_t n : {5U, 8U, 20U, 24U, 200U}) {
        const PointCloud cloud = test::sphere(n, 0.01);
        const PointTree tree(cloud.positions, PointTree::Leaves::Quick, {});
        for (std::uint32_t leaf = 0; leaf < tree.leaf_count(); ++leaf) {
            Floats x, y, z, bend;
            kernels.front().leaf_normals(tree.view(), leaf, x.data(), y.data(), z.data(),
                                         bend.data());
            for (const NormalKernel& kernel : kernels) {
                Floats other_x, other_y, other_z, other_bend;
                kernel.leaf_normals(tree.view(), leaf, other_x.data(), other_y.data(),
                                    other_z.data(), other_bend.data());
                for (std::size_t lane = 0; lane < tree.points_in(leaf); ++lane) {
                    EXPECT_EQ(other_x[lane], x[lane]) << kernel.name;
                    EXPECT_EQ(other_y[lane], y[lane]);
                    EXPECT_EQ(other_z[lane], z[lane]);
                    EXPECT_EQ(other_bend[lane], bend[lane]);
                    if (leaf > 0) continue;
                    const Vec3d normal(x[lane], y[lane], z[lane]);
                    EXPECT_NEAR(std::abs(normal.dot(slow_normal(tree, lane))), 1, 1e-3);
                }
            }
        }
    }
}

TEST(CurveNormals, AreTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = test::sphere(5'001, 0.02);
    EXPECT_EQ(normals_of(cloud, 1), normals_of(cloud, 3));
}

}  // namespace
}  // namespace stipple
