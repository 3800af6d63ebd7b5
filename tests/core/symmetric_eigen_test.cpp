#include "base/symmetric_eigen.hpp"

#include "support/eigen_system.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <random>

namespace stipple {
namespace {

Symmetric3 symmetric(const Eigen::Matrix3d& m) {
    return {m(0, 0), m(0, 1), m(0, 2), m(1, 1), m(1, 2), m(2, 2)};
}

/// Values and the vectors of both ends, against Eigen's iterative solver.
void expect_solved(const Eigen::Matrix3d& m) {
    const auto exact = test::eigen_system(m);
    const auto found = eigenvalues(symmetric(m));
    const double scale = m.cwiseAbs().maxCoeff();
    for (int i = 0; i < 3; ++i)
        EXPECT_NEAR(found[static_cast<std::size_t>(i)], exact.values[i], 4e-8 * scale);
    for (const std::size_t end : {std::size_t{0}, std::size_t{2}}) {
        const Vec3d v = eigenvector(symmetric(m), found[end]);
        EXPECT_NEAR(v.norm(), 1.0, 1e-12);
        // A unit vector whose Rayleigh quotient is the eigenvalue is one of its eigenvectors, at
        // either end.
        EXPECT_NEAR(v.dot(m * v), found[end], 1e-7 * scale);
    }
}

TEST(SymmetricEigen, SolvesRandomMatrices) {
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    for (int i = 0; i < 1000; ++i) {
        Eigen::Matrix3d a;
        for (int j = 0; j < 9; ++j) a(j / 3, j % 3) = normal(random);
        expect_solved(a * a.transpose());
    }
}

TEST(SymmetricEigen, SolvesNearlyEqualEigenvalues) {
    std::mt19937 random(2);
    std::normal_distribution<double> normal;
    for (const double gap : {1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 0.0}) {
        for (const Vec3d& d :
             {Vec3d(1, 1 + gap, 1 + 2 * gap), Vec3d(0, 1, 1 + gap), Vec3d(gap, 2 * gap, 1)}) {
            const Eigen::Quaterniond q =
                Eigen::Quaterniond(normal(random), normal(random), normal(random), normal(random))
                    .normalized();
            const Eigen::Matrix3d r = q.toRotationMatrix();
            const Eigen::Matrix3d m = r * d.asDiagonal() * r.transpose();
            expect_solved((m + m.transpose()) / 2);
        }
    }
}

TEST(SymmetricEigen, SolvesTinyAndHugeScales) {
    for (const double scale : {1e-300, 1e-30, 1e30, 1e300}) {
        expect_solved(scale * Eigen::Matrix3d{{2, 1, 0}, {1, 2, 0}, {0, 0, 0.5}});
    }
}

TEST(SymmetricEigen, OfZeroIsZeroAndSomeUnitVector) {
    EXPECT_EQ(eigenvalues({}), (std::array<double, 3>{0, 0, 0}));
    EXPECT_DOUBLE_EQ(eigenvector({}, 0).norm(), 1.0);
}

}  // namespace
}  // namespace stipple
