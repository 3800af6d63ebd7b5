#include "particles/particle_spread.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <cstdint>
#include <numeric>

namespace stipple {
namespace {

TEST(ParticleShares, FollowTheAreaOverTheSquaredSpacing) {
    const std::vector<float> areas = {1, 3, 1, 3}, spacing = {1, 1, 2, 2};
    const auto shares = particle_shares(areas, spacing, std::vector<std::uint8_t>(4, 0), 2);
    EXPECT_NEAR(shares[1] / shares[0], 3.0, 1e-5);
    EXPECT_NEAR(shares[0] / shares[2], 4.0, 1e-5);
    EXPECT_NEAR(std::accumulate(shares.begin(), shares.end(), 0.0), 2.0, 1e-5);
}

TEST(ParticleShares, AreBoundedWherePointsLieAllAround) {
    for (const float far : {1e6F, 1e30F}) {
        std::vector<float> areas(1000, 1.0F);
        std::vector<std::uint8_t> rough(1000, 0);
        areas[500] = far;
        areas[600] = std::sqrt(far);
        rough[500] = rough[600] = 1;
        const auto shares = particle_shares(areas, std::vector<float>(1000, 1.0F), rough, 100);
        EXPECT_NEAR(shares[500], 0.4, 1e-6);
        EXPECT_NEAR(shares[600], 0.4, 1e-6);
        EXPECT_NEAR(shares[0], 99.2 / 998.0, 1e-6);
    }
}

}  // namespace
}  // namespace stipple
