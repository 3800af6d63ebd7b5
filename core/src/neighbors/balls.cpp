#include "neighbors/balls.hpp"

#include "base/parallel_for.hpp"
#include "cloud/float4.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <functional>

namespace stipple {

namespace {

/// Balls by the cells of a grid that they reach into. The grid is wound up: cells a power of two
/// apart are one, so that a bit for each goes into a cache.
class WoundGrid {
public:
    WoundGrid(std::span<const Ball> balls, const Vec3f& low, float side)
        : balls_(balls), low_(low - Vec3f::Constant(side)), per_unit_(1 / side) {
        constexpr std::size_t kCellsOfBall = 256;  // so that few bits are set
        while (std::size_t{1} << 3 * bits_ < kCellsOfBall * balls.size() && bits_ < kMostBits)
            ++bits_;
        marked_.resize((std::size_t{1} << 3 * bits_) / kWord);
        for (const Ball& ball : balls)
            for_each_cell(ball, [&](std::uint32_t cell) {
                marked_[cell / kWord] |= std::uint64_t{1} << cell % kWord;
            });
        std::uint32_t before = 0;
        for (const std::uint64_t word : marked_) {
            marked_before_.push_back(before);
            before += static_cast<std::uint32_t>(std::popcount(word));
        }
        begin_.resize(before + 1);
        for (const Ball& ball : balls)
            for_each_cell(ball, [&](std::uint32_t cell) { ++begin_[number_of(cell) + 1]; });
        for (std::size_t i = 1; i < begin_.size(); ++i) begin_[i] += begin_[i - 1];
        reaching_.resize(begin_.back());
        std::vector<std::uint32_t> next(begin_.begin(), begin_.end() - 1);
        for (std::uint32_t b = 0; b < balls.size(); ++b)
            for_each_cell(balls[b],
                          [&](std::uint32_t cell) { reaching_[next[number_of(cell)]++] = b; });
    }

    /// Sets the bytes of those of some points that are within a ball.
    void mark(std::span<const Vec3f> points, std::span<std::uint8_t> within) const noexcept {
        std::size_t i = 0;
        for (; i + 4 <= points.size(); i += 4) mark_four(&points[i], &within[i]);
        for (; i < points.size(); ++i)
            if (has(points[i], cell_of(place(points[i]).cast<int>()))) within[i] = 1;
    }

private:
    static constexpr std::size_t kWord = 64;
    static constexpr unsigned kMostBits = 7;
    using Cell = Eigen::Vector3i;

    /// Four points, whose twelve coordinates lie one after the other.
    void mark_four(const Vec3f* points, std::uint8_t* within) const noexcept {
        const Float4 x_y_z_x = {low_.x(), low_.y(), low_.z(), low_.x()};
        const Float4 y_z_x_y = __builtin_shufflevector(x_y_z_x, x_y_z_x, 1, 2, 3, 1);
        const Float4 z_x_y_z = __builtin_shufflevector(x_y_z_x, x_y_z_x, 2, 3, 1, 2);
        const auto mask = static_cast<std::int32_t>((1U << bits_) - 1);
        const float* const values = points[0].data();
        std::array<std::uint32_t, 12> at;
        std::size_t first = 0;
        for (const Float4& low : {x_y_z_x, y_z_x_y, z_x_y_z}) {
            const Float4 place = (load(values + first) - low) * per_unit_;
            const Int4 cells = __builtin_convertvector(place, Int4) & mask;
            __builtin_memcpy(&at[first], &cells, sizeof cells);
            first += 4;
        }
        for (std::size_t j = 0; j < 4; ++j) {
            const std::uint32_t cell =
                at[3 * j] | at[3 * j + 1] << bits_ | at[3 * j + 2] << 2 * bits_;
            if (has(points[j], cell)) within[j] = 1;
        }
    }
    bool has(const Vec3f& p, std::uint32_t cell) const noexcept {
        if ((marked_[cell / kWord] >> cell % kWord & 1U) == 0) return false;
        const std::uint32_t number = number_of(cell);
        for (std::uint32_t i = begin_[number]; i < begin_[number + 1]; ++i) {
            const Ball& ball = balls_[reaching_[i]];
            // In cells, so that no square is beyond what floats hold.
            const float radius = ball.radius * per_unit_;
            if (((p - ball.center) * per_unit_).squaredNorm() <= radius * radius) return true;
        }
        return false;
    }
    /// In cells, above 0 for every point.
    Vec3f place(const Vec3f& p) const noexcept { return (p - low_) * per_unit_; }
    std::uint32_t cell_of(const Cell& at) const noexcept {
        const std::uint32_t mask = (1U << bits_) - 1;
        return (static_cast<std::uint32_t>(at.x()) & mask) |
               (static_cast<std::uint32_t>(at.y()) & mask) << bits_ |
               (static_cast<std::uint32_t>(at.z()) & mask) << 2 * bits_;
    }
    /// Of a marked cell, its place among them.
    std::uint32_t number_of(std::uint32_t cell) const noexcept {
        const std::uint64_t below = (std::uint64_t{1} << cell % kWord) - 1;
        return marked_before_[cell / kWord] +
               static_cast<std::uint32_t>(std::popcount(marked_[cell / kWord] & below));
    }
    template <typename Visit>
    void for_each_cell(const Ball& ball, Visit&& visit) const {
        constexpr float kFar = 0x1p30F;       // no point is there
        constexpr float kRounding = 0x1p-5F;  // of the places of points that are many cells away
        const Vec3f center = place(ball.center);
        const float reach = ball.radius * per_unit_ + kRounding;
        const auto cell_at = [&](const Vec3f& p) -> Cell {
            return p.cwiseMax(0.0F).cwiseMin(kFar).cast<int>();
        };
        const Cell first = cell_at(center.array() - reach), last = cell_at(center.array() + reach);
        // From the center to the cells that are so far along an axis.
        const auto way_sq = [&](int cell, int axis) {
            const auto low = static_cast<float>(cell);
            const float way = std::max({0.0F, low - center[axis], center[axis] - (low + 1)});
            return way * way;
        };
        for (int z = first.z(); z <= last.z(); ++z) {
            for (int y = first.y(); y <= last.y(); ++y) {
                const float left_sq = reach * reach - way_sq(z, 2) - way_sq(y, 1);
                for (int x = first.x(); x <= last.x(); ++x)
                    if (way_sq(x, 0) <= left_sq) visit(cell_of({x, y, z}));
            }
        }
    }

