#include "clustering/base_clusters.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "clustering/gather.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <utility>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 65'536;

std::vector<Vec3f> in_order(std::span<const Vec3f> points, std::span<const Index> order,
                            const RunContext& context) {
    auto sorted = made_in_blocks<std::vector<Vec3f>>(order.size(), context);
    parallel_for_blocks(order.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        constexpr std::size_t kAhead = 16;  // that far the memory is asked for in advance
        for (std::size_t i = begin; i < end; ++i) {
            __builtin_prefetch(&points[order[std::min(i + kAhead, end - 1)]]);
            sorted[i] = points[order[i]];
        }
    });
    return sorted;
}

/// The clusters in the order of their first members: by how many first members are less, of which
/// each has a bit.
std::vector<Index> by_first_member(std::span<const Index> members, std::span<const Index> offsets,
                                   const RunContext& context) {
    constexpr std::size_t kBits = 64;
    std::vector<std::uint64_t> bits(members.size() / kBits + 1);
    const std::span<const Index> clusters = offsets.first(offsets.size() - 1);
    for_blocks_in_order(clusters.size(), context, [&](std::size_t begin, std::size_t last) {
        for (const Index i : clusters.subspan(begin, last - begin))
            bits[members[i] / kBits] |= std::uint64_t{1} << members[i] % kBits;
    });
    std::vector<Index> less(bits.size());
    for (std::size_t word = 1; word < bits.size(); ++word)
        less[word] = less[word - 1] + static_cast<Index>(std::popcount(bits[word - 1]));
    auto order = made_in_blocks<std::vector<Index>>(clusters.size(), context);
    for_blocks_in_order(clusters.size(), context, [&](std::size_t begin, std::size_t last) {
        for (std::size_t i = begin; i < last; ++i) {
            const Index first = members[clusters[i]];
            const std::uint64_t below = (std::uint64_t{1} << first % kBits) - 1;
            const int in_word = std::popcount(bits[first / kBits] & below);
            order[less[first / kBits] + static_cast<Index>(in_word)] = static_cast<Index>(i);
        }
    });
    return order;
}

/// Copies samples four at a time: up to three more than are asked for.
void copy_fours(const SampleSpan& from, const MutableSampleSpan& to) {
    constexpr std::size_t kBytes = 4 * sizeof(float);
    for (std::size_t i = 0; i < from.size; i += 4) {
        __builtin_memcpy(to.x + i, from.x + i, kBytes);
        __builtin_memcpy(to.y + i, from.y + i, kBytes);
        __builtin_memcpy(to.z + i, from.z + i, kBytes);
        __builtin_memcpy(to.index + i, from.index + i, kBytes);
    }
}

}  // namespace

LevelBase::LevelBase(const PointCloud& cloud, std::span<const Index> order,
                     const RunContext& context)
    : points_(cloud.positions), order_(order) {
    if (!order.empty()) points_ = sorted_ = in_order(cloud.positions, order, context);
}

BaseClusters::BaseClusters(const LevelBase& base, std::span<const Index> members,
                           const RunContext& context)
    : base_(base), members_(members) {
    if (base.samples_)
        gather_parts(context);
    else
        gather_cloud(context);
}

void BaseClusters::gather_cloud(const RunContext& context) {
    samples_ = std::make_shared<Samples>(members_.size());
    parallel_for_blocks(members_.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        const MutableSampleSpan part = samples_->all().part(begin, end);
        gather(base_.points_, members_.subspan(begin, end - begin), part);
        if (base_.order_.empty()) return;
        for (std::size_t i = 0; i < part.size; ++i) part.index[i] = base_.order_[part.index[i]];
    });
}

void BaseClusters::gather_parts(const RunContext& context) {
    resize_in_blocks(begins_, members_.size() + 1, context);
    for_blocks_in_order(members_.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            begins_[i + 1] = begins_[i];
            for (const LevelBase::Part& part : base_.parts_of(members_[i]))
                begins_[i + 1] += part.end - part.begin;
        }
    });
    samples_ = std::make_shared<Samples>(base_.samples_->size());
    const SampleSpan from = std::as_const(*base_.samples_).all();
    const MutableSampleSpan all = samples_->all();
    parallel_for_blocks(members_.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        constexpr std::size_t kMore = 3;  // that are written before what belongs there
        std::size_t to = begins_[begin];
        for (std::size_t i = begin; i < end; ++i) {
            for (const LevelBase::Part& part : base_.parts_of(members_[i])) {
                const std::size_t size = part.end - part.begin;
                const bool has_room =
                    to + size + kMore <= begins_[end] && part.end + kMore <= from.size;
                (has_room ? copy_fours : copy_samples)(from.part(part.begin, part.end),
                                                       all.part(to, to + size));
                to += size;
            }
        }
    });
}

std::vector<Index> BaseClusters::in_samples(std::span<const Index> offsets) const {
    std::vector<Index> all(offsets.begin(), offsets.end());
    if (!begins_.empty())
        for (Index& offset : all) offset = begins_[offset];
    return all;
}

LodLevel BaseClusters::level(const PointCloud& cloud, std::span<const Index> offsets,
                             Representative kind, const Reductions& reductions,
                             const RunContext& context) const {
    const std::vector<Index> all = in_samples(offsets);
    const SampleSpan samples = std::as_const(*samples_).all();
    LodLevel level;
    level.cloud =
        representatives(cloud, MemberLists{samples.index, all, samples}, kind, reductions, context);
    level.order = by_first_member(members_, offsets, context);
    return level;
}

LevelBase BaseClusters::base_of(const LodLevel& level, std::span<const Index> offsets,
                                const RunContext& context) const {
    LevelBase base;
    base.sorted_ = in_order(level.cloud.positions, level.order, context);
    base.points_ = base.sorted_;
    const bool of_cloud = !base_.samples_;
    base.samples_ = of_cloud ? samples_ : base_.samples_;
    base.parts_.reserve(of_cloud ? level.order.size() : base_.parts_.size());
    base.firsts_.reserve(level.order.size() + 1);
    for_blocks_in_order(level.order.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            base.firsts_.push_back(static_cast<Index>(base.parts_.size()));
            const Index first = offsets[level.order[i]], last = offsets[level.order[i] + 1];
            if (of_cloud) {
                base.parts_.push_back({first, last});
                continue;
            }
            for (const Index member : members_.subspan(first, last - first)) {
                const std::span<const LevelBase::Part> parts = base_.parts_of(member);
                base.parts_.insert(base.parts_.end(), parts.begin(), parts.end());
            }
        }
    });
    base.firsts_.push_back(static_cast<Index>(base.parts_.size()));
    return base;
}

}  // namespace stipple
