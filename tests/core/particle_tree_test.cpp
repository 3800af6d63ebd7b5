#include "particles/particle_tree.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <random>

namespace stipple {
namespace {

/// By comparing every pair.
std::vector<Index> all_nearer(const std::vector<Vec3f>& positions, const std::vector<float>& reach,
                              Index i) {
    std::vector<Index> found;
    for (Index j = 0; j < positions.size(); ++j) {
        const float limit = 0.5F * (reach[i] + reach[j]);
        if (j != i && (positions[j] - positions[i]).squaredNorm() < limit * limit)
            found.push_back(j);
    }
    return found;
}

void expect_the_same_as_all_pairs(const std::vector<Vec3f>& positions,
                                  const std::vector<float>& reach) {
    const ParticleTree tree(positions, reach, {});
    ParticleNeighborhoods all, last;
    tree.find_neighbors(0, positions.size(), all);
    for (Index i = 0; i < positions.size(); ++i) {
        std::vector<Index> found(all.of(i).begin(), all.of(i).end());
        tree.find_neighbors(i, i + 1, last);
        ASSERT_TRUE(std::ranges::equal(found, last.of(0)));
        std::ranges::sort(found);
        ASSERT_EQ(found, all_nearer(positions, reach, i)) << "particle " << i;
    }
}

TEST(ParticleTree, FindsWhatComparingAllPairsFinds) {
    const auto positions = test::sphere(1500, 0.1).positions;
    for (const float reach : {0.01F, 0.1F, 0.5F, 5.0F})
        expect_the_same_as_all_pairs(positions, std::vector<float>(positions.size(), reach));
}

TEST(ParticleTree, FindsPairsOfVeryDifferentReach) {
    const auto positions = test::cube(1500).positions;
    std::mt19937_64 random(7);
    std::uniform_real_distribution<float> exponent(-14.0F, -0.5F);
    std::vector<float> reach(positions.size());
    for (float& r : reach) r = std::exp2(exponent(random));
    expect_the_same_as_all_pairs(positions, reach);
}

TEST(ParticleTree, FindsParticlesThatCoincideAndOutliers) {
    auto positions = test::plane(300).positions;
    positions.insert(positions.end(), 20, Vec3f(0.5F, 0.5F, 0.0F));
    positions.emplace_back(1e6F, -1e6F, 3e5F);
    expect_the_same_as_all_pairs(positions, std::vector<float>(positions.size(), 0.2F));
}

TEST(ParticleTree, FindsTheNearestOfTooMany) {
    constexpr std::size_t kMost = 20;
    const auto positions = test::sphere(300, 0.1).positions;
    const std::vector<float> reach(positions.size(), 1.0F);
    ParticleNeighborhoods found;
    ParticleTree(positions, reach, {}).find_neighbors(0, positions.size(), found, kMost);
    for (Index i = 0; i < positions.size(); ++i) {
        std::vector<Index> nearest = all_nearer(positions, reach, i);
        std::ranges::sort(nearest, {},
                          [&](Index j) { return (positions[j] - positions[i]).squaredNorm(); });
        nearest.resize(kMost);
        EXPECT_TRUE(std::ranges::is_permutation(nearest, found.of(i))) << "particle " << i;
    }
}

TEST(ParticleTree, FindsSomeOfAHeap) {
    constexpr std::size_t kMost = 20, kCount = 50'000;
    for (const auto& positions :
         {std::vector<Vec3f>(kCount, Vec3f(1, 2, 3)), test::line(kCount).positions}) {
        const std::vector<float> reach(positions.size(), 10.0F);
        ParticleNeighborhoods found;
        ParticleTree(positions, reach, {}).find_neighbors(0, positions.size(), found, kMost);
        for (Index i = 0; i < positions.size(); ++i) ASSERT_EQ(found.of(i).size(), kMost);
    }
}

TEST(ParticleTree, ASingleParticleHasNoNeighbors) {
    expect_the_same_as_all_pairs({Vec3f(1, 2, 3)}, {1.0F});
}

}  // namespace
}  // namespace stipple