    std::span<const Ball> balls_;
    Vec3f low_;
    float per_unit_;
    unsigned bits_ = 4;
    std::vector<std::uint64_t> marked_;
    std::vector<std::uint32_t> marked_before_;     ///< by word
    std::vector<std::uint32_t> begin_, reaching_;  ///< balls of each marked cell
};

/// As few grids as do for all, since each takes a pass over the points.
///
/// @param balls  by their radius, the largest first.
std::vector<WoundGrid> make_grids(std::span<const Ball> balls, const Vec3f& low, float diagonal) {
    constexpr float kTimes = 4, kMostCells = 6, kLeast = 0x1p-16F;
    constexpr std::size_t kLargePart = 16, kSmallPart = 8, kFew = 64;
    const float least_side = diagonal > 0 ? kLeast * diagonal : 1.0F;
    // So few small balls are little work in cells of any size.
    const std::size_t few = std::max(kFew, balls.size() / kSmallPart);
    std::vector<WoundGrid> grids;
    while (!balls.empty()) {
        // A few large ones may reach into many cells.
        const std::size_t large = balls.size() / kLargePart;
        const float side =
            std::max({balls[large].radius, balls.front().radius / kMostCells, least_side});
        std::size_t n = 0;
        while (n < balls.size() &&
               (kTimes * balls[n].radius > side || side <= least_side || balls.size() - n <= few))
            ++n;
        grids.emplace_back(balls.first(n), low, side);
        balls = balls.subspan(n);
    }
    return grids;
}

}  // namespace

std::vector<Index> points_within(std::span<const Ball> balls, std::span<const Vec3f> points,
                                 const Vec3f& low, float diagonal, const RunContext& context) {
    std::vector<Ball> sorted(balls.begin(), balls.end());
    std::ranges::stable_sort(sorted, std::greater{}, &Ball::radius);
    const std::vector<WoundGrid> grids = make_grids(sorted, low, diagonal);
    constexpr std::size_t kBlock = 65'536;
    std::vector<std::vector<Index>> found((points.size() + kBlock - 1) / kBlock);
    parallel_for_blocks(points.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        std::vector<Index>& here = found[begin / kBlock];
        constexpr std::size_t kAtATime = 2'048, kEight = 8;
        std::array<std::uint8_t, kAtATime> within;
        for (std::size_t first = begin; first < end; first += kAtATime) {
            const std::size_t n = std::min(kAtATime, end - first);
            within.fill(0);
            for (const WoundGrid& grid : grids) grid.mark(points.subspan(first, n), within);
            for (std::size_t i = 0; i < n; i += kEight) {
                std::uint64_t any = 0;
                __builtin_memcpy(&any, &within[i], kEight);
                if (any == 0) continue;
                for (std::size_t j = i; j < i + kEight; ++j)
                    if (within[j] != 0) here.push_back(static_cast<Index>(first + j));
            }
        }
    });
    std::vector<Index> all;
    for (const std::vector<Index>& here : found) all.insert(all.end(), here.begin(), here.end());
    return all;
}

}  // namespace stipple
