#include "particles/particle_tree.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "cloud/float4.hpp"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

namespace stipple {

namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

Float4 gap(float low, float high, const float* lows, const float* highs) noexcept {
    return larger(larger(load(lows) - high, low - load(highs)), Float4{});
}

}  // namespace

ParticleTree::ParticleTree(std::span<const Vec3f> positions, std::span<const float> reach,
                           const RunContext& context)
    : size_(positions.size()) {
    constexpr std::size_t kBlock = 2'048;
    const auto nodes_over = [](std::size_t n) { return (n + kWidth - 1) / kWidth; };
    resize_in_blocks(leaves_, nodes_over(size_), context);
    parallel_for_blocks(leaves_.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t l = begin; l < end; ++l) {
            for (std::size_t lane = 0; lane < kWidth; ++lane) {
                const std::size_t i = l * kWidth + lane;
                const Vec3f p = i < size_ ? positions[i] : Vec3f::Constant(kInfinity);
                leaves_[l].x[lane] = p.x();
                leaves_[l].y[lane] = p.y();
                leaves_[l].z[lane] = p.z();
                leaves_[l].reach[lane] = i < size_ ? reach[i] : 0.0F;
            }
        }
    });
    // The box of what is missing is empty; no child is far from it.
    const auto set_child = [](Node& node, std::size_t child, const Vec3f& low, const Vec3f& high,
                              float farthest) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            node.low[axis][child] = low[static_cast<Eigen::Index>(axis)];
            node.high[axis][child] = high[static_cast<Eigen::Index>(axis)];
        }
        node.reach[child] = farthest;
    };
    const auto build = [&](std::size_t children, auto&& child_of) {
        std::vector<Node> level(nodes_over(children));
        parallel_for_blocks(level.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
            for (std::size_t c = begin * kWidth; c < end * kWidth; ++c) {
                Vec3f low = Vec3f::Constant(kInfinity), high = -low;
                float farthest = 0;
                if (c < children) child_of(c, low, high, farthest);
                set_child(level[c / kWidth], c % kWidth, low, high, farthest);
            }
        });
        levels_.push_back(std::move(level));
    };
    build(leaves_.size(), [&](std::size_t l, Vec3f& low, Vec3f& high, float& farthest) {
        for (std::size_t i = l * kWidth; i < std::min(size_, (l + 1) * kWidth); ++i) {
            low = low.cwiseMin(positions[i]);
            high = high.cwiseMax(positions[i]);
            farthest = std::max(farthest, reach[i]);
        }
    });
    while (levels_.back().size() > 1) {
        const std::vector<Node>& below = levels_.back();
        build(below.size(), [&](std::size_t n, Vec3f& low, Vec3f& high, float& farthest) {
            for (Eigen::Index axis = 0; axis < 3; ++axis) {
                low[axis] = *std::ranges::min_element(below[n].low[static_cast<std::size_t>(axis)]);
                high[axis] =
                    *std::ranges::max_element(below[n].high[static_cast<std::size_t>(axis)]);
            }
            farthest = *std::ranges::max_element(below[n].reach);
        });
    }
}

void ParticleTree::find_neighbors(std::size_t begin, std::size_t end, ParticleNeighborhoods& found,
                                  std::size_t most) const {
    found.members.clear();
    found.ends.clear();
    constexpr std::size_t kLeavesOfEach = 2;
    constexpr float kLeastPart = 0x1p-12F;
    const std::size_t most_leaves = std::min(leaves_.size(), most) * kLeavesOfEach;
    std::vector<std::uint32_t> near;
    std::vector<Index> room;
    for (std::size_t i = begin; i < end; ++i) {
        if (i == begin || i % kWidth == 0) {
            near.clear();
            // In a heap nearer and nearer ones; the first of them where all coincide.
            float part = 1;
            while (!append_near_leaves(i / kWidth, part, most_leaves, near) && part > kLeastPart) {
                near.clear();
                part /= 2;
            }
            room.resize((near.size() + 1) * kWidth);
        }
        std::size_t count = pack_neighbors(i, near, room.data());
        if (count > most) {
            move_nearest_to_front(i, most, std::span(room).first(count));
            count = most;
        }
        found.members.insert(found.members.end(), room.begin(),
                             room.begin() + static_cast<std::ptrdiff_t>(count));
        found.ends.push_back(static_cast<Index>(found.members.size()));
    }
}

