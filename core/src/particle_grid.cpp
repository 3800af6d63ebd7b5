#include "particle_grid.hpp"

#include "parallel_for.hpp"

#include <algorithm>
#include <cmath>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 16'384;
constexpr unsigned kLevels = 16;  // the last takes all that reach less
constexpr unsigned kMinBits = 2;
constexpr unsigned kMaxBits = 20;

}  // namespace

ParticleGrid::ParticleGrid(std::span<const Vec3f> positions, std::span<const float> reach,
                           const RunContext& context)
    : positions_(positions), reach_(reach), levels_(kLevels), entries_(positions.size()) {
    Vec3f low = positions.front(), high = low;
    float longest = reach.front();
    std::array<std::size_t, kLevels> count{};
    for (std::size_t i = 0; i < positions.size(); ++i) {
        low = low.cwiseMin(positions[i]);
        high = high.cwiseMax(positions[i]);
        longest = std::max(longest, reach[i]);
    }
    low_ = low.cast<double>();
    const Vec3d extent = high.cast<double>() - low_;
    // Not so narrow that the number of a cell leaves the integers.
    constexpr double kNarrowest = 1e-12;
    levels_[0].cell = std::max(static_cast<double>(longest), kNarrowest * extent.maxCoeff());
    for (unsigned l = 1; l < kLevels; ++l) levels_[l].cell = 0.5 * levels_[l - 1].cell;
    for (const float r : reach) ++count[level_of(r)];

    std::size_t cells = 0;
    for (unsigned l = 0; l < kLevels; ++l) {
        Level& level = levels_[l];
        if (count[l] == 0) {
            level.cell = 0;
            continue;
        }
        level.bits.fill(kMinBits);
        while (level.cells() < 2 * count[l]) {
            int axis = 0;
            const auto wraps = [&](int a) {
                return std::ldexp(extent[a],
                                  -static_cast<int>(level.bits[static_cast<std::size_t>(a)]));
            };
            for (int a = 1; a < 3; ++a) axis = wraps(a) > wraps(axis) ? a : axis;
            if (wraps(axis) < level.cell || level.bits[static_cast<std::size_t>(axis)] == kMaxBits)
                break;
            ++level.bits[static_cast<std::size_t>(axis)];
        }
        level.first_cell = cells;
        cells += level.cells();
    }

    std::vector<Index> bucket(positions.size());
    parallel_for_blocks(positions.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            bucket[i] = static_cast<Index>(bucket_of(positions[i], levels_[level_of(reach[i])]));
    });
    begin_.resize(cells + 1);
    for (const Index b : bucket) ++begin_[b + 1];
    for (std::size_t b = 0; b < cells; ++b) begin_[b + 1] += begin_[b];
    context.throw_if_stopped();
    std::vector<Index> next(begin_.begin(), begin_.end() - 1);
    for (std::size_t i = 0; i < positions.size(); ++i) {
        if (i % kBlock == 0) context.throw_if_stopped();
        entries_[next[bucket[i]]++] = {positions[i], reach[i], static_cast<Index>(i)};
    }
}

unsigned ParticleGrid::level_of(float reach) const noexcept {
    const int halvings = std::ilogb(levels_[0].cell / static_cast<double>(reach));
    return static_cast<unsigned>(std::clamp(halvings, 0, static_cast<int>(kLevels) - 1));
}

std::uint64_t ParticleGrid::coordinate(const Level& level, double value, int axis) const noexcept {
    const double cells = (value - low_[axis]) / level.cell;
    return static_cast<std::uint64_t>(std::max(0.0, cells));
}

std::size_t ParticleGrid::bucket_of(const Vec3f& p, const Level& level) const noexcept {
    std::size_t bucket = 0;
    for (int axis = 2; axis >= 0; --axis) {
        const unsigned bits = level.bits[static_cast<std::size_t>(axis)];
        const std::size_t mask = (std::size_t{1} << bits) - 1;
        bucket = bucket << bits | (coordinate(level, static_cast<double>(p[axis]), axis) & mask);
    }
    return level.first_cell + bucket;
}

void ParticleGrid::append_neighbors(Index i, std::vector<Index>& found) const {
    for (const Level& level : levels_) {
        if (level.cell > 0) search(level, positions_[i], reach_[i], i, found);
    }
}

void ParticleGrid::search(const Level& level, const Vec3f& p, float reach, Index self,
                          std::vector<Index>& found) const {
    // None of this level reaches further than a cell is wide, but for those that all levels are too
    // coarse for.
    const double radius = 0.5 * (static_cast<double>(reach) + level.cell);
    std::array<std::size_t, 3> first, count, size;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        size[a] = std::size_t{1} << level.bits[a];
        const std::uint64_t low = coordinate(level, static_cast<double>(p[axis]) - radius, axis);
        const std::uint64_t high = coordinate(level, static_cast<double>(p[axis]) + radius, axis);
        first[a] = low & (size[a] - 1);
        count[a] = std::min<std::uint64_t>(high - low + 1, size[a]);  // each cell of the table once
    }
    for (std::size_t dz = 0; dz < count[2]; ++dz) {
        const std::size_t z = (first[2] + dz) & (size[2] - 1);
        for (std::size_t dy = 0; dy < count[1]; ++dy) {
            const std::size_t y = (first[1] + dy) & (size[1] - 1);
            const std::size_t row = level.first_cell + ((z << level.bits[1] | y) << level.bits[0]);
            const std::size_t end = first[0] + count[0];
            take(row + first[0], row + std::min(end, size[0]), p, reach, self, found);
            if (end > size[0]) take(row, row + end - size[0], p, reach, self, found);
        }
    }
}

void ParticleGrid::take(std::size_t bucket_begin, std::size_t bucket_end, const Vec3f& p,
                        float reach, Index self, std::vector<Index>& found) const {
    for (Index e = begin_[bucket_begin]; e < begin_[bucket_end]; ++e) {
        const Entry& entry = entries_[e];
        const float limit = 0.5F * (reach + entry.reach);
        if ((entry.position - p).squaredNorm() < limit * limit && entry.index != self)
            found.push_back(entry.index);
    }
}

}  // namespace stipple
