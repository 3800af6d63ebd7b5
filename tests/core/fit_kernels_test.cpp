#include "fit_kernels.hpp"

#include "mls_fit.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <random>

namespace stipple {
namespace {

constexpr std::size_t kLanes = FitLanes::kLanes, kRows = FitLanes::kRows;

void set(FitLanes::Row& row, std::size_t lane, const Vec3d& v) {
    row.x[lane] = static_cast<float>(v.x());
    row.y[lane] = static_cast<float>(v.y());
    row.z[lane] = static_cast<float>(v.z());
}

Vec3d get(const FitLanes::Row& row, std::size_t lane) {
    return Vec3f(row.x[lane], row.y[lane], row.z[lane]).cast<double>();
}

constexpr float kH = 0.4F;

/// Neighbours on a bent sheet that is turned, another in each lane, and places beside it.
FitLanes bent_sheets() {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> coordinate(-0.7, 0.7), angle(0, 3);
    FitLanes lanes{};
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const Eigen::Matrix3d turn = (Eigen::AngleAxisd(angle(random), Vec3d::UnitX()) *
                                      Eigen::AngleAxisd(angle(random), Vec3d::UnitZ()))
                                         .toRotationMatrix();
        for (FitLanes::Row& row : lanes.around) {
            const double u = coordinate(random), v = coordinate(random);
            set(row, lane, turn * Vec3d(u, v, 0.1 * std::cos(3 * u + 2 * v)));
        }
        set(lanes.place, lane, turn * Vec3d(0.1, 0.05, 0.15));
        lanes.per_h[lane] = 1 / kH;
    }
    return lanes;
}

FitAnswers answers_of(const FitKernel& kernel, const FitLanes& lanes) {
    FitAnswers answers{};
    kernel.run(lanes, answers);
    return answers;
}

MlsNeighborhood seen_from_place(const FitLanes& lanes, std::size_t lane) {
    MlsNeighborhood around;
    around.resize(kRows);
    for (std::size_t i = 0; i < kRows; ++i) {
        const Vec3d d = get(lanes.around[i], lane) - get(lanes.place, lane);
        around.x[i] = d.x();
        around.y[i] = d.y();
        around.z[i] = d.z();
    }
    return around;
}

TEST(FitKernel, FindsHowFarTheSurfacesAreAndHowTheyChange) {
    constexpr double step = 1e-5;
    const double h = static_cast<double>(kH);
    const FitLanes lanes = bent_sheets();
    const FitAnswers answers = answers_of(fit_kernel(), lanes);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
        MlsNeighborhood around = seen_from_place(lanes, lane);
        const MlsPlane plane = fit_weighted_plane(around, h);
        ASSERT_EQ(plane.kind, MlsPlane::Kind::Weighted);
        const auto height = [&](unsigned degree) {
            fit_weighted_plane(around, h);  // for the weights
            return fit_polynomial(around, plane.n, plane.q, h, degree).height;
        };
        // The sign of a normal is anybody's.
        const auto compare = [&](unsigned degree, float distance,
                                 FitLanes::Row FitAnswers::Gradients::*row) {
            const double expected = -plane.t - height(degree);
            const double sign = expected * static_cast<double>(distance) < 0 ? -1 : 1;
            EXPECT_NEAR(sign * static_cast<double>(distance), expected, 1e-5);
            EXPECT_GT(std::abs(expected), 1e-3);
            for (std::size_t i = 0; i < kRows; ++i) {
                unsigned axis = 0;
                for (std::vector<double>* column : {&around.x, &around.y, &around.z}) {
                    const double before = (*column)[i];
                    (*column)[i] = before + step;
                    const double above = height(degree);
                    (*column)[i] = before - step;
                    const double below = height(degree);
                    (*column)[i] = before;
                    EXPECT_NEAR(sign * get(answers.gradients[i].*row, lane)[axis],
                                (above - below) / (2 * step), 2e-4)
                        << degree << ' ' << lane << ' ' << i;
                    ++axis;
                }
            }
        };
        compare(1, answers.linear_distance[lane], &FitAnswers::Gradients::linear);
        compare(2, answers.quadratic_distance[lane], &FitAnswers::Gradients::quadratic);
    }
}

TEST(FitKernel, GivesTheSameBitsWithEveryInstructionSet) {
    const FitLanes lanes = bent_sheets();
    const FitAnswers plain = answers_of(available_fit_kernels().front(), lanes);
    for (const FitKernel& kernel : available_fit_kernels()) {
        const FitAnswers answers = answers_of(kernel, lanes);
        EXPECT_EQ(std::memcmp(&answers, &plain, sizeof plain), 0) << kernel.name;
    }
}

TEST(FitKernel, SaysNothingWhereThereIsNoPlaneOrNothingIsAsked) {
    FitLanes lanes = bent_sheets();
    for (std::size_t i = 0; i < kRows; ++i) {
        set(lanes.around[i], 0, Vec3d(0.1, 0.2, 0.3) * (static_cast<double>(i) / kRows));
        set(lanes.around[i], 1, Vec3d(0.1, 0.2, 0.3));
    }
    lanes.per_h[2] = 0;
    const FitAnswers answers = answers_of(fit_kernel(), lanes);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const bool silent = lane < 3;
        EXPECT_EQ(answers.linear_distance[lane] == 0, silent);
        EXPECT_EQ(answers.quadratic_distance[lane] == 0, silent);
        for (const FitAnswers::Gradients& gradients : answers.gradients) {
            EXPECT_EQ(get(gradients.linear, lane).norm() == 0, silent);
            EXPECT_EQ(get(gradients.quadratic, lane).norm() == 0, silent);
        }
    }
}

}  // namespace
}  // namespace stipple
