#include "progressive/cell_surface.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

namespace stipple {

namespace {

constexpr unsigned kSpacingNeighbors = 6;

/// A symmetric matrix: xx xy xz yy yz zz.
using Symmetric = std::array<double, 6>;

Symmetric squared(const Symmetric& m) noexcept {
    return {m[0] * m[0] + m[1] * m[1] + m[2] * m[2], m[0] * m[1] + m[1] * m[3] + m[2] * m[4],
            m[0] * m[2] + m[1] * m[4] + m[2] * m[5], m[1] * m[1] + m[3] * m[3] + m[4] * m[4],
            m[1] * m[2] + m[3] * m[4] + m[4] * m[5], m[2] * m[2] + m[4] * m[4] + m[5] * m[5]};
}

/// The eigenvector of the least eigenvalue: the cofactors' largest, found by squaring them.
std::array<double, 3> least_axis(const Symmetric& m) noexcept {
    constexpr int kSquarings = 3;
    Symmetric c = {m[3] * m[5] - m[4] * m[4], m[2] * m[4] - m[1] * m[5], m[1] * m[4] - m[2] * m[3],
                   m[0] * m[5] - m[2] * m[2], m[1] * m[2] - m[0] * m[4], m[0] * m[3] - m[1] * m[1]};
    for (int i = 0; i < kSquarings; ++i) {
        const double scale = 1 / (c[0] + c[3] + c[5]);
        for (double& v : c) v *= scale;
        c = squared(c);
    }
    std::array<double, 3> axis;
    if (c[0] >= c[3] && c[0] >= c[5]) {
        axis = {c[0], c[1], c[2]};
    } else if (c[3] >= c[5]) {
        axis = {c[1], c[3], c[4]};
    } else {
        axis = {c[2], c[4], c[5]};
    }
    const double length = std::sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    for (double& v : axis) v /= length;
    return axis;
}

unsigned longest_axis(const std::array<double, 3>& v) noexcept {
    const double x = std::abs(v[0]), y = std::abs(v[1]), z = std::abs(v[2]);
    if (z >= x && z >= y) return 2;
    return y >= x ? 1 : 0;
}

/// The plane that lies closest to some places, and to the one that they are seen from, if asked.
CellPlane plane_of(const Cell& from, std::span<const Index> others, std::span<const Cell> places,
                   bool with_itself) {
    const double count = static_cast<double>(others.size()) + (with_itself ? 1 : 0);
    std::array<double, 3> mean{};
    for (const Index n : others)
        for (int axis = 0; axis < 3; ++axis) mean[axis] += places[n][axis] - from[axis];
    if (count > 0)
        for (double& m : mean) m /= count;

    Symmetric moments{};
    const auto add = [&](const Cell& place) {
        const double x = place[0] - from[0] - mean[0], y = place[1] - from[1] - mean[1],
                     z = place[2] - from[2] - mean[2];
        const Symmetric products = {x * x, x * y, x * z, y * y, y * z, z * z};
        for (int i = 0; i < 6; ++i) moments[i] += products[i];
    };
    if (with_itself) add(from);
    for (const Index n : others) add(places[n]);

    // Places in a line or in a point have a plane, too, and cofactors of which something is left.
    constexpr double kLeast = 1e-3, kLeastOfAll = 1e-7;
    const double of = std::max(count, 1.0);
    const double lift = kLeast * of + kLeastOfAll * (moments[0] + moments[3] + moments[5]);
    Symmetric lifted = moments;
    for (const int diagonal : {0, 3, 5}) lifted[diagonal] += lift;
    CellPlane plane;
    plane.normal = least_axis(lifted);
    const auto& [x, y, z] = plane.normal;
    const double square = x * (moments[0] * x + 2 * moments[1] * y + 2 * moments[2] * z) +
                          y * (moments[3] * y + 2 * moments[4] * z) + z * moments[5] * z;
    plane.roughness = std::sqrt(std::max(0.0, square / of));
    plane.offset = x * mean[0] + y * mean[1] + z * mean[2];
    plane.axis = longest_axis(plane.normal);
    return plane;
}

/// The cells around a block, as far as they are looked at.
class Surroundings {
public:
    explicit Surroundings(const CellBlocks& blocks) : blocks_(blocks) {}

    void gather(const Cell& block);
    CellNeighbors nearest_of(Index number, const Cell& cell) const;

private:
    static constexpr unsigned kMostOfBlock = 32, kMost = 27 * kMostOfBlock;

    bool is_same(unsigned a, unsigned b) const noexcept {
        return x_[a] == x_[b] && y_[a] == y_[b] && z_[a] == z_[b];
    }