/// Leaves that may have neighbours of the particles in one of them within this part of their reach.
/// False where they are more than `most`: then they are some of them.
bool ParticleTree::append_near_leaves(std::size_t leaf, float part, std::size_t most,
                                      std::vector<std::uint32_t>& near) const {
    const Node& home = levels_[0][leaf / kWidth];
    const std::size_t lane = leaf % kWidth;
    std::array<float, 3> low, high;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        low[axis] = home.low[axis][lane];
        high[axis] = home.high[axis][lane];
    }
    const float reach = home.reach[lane];
    const auto near_children = [&](const Node& node) {
        unsigned bits = 0;
        for (unsigned half = 0; half < 8; half += 4) {
            const Float4 x = gap(low[0], high[0], &node.low[0][half], &node.high[0][half]);
            const Float4 y = gap(low[1], high[1], &node.low[1][half], &node.high[1][half]);
            const Float4 z = gap(low[2], high[2], &node.low[2][half], &node.high[2][half]);
            const Float4 limit = 0.5F * part * (load(&node.reach[half]) + reach);
            bits |= lane_bits(x * x + (y * y + z * z) <= limit * limit) << half;
        }
        return bits;
    };
    constexpr std::size_t kDepth = 12;  // 8^12 is above the number of particles there can be
    std::array<std::uint32_t, kDepth> number{};
    std::array<unsigned, kDepth> open{};
    std::size_t level = levels_.size() - 1;
    open[level] = near_children(levels_[level][0]);
    while (true) {
        if (open[level] == 0) {
            if (++level == levels_.size()) return true;
            continue;
        }
        const auto child = static_cast<std::uint32_t>(
            number[level] * kWidth + static_cast<unsigned>(std::countr_zero(open[level])));
        open[level] &= open[level] - 1;
        if (level == 0) {
            if (near.size() == most) return false;
            near.push_back(child);
            continue;
        }
        number[--level] = child;
        open[level] = near_children(levels_[level][child]);
    }
}

/// @param found  room for all particles of those leaves, and four more. @return how many there are.
std::size_t ParticleTree::pack_neighbors(std::size_t i, std::span<const std::uint32_t> near,
                                         Index* found) const {
    const std::size_t own = i % kWidth;
    const Leaf& home = leaves_[i / kWidth];
    const float x = home.x[own], y = home.y[own], z = home.z[own], reach = home.reach[own];
    Index* out = found;
    for (const std::uint32_t l : near) {
        const Leaf& leaf = leaves_[l];
        for (unsigned half = 0; half < 8; half += 4) {
            const Float4 dx = load(&leaf.x[half]) - x, dy = load(&leaf.y[half]) - y,
                         dz = load(&leaf.z[half]) - z;
            const Float4 limit = 0.5F * (load(&leaf.reach[half]) + reach);
            unsigned mask = lane_bits(dx * dx + (dy * dy + dz * dz) < limit * limit);
            if (l == i / kWidth && own / 4 == half / 4) mask &= ~(1U << own % 4);
            const Index first = l * static_cast<Index>(kWidth) + half;
            const std::array<Index, 4> lanes = {first, first + 1, first + 2, first + 3};
            store_packed(out, lanes.data(), mask);
            out += std::popcount(mask);
        }
    }
    return static_cast<std::size_t>(out - found);
}

void ParticleTree::move_nearest_to_front(std::size_t i, std::size_t most,
                                         std::span<Index> found) const {
    const Vec3f p = position(i);
    const auto order = [&](Index j) { return std::pair((position(j) - p).squaredNorm(), j); };
    std::ranges::nth_element(found, found.begin() + static_cast<std::ptrdiff_t>(most), {}, order);
}

}  // namespace stipple
