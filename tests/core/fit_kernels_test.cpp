#include "contraction/fit_kernels.hpp"

#include "analysis/mls_fit.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstring>
#include <random>
#include <utility>
#include <vector>

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

/// Wishes for two places among the same neighbours.
struct TwoPlaces {
    std::array<FitAnswers, 2> answers;
    FitWishes wishes{answers.data(), answers.size(), {1, 2, 3, 4, 5, 6, 7, 8}};

    TwoPlaces() {
        FitLanes lanes = bent_sheets();
        answers[0] = answers_of(available_fit_kernels().front(), lanes);
        lanes.place.x[0] += 0.1F;
        lanes.place.y[5] -= 0.1F;
        answers[1] = answers_of(available_fit_kernels().front(), lanes);
    }
};

/// All bits of what is wanted of two places, and of its image.
std::vector<float> sums_of(const FitKernel& kernel) {
    const TwoPlaces places;
    FitLanes::Row rows[2][kRows];
    FitLanes::Floats squares[kRows];
    kernel.want(places.wishes, rows[0], squares);
    kernel.look_along(places.wishes, rows[0], rows[1]);
    std::vector<float> all;
    for (const FitLanes::Floats& square : squares)
        all.insert(all.end(), square.begin(), square.end());
    for (const auto& of : rows)
        for (const FitLanes::Row& row : of)
            for (const FitLanes::Floats* axis : {&row.x, &row.y, &row.z})
                all.insert(all.end(), axis->begin(), axis->end());
    return all;
}

TEST(FitKernel, TellsLayersFromABentSheet) {
    FitLanes lanes = bent_sheets();
    std::mt19937_64 random(5);
    std::uniform_real_distribution<float> coordinate(-0.7F, 0.7F);
    for (std::size_t i = 0; i < kRows; ++i)
        set(lanes.around[i], 3,
            Vec3f(coordinate(random), i % 2 == 0 ? 0 : 0.2F, coordinate(random)).cast<double>());
    for (FitLanes::Row& row : lanes.around) set(row, 6, Vec3d::Zero());
    lanes.per_h[0] = 0;
    for (const FitKernel& kernel : available_fit_kernels()) {
        FitLanes::Floats layered;
        kernel.layers(lanes, layered);
        EXPECT_EQ(layered, (FitLanes::Floats{0, 0, 0, 1, 0, 0, 0, 0})) << kernel.name;
    }
}

TEST(FitKernel, GivesTheSameBitsWithEveryInstructionSet) {
    const FitLanes lanes = bent_sheets();
    const FitAnswers plain = answers_of(available_fit_kernels().front(), lanes);
    for (const FitKernel& kernel : available_fit_kernels()) {
        const FitAnswers answers = answers_of(kernel, lanes);
        EXPECT_EQ(std::memcmp(&answers, &plain, sizeof plain), 0) << kernel.name;
        EXPECT_EQ(sums_of(kernel), sums_of(available_fit_kernels().front())) << kernel.name;
    }
}

TEST(FitKernel, AddsUpWhatIsWantedOfEachNeighbor) {
    const TwoPlaces places;
    FitLanes::Row wanted[kRows];
    FitLanes::Floats squares[kRows];
    for (const FitKernel& kernel : available_fit_kernels()) {
        kernel.want(places.wishes, wanted, squares);
        for (std::size_t i = 0; i < kRows; ++i) {
            for (std::size_t lane = 0; lane < kLanes; ++lane) {
                const auto weight = static_cast<double>(places.wishes.quadratic_weight[lane]);
                Vec3d sum = Vec3d::Zero();
                double square = 0;
                for (const FitAnswers& answer : places.answers) {
                    const Vec3d l = get(answer.gradients[i].linear, lane),
                                q = get(answer.gradients[i].quadratic, lane);
                    sum += static_cast<double>(answer.linear_distance[lane]) * l;
                    sum += weight * static_cast<double>(answer.quadratic_distance[lane]) * q;
                    square += l.squaredNorm() + weight * q.squaredNorm();
                }
                EXPECT_LT((get(wanted[i], lane) - sum).norm(), 1e-6) << kernel.name;
                EXPECT_NEAR(static_cast<double>(squares[i][lane]), square, 1e-5 * square);
            }
        }
    }
}

TEST(FitKernel, LooksAlongADirectionAsTheGradientsSay) {
    const TwoPlaces places;
    FitLanes::Row direction[kRows], image[kRows];
    for (std::size_t i = 0; i < kRows; ++i)
        for (std::size_t lane = 0; lane < kLanes; ++lane)
            set(direction[i], lane, Vec3d(0.1, -0.2, 0.05 * static_cast<double>(i + lane)));
    for (const FitKernel& kernel : available_fit_kernels()) {
        kernel.look_along(places.wishes, direction, image);
        for (std::size_t lane = 0; lane < kLanes; ++lane) {
            const auto weight = static_cast<double>(places.wishes.quadratic_weight[lane]);
            std::array<Vec3d, kRows> expected;
            expected.fill(Vec3d::Zero());
            for (const FitAnswers& answer : places.answers) {
                for (const auto& [basis, by] :
                     {std::pair(&FitAnswers::Gradients::linear, 1.0),
                      std::pair(&FitAnswers::Gradients::quadratic, weight)}) {
                    double along = 0;
                    for (std::size_t i = 0; i < kRows; ++i)
                        along += get(direction[i], lane).dot(get(answer.gradients[i].*basis, lane));
                    for (std::size_t i = 0; i < kRows; ++i)
                        expected[i] += by * along * get(answer.gradients[i].*basis, lane);
                }
            }
            for (std::size_t i = 0; i < kRows; ++i)
                EXPECT_LT((get(image[i], lane) - expected[i]).norm(), 1e-5) << kernel.name;
        }
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