    const CellBlocks& blocks_;
    std::optional<Cell> block_;
    unsigned count_ = 0;
    std::array<Index, kMost> numbers_;
    std::array<double, kMost> x_, y_, z_;
};

void Surroundings::gather(const Cell& block) {
    if (block_ == block) return;
    block_ = block;
    count_ = 0;
    for (int x = -1; x <= 1; ++x) {
        for (int y = -1; y <= 1; ++y) {
            for (int z = -1; z <= 1; ++z) {
                const unsigned last = count_ + kMostOfBlock;
                blocks_.for_each_in({block[0] + x, block[1] + y, block[2] + z},
                                    [&](Index number, const Cell& cell) {
                                        numbers_[count_] = number;
                                        x_[count_] = cell[0];
                                        y_[count_] = cell[1];
                                        z_[count_] = cell[2];
                                        return ++count_ < last;
                                    });
            }
        }
    }
}

CellNeighbors Surroundings::nearest_of(Index number, const Cell& cell) const {
    // Squares of whole numbers below 2^25 add up without rounding.
    std::array<double, kMost> squares;
    const double cx = cell[0], cy = cell[1], cz = cell[2];
    for (unsigned i = 0; i < count_; ++i) {
        const double x = x_[i] - cx, y = y_[i] - cy, z = z_[i] - cz;
        squares[i] = x * x + y * y + z * z;
    }
    CellNeighbors found;
    std::array<unsigned, kMostCellNeighbors> ranks;
    double farthest = std::numeric_limits<double>::infinity();  // what others are to be nearer than
    const auto take = [&](unsigned i) {
        unsigned at = found.count;
        while (at > 0 && squares[ranks[at - 1]] > squares[i]) --at;
        for (unsigned same = at; same > 0 && squares[ranks[same - 1]] == squares[i]; --same)
            if (is_same(ranks[same - 1], i)) return;
        if (found.count < kMostCellNeighbors) ++found.count;
        for (unsigned to = found.count - 1U; to > at; --to) ranks[to] = ranks[to - 1];
        ranks[at] = i;
        if (found.count == kMostCellNeighbors) farthest = squares[ranks.back()];
    };
    for (unsigned i = 0; i < count_; ++i) {
        if (squares[i] >= farthest) continue;
        if (squares[i] > 0) {
            take(i);
        } else if (numbers_[i] < number) {
            found.shadow = true;
        }
    }
    for (unsigned n = 0; n < found.count; ++n) found.numbers[n] = numbers_[ranks[n]];
    return found;
}

}  // namespace

CellBlocks::CellBlocks(std::span<const Cell> cells, unsigned edge_bits)
    : edge_bits_(edge_bits),
      bucket_bits_(static_cast<unsigned>(std::bit_width(cells.size()))),
      begin_((std::size_t{1} << bucket_bits_) + 1),
      numbers_(cells.size()),
      cells_(cells.size()) {
    for (const Cell& cell : cells) ++begin_[bucket_of(block_of(cell)) + 1];
    for (std::size_t b = 1; b < begin_.size(); ++b) begin_[b] += begin_[b - 1];
    for (auto i = static_cast<Index>(cells.size()); i-- > 0;) {
        const Index at = --begin_[bucket_of(block_of(cells[i])) + 1];
        numbers_[at] = i;
        cells_[at] = cells[i];
    }
    // What was where a bucket ends is now where it begins.
    std::shift_left(begin_.begin(), begin_.end(), 1);
    begin_.back() = static_cast<Index>(cells.size());
}

std::optional<Index> CellBlocks::take_from(const Cell& block) {
    if (begin_.empty()) return std::nullopt;
    if (left_.empty()) {
        left_.resize(cells_.size() + 1);
        std::iota(left_.begin(), left_.end(), Index{0});
    }
    const std::uint32_t bucket = bucket_of(block);
    for (Index at = first_left(begin_[bucket]); at < begin_[bucket + 1]; at = first_left(at + 1)) {
        if (block_of(cells_[at]) != block) continue;
        left_[at] = at + 1;
        return numbers_[at];
    }
    return std::nullopt;
}

Index CellBlocks::first_left(Index from) noexcept {
    while (left_[from] != from) from = left_[from] = left_[left_[from]];
    return from;
}

std::uint32_t CellBlocks::bucket_of(const Cell& block) const noexcept {
    const std::uint32_t mixed = static_cast<std::uint32_t>(block[0]) * 73'856'093U ^
                                static_cast<std::uint32_t>(block[1]) * 19'349'663U ^
                                static_cast<std::uint32_t>(block[2]) * 83'492'791U;
    return bucket_bits_ == 0 ? 0 : mixed * 0x9E37'79B1U >> (32U - bucket_bits_);
}

std::vector<Index> first_in_blocks(std::span<const Cell> cells, unsigned edge_bits) {
    const CellBlocks blocks(cells, edge_bits);
    std::vector<Index> firsts;
    for (Index i = 0; i < cells.size(); ++i) {
        blocks.for_each_in(blocks.block_of(cells[i]), [&](Index first, const Cell&) {
            if (first == i) firsts.push_back(i);
            return false;
        });
    }
    return firsts;
}

unsigned block_bits_for(std::span<const Cell> cells, double share) {
    constexpr unsigned kMost = 24;
    const double least = share * static_cast<double>(cells.size());
    unsigned bits = 0;
    while (bits < kMost && static_cast<double>(first_in_blocks(cells, bits + 1).size()) >= least)
        ++bits;
    return bits;
}

std::vector<CellNeighbors> find_neighbors(std::span<const Cell> cells, const CellBlocks& blocks,
                                          const RunContext& context) {
    constexpr std::size_t kBlock = 4'096;
    auto found = made_in_blocks<std::vector<CellNeighbors>>(cells.size(), context);
    parallel_for_blocks(cells.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        // Cells of a block look at the same ones.
        Surroundings surroundings(blocks);
        for (const Index i : blocks.numbers().subspan(begin, end - begin)) {
            surroundings.gather(blocks.block_of(cells[i]));
            found[i] = surroundings.nearest_of(i, cells[i]);
        }
    });
    return found;
}

CellPlane neighbor_plane(Index number, const CellNeighbors& neighbors,
                         std::span<const Cell> places) {
    return plane_of(places[number], neighbors.list(), places, false);
}

CellTangent tangent_of(Index number, const CellNeighbors& neighbors, std::span<const Cell> places) {
    const Cell& from = places[number];
    CellTangent tangent{plane_of(from, neighbors.list(), places, true), 0};
    const unsigned six = std::min<unsigned>(kSpacingNeighbors, neighbors.count);
    for (const Index n : neighbors.list().first(six))
        tangent.spacing += std::sqrt(static_cast<double>(distance_sq(places[n], from)));
    if (six > 0) tangent.spacing /= six;
    return tangent;
}

}  // namespace stipple
