#include "contraction/level_bases.hpp"

#include <gtest/gtest.h>
#include <cstdint>
#include <span>
#include <vector>

namespace stipple {
namespace {

struct Group {
    std::uint64_t base;
    std::vector<std::uint64_t> sizes;
    bool operator==(const Group&) const = default;
};

/// All levels of a cloud by what they are made of.
std::vector<Group> groups_of(std::uint64_t points, std::span<const std::uint64_t> sizes) {
    std::vector<Group> groups;
    for (std::uint64_t base = points; !sizes.empty();) {
        const LevelsOfBase levels = levels_of_base(base, sizes);
        groups.push_back({base, {levels.sizes.begin(), levels.sizes.end()}});
        sizes = sizes.subspan(levels.sizes.size());
        base = levels.next_base;
    }
    return groups;
}

TEST(LevelBases, OfQuartersAreTheLevelsBefore) {
    const std::vector<std::uint64_t> sizes = {108'886, 27'222, 6'806, 1'701};
    const std::vector<Group> expected = {
        {435'545, {108'886}}, {108'886, {27'222}}, {27'222, {6'806}}, {6'806, {1'701}}};
    EXPECT_EQ(groups_of(435'545, sizes), expected);
}

TEST(LevelBases, HaveThreeTimesThePointsOfTheirLevels) {
    const std::vector<std::uint64_t> sizes = {900, 500, 334, 333, 200, 112, 111, 110, 37, 36, 1, 1};
    const std::vector<Group> expected = {
        {1000, {900, 500, 334, 333, 200, 112}}, {333, {111, 110}}, {111, {37, 36}}, {37, {1, 1}}};
    EXPECT_EQ(groups_of(1000, sizes), expected);
}

TEST(LevelBases, OfFewPointsAreTheCloud) {
    const std::vector<std::uint64_t> sizes = {2, 1};
    EXPECT_EQ(groups_of(2, sizes), (std::vector<Group>{{2, {2, 1}}}));
}

}  // namespace
}  // namespace stipple
