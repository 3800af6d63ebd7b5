#include "progressive/cell_surface.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <random>

namespace stipple {
namespace {

std::vector<Cell> scattered(std::size_t n, std::int32_t side, std::uint32_t seed) {
    std::mt19937 random(seed);
    std::vector<Cell> cells;
    for (std::size_t i = 0; i < n; ++i) {
        const auto coordinate = [&] {
            return static_cast<std::int32_t>(random() % static_cast<unsigned>(side));
        };
        cells.push_back({coordinate(), coordinate(), coordinate()});
    }
    return cells;
}

TEST(CellBlocks, FindTheCellsOfABlockInOrder) {
    const std::vector<Cell> cells = scattered(500, 64, 1);
    for (const unsigned bits : {0U, 3U, 24U}) {
        const CellBlocks blocks(cells, bits);
        for (const Cell& cell : cells) {
            std::vector<Index> expected, found;
            for (Index i = 0; i < cells.size(); ++i)
                if (blocks.block_of(cells[i]) == blocks.block_of(cell)) expected.push_back(i);
            blocks.for_each_in(blocks.block_of(cell), [&](Index i, const Cell& place) {
                EXPECT_EQ(place, cells[i]);
                found.push_back(i);
                return true;
            });
            ASSERT_EQ(found, expected);
        }
        blocks.for_each_in({-1, 0, 0}, [](Index, const Cell&) { return ADD_FAILURE(), false; });
    }
}

TEST(CellBlocks, GiveEachOfTheirCellsOnceAndInOrder) {
    const std::vector<Cell> cells = scattered(500, 64, 2);
    for (const unsigned bits : {0U, 5U, 24U}) {
        CellBlocks blocks(cells, bits);
        const CellBlocks all = blocks;
        for (const Cell& cell : cells) {
            std::vector<Index> expected;
            all.for_each_in(all.block_of(cell),
                            [&](Index i, const Cell&) { return expected.push_back(i), true; });
            const auto first = blocks.take_from(blocks.block_of(cell));
            if (!first) continue;  // they were taken with another
            std::vector<Index> taken = {*first};
            while (const auto next = blocks.take_from(blocks.block_of(cell)))
                taken.push_back(*next);
            ASSERT_EQ(taken, expected);
        }
        EXPECT_FALSE(blocks.take_from({-1, 0, 0}));
    }
    EXPECT_FALSE(CellBlocks().take_from({}));
}

TEST(CellBlocks, AreAsLargeAsAShareOfTheCellsAllows) {
    std::vector<Cell> cells;
    for (std::int32_t x = 0; x < 16; ++x)
        for (std::int32_t y = 0; y < 16; ++y) cells.push_back({4 * x, 4 * y, 0});
    EXPECT_EQ(block_bits_for(cells, 1), 2U);     // one in each block
    EXPECT_EQ(block_bits_for(cells, 0.25), 3U);  // four
    EXPECT_EQ(block_bits_for(cells, 0.2), 3U);
}

TEST(CellBlocks, HaveAFirstCellEach) {
    const std::vector<Cell> cells = {{0, 0, 0}, {5, 5, 5}, {1, 1, 1}, {4, 4, 4}, {5, 5, 5}};
    EXPECT_EQ(first_in_blocks(cells, 0), (std::vector<Index>{0, 1, 2, 3}));
    EXPECT_EQ(first_in_blocks(cells, 2), (std::vector<Index>{0, 1}));
}

TEST(CellNeighbors, AreTheNearestOfOtherPlaces) {
    const std::vector<Cell> cells = scattered(400, 12, 2);  // some of them the same
    const std::vector<CellNeighbors> all = find_neighbors(cells, CellBlocks(cells, 2), {});
    ASSERT_EQ(all.size(), cells.size());
    for (Index i = 0; i < cells.size(); ++i) {
        const CellNeighbors& found = all[i];
        std::vector<std::int64_t> expected;
        bool shadow = false;
        for (Index j = 0; j < cells.size(); ++j) {
            if (cells[j] == cells[i]) {
                shadow = shadow || j < i;
            } else if (std::find(cells.begin(), cells.begin() + j, cells[j]) == cells.begin() + j) {
                expected.push_back(distance_sq(cells[i], cells[j]));
            }
        }
        std::ranges::sort(expected);
        EXPECT_EQ(found.shadow, shadow);
        ASSERT_EQ(found.list().size(), kMostCellNeighbors);
        for (std::size_t k = 0; k < kMostCellNeighbors; ++k)
            EXPECT_EQ(distance_sq(cells[found.numbers[k]], cells[i]), expected[k]);
    }
}

TEST(CellTangent, OfAPlaneIsThePlane) {
    std::vector<Cell> cells;  // z = x / 2, around (20, 20, 10)
    for (std::int32_t x = 16; x <= 24; x += 2)
        for (std::int32_t y = 18; y <= 22; ++y) cells.push_back({x, y, x / 2});
    const auto middle =
        static_cast<Index>(std::ranges::find(cells, Cell{20, 20, 10}) - cells.begin());
    const std::vector<CellNeighbors> all = find_neighbors(cells, CellBlocks(cells, 24), {});
    const CellTangent tangent = tangent_of(middle, all[middle], cells);
    const double length = std::sqrt(1.25);
    const double sign = tangent.plane.normal[2] > 0 ? 1 : -1;
    EXPECT_NEAR(sign * tangent.plane.normal[0], -0.5 / length, 1e-3);
    EXPECT_NEAR(tangent.plane.normal[1], 0, 1e-3);
    EXPECT_NEAR(sign * tangent.plane.normal[2], 1 / length, 1e-3);
    EXPECT_NEAR(tangent.plane.roughness, 0, 1e-2);
    EXPECT_NEAR(tangent.plane.offset, 0, 1e-2);
    EXPECT_EQ(tangent.plane.axis, 2U);
    EXPECT_NEAR(tangent.spacing, (2 * 1 + 2 * 2 + 2 * std::sqrt(5)) / 6, 1e-12);
}

TEST(CellTangent, OfPlacesInALineOrAloneIsFinite) {
    const std::vector<Cell> line = {{0, 0, 0}, {1 << 20, 0, 0}, {1 << 21, 0, 0}, {1 << 22, 0, 0}};
    for (const std::size_t count : {1U, 2U, 4U}) {
        const std::span<const Cell> cells = std::span(line).first(count);
        const CellNeighbors neighbors = find_neighbors(cells, CellBlocks(cells, 24), {}).front();
        for (const CellPlane& plane :
             {tangent_of(0, neighbors, cells).plane, neighbor_plane(0, neighbors, cells)}) {
            const auto& [x, y, z] = plane.normal;
            EXPECT_NEAR(x * x + y * y + z * z, 1, 1e-9);
            EXPECT_TRUE(std::isfinite(plane.offset) && std::isfinite(plane.roughness));
            if (count > 2) {
                EXPECT_NEAR(x, 0, 1e-3);
            }
        }
    }
}

}  // namespace
}  // namespace stipple
