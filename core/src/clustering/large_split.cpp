#include "clustering/large_split.hpp"

#include "base/parallel_for.hpp"
#include "clustering/gather.hpp"

#include <algorithm>
#include <vector>

// A large cluster is known by the numbers of its points alone; their coordinates are fetched from
// the cloud a piece at a time and worked on by the kernels of the small ones. A block of pieces
// writes its two sides to the ends of its own part of the room; when all counts are known, each is
// copied to its place.

namespace stipple {

namespace {

constexpr std::size_t kBlock = 65'536;  // points of one task
constexpr std::size_t kPiece = 2'048;   // points gathered at a time

Vec3d as_double(const std::array<float, 3>& v) {
    return {static_cast<double>(v[0]), static_cast<double>(v[1]), static_cast<double>(v[2])};
}

void add_to(SampleSums& total, const SampleSums& part) {
    for (std::size_t k = 0; k < total.size(); ++k) total[k] += part[k];
}

/// Calls `visit` with the samples of each piece of the block.
template <typename Visit>
void each_piece(std::span<const Vec3f> points, std::span<const Index> numbers, Visit&& visit) {
    Samples storage(kPiece);
    for (std::size_t at = 0; at < numbers.size(); at += kPiece) {
        const auto piece = numbers.subspan(at, std::min(kPiece, numbers.size() - at));
        const MutableSampleSpan samples = storage.all().part(0, piece.size());
        gather(points, piece, samples);
        visit(samples);
    }
}

struct Block {
    std::size_t begin = 0, size = 0, left_count = 0;
    SampleSums left{}, right{};
};

}  // namespace

SampleMoments moments_of_many(std::span<const Vec3f> points, std::span<const Index> numbers,
                              const std::array<float, 3>& reference, const RunContext& context) {
    std::vector<SampleSums> parts((numbers.size() + kBlock - 1) / kBlock);
    parallel_for_blocks(numbers.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        SampleSums sums{};
        each_piece(points, numbers.subspan(begin, end - begin), [&](const SampleSpan& samples) {
            add_to(sums, cluster_kernels().sums(samples, reference));
        });
        parts[begin / kBlock] = sums;
    });
    SampleSums total{};
    for (const SampleSums& part : parts) add_to(total, part);
    return moments_from(total, numbers.size(), as_double(reference));
}

Sides partition_many(std::span<const Vec3f> points, std::span<Index> numbers,
                     const SplitPlane& plane, std::span<Index> room, const RunContext& context) {
    std::vector<Block> blocks((numbers.size() + kBlock - 1) / kBlock);
    parallel_for_blocks(numbers.size(), kBlock, context, [&](std::size_t begin, std::size_t end) {
        Block block{.begin = begin, .size = end - begin};
        Samples storage(kPiece);
        std::size_t back = end;
        each_piece(points, numbers.subspan(begin, block.size), [&](const SampleSpan& samples) {
            const MutableSampleSpan sides = storage.all().part(0, samples.size);
            const std::size_t front = cluster_kernels().partition(samples, plane, sides);
            const SampleSpan left = sides.part(0, front), right = sides.part(front, samples.size);
            if (left.size > 0) add_to(block.left, cluster_kernels().sums(left, plane.reference));
            if (right.size > 0) add_to(block.right, cluster_kernels().sums(right, plane.reference));
            std::copy_n(left.index, left.size, room.data() + begin + block.left_count);
            block.left_count += left.size;
            back -= right.size;
            std::copy_n(right.index, right.size, room.data() + back);
        });
        blocks[begin / kBlock] = block;
    });
    Block all{.size = numbers.size()};
    for (const Block& block : blocks) {
        all.left_count += block.left_count;
        add_to(all.left, block.left);
        add_to(all.right, block.right);
    }
    std::vector<std::size_t> left_place, right_place;
    std::size_t left_at = 0, right_at = all.left_count;
    for (const Block& block : blocks) {
        left_place.push_back(left_at);
        right_place.push_back(right_at);
        left_at += block.left_count;
        right_at += block.size - block.left_count;
    }
    parallel_for_blocks(blocks.size(), 1, context, [&](std::size_t b, std::size_t) {
        const Block& block = blocks[b];
        const Index* const from = room.data() + block.begin;
        std::copy_n(from, block.left_count, numbers.data() + left_place[b]);
        std::copy_n(from + block.left_count, block.size - block.left_count,
                    numbers.data() + right_place[b]);
    });
    const Vec3d reference = as_double(plane.reference);
    return {moments_from(all.left, all.left_count, reference),
            moments_from(all.right, all.size - all.left_count, reference)};
}

}  // namespace stipple
