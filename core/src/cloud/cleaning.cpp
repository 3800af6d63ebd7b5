#include "stipple/cleaning.hpp"

#include "base/counting_sort.hpp"
#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "cloud/kept_points.hpp"

#include <algorithm>
#include <atomic>
#include <bit>

namespace stipple {

namespace {

constexpr std::size_t kBlock = 65'536;

struct Hashed {
    Index index;
    std::uint32_t hash;  ///< the low half; the high half chose the bucket
};

/// The bits of a coordinate, -0 as 0, so that equal floats have equal bits.
std::uint32_t bits_of(float v) noexcept {
    return v == 0.0F ? 0U : std::bit_cast<std::uint32_t>(v);
}

std::uint64_t hash_of(const Vec3f& p) noexcept {
    // Multiply and fold, after wyhash: every input bit reaches every output bit.
    const auto mix = [](std::uint64_t a, std::uint64_t b) {
        __extension__ using Wide = unsigned __int128;
        const Wide product = static_cast<Wide>(a) * b;
        return static_cast<std::uint64_t>(product) ^ static_cast<std::uint64_t>(product >> 64);
    };
    const std::uint64_t xy = (static_cast<std::uint64_t>(bits_of(p.x())) << 32) | bits_of(p.y());
    return mix(mix(xy ^ 0xa0761d6478bd642fULL, 0xe7037ed1a0b428dbULL) ^ bits_of(p.z()),
               0x8ebc6af09c88c6e3ULL);
}

/// Marks the points that stand at the position of an earlier one: hashed into buckets that fit the
/// cache, each with a table of its own, in the order of the points.
std::size_t mark_duplicates(const std::vector<Vec3f>& points, std::vector<std::uint8_t>& drop,
                            const RunContext& context) {
    const std::size_t n = points.size();
    const unsigned bits = static_cast<unsigned>(std::clamp<int>(std::bit_width(n / 4096), 0, 12));
    const std::size_t buckets = std::size_t{1} << bits;
    const auto bucket_of = [bits](std::uint64_t hash) {
        return bits == 0 ? 0 : hash >> (64 - bits);
    };

    // A stable counting sort by bucket, in parallel blocks.
    const std::size_t blocks = (n + kBlock - 1) / kBlock;
    std::vector<Index> starts(blocks * buckets);
    parallel_for_blocks(n, kBlock, context, [&](std::size_t begin, std::size_t end) {
        Index* count = starts.data() + begin / kBlock * buckets;
        for (std::size_t i = begin; i < end; ++i) {
            if (drop[i] == 0) ++count[bucket_of(hash_of(points[i]))];
        }
    });
    const std::vector<Index> bucket_begin = counts_to_places(starts, buckets);
    auto sorted = made_in_blocks<std::vector<Hashed>>(bucket_begin.back(), context);
    parallel_for_blocks(n, kBlock, context, [&](std::size_t begin, std::size_t end) {
        Index* next = starts.data() + begin / kBlock * buckets;
        for (std::size_t i = begin; i < end; ++i) {
            if (drop[i] != 0) continue;
            const std::uint64_t hash = hash_of(points[i]);
            sorted[next[bucket_of(hash)]++] = {static_cast<Index>(i),
                                               static_cast<std::uint32_t>(hash)};
        }
    });

    std::atomic<std::size_t> duplicates = 0;
    parallel_for_blocks(buckets, 1, context, [&](std::size_t b, std::size_t) {
        const std::size_t size = bucket_begin[b + 1] - bucket_begin[b];
        if (size < 2) return;
        std::vector<Index> table(std::bit_ceil(2 * size),
                                 0);  // 0: free, else 1 + the place in `sorted`
        const std::size_t mask = table.size() - 1;
        std::size_t found = 0;
        for (Index at = bucket_begin[b]; at < bucket_begin[b + 1]; ++at) {
            std::size_t slot = sorted[at].hash & mask;
            while (table[slot] != 0) {
                const Hashed& other = sorted[table[slot] - 1];
                if (other.hash == sorted[at].hash &&
                    points[other.index] == points[sorted[at].index])
                    break;
                slot = (slot + 1) & mask;
            }
            if (table[slot] == 0) {
                table[slot] = at + 1;
            } else {
                drop[sorted[at].index] = 1;
                ++found;
            }
        }
        duplicates += found;
    });
    return duplicates;
}

}  // namespace

CleaningReport clean(PointCloud& cloud, const RunContext& context) {
    validate(cloud);
    CleaningReport report;
    const std::size_t n = cloud.size();
    auto drop = made_in_blocks<std::vector<std::uint8_t>>(n, context);
    std::atomic<std::size_t> non_finite = 0;
    parallel_for_blocks(n, kBlock, context, [&](std::size_t begin, std::size_t end) {
        std::size_t found = 0;
        for (std::size_t i = begin; i < end; ++i) {
            if (!cloud.positions[i].allFinite()) {
                drop[i] = 1;
                ++found;
            }
            if (!cloud.normals.empty() && !cloud.normals[i].allFinite())
                cloud.normals[i] = Vec3f::Zero();
        }
        non_finite += found;
    });
    report.non_finite = non_finite;
    context.checkpoint(0.2);
    report.duplicates = mark_duplicates(cloud.positions, drop, context);
    context.checkpoint(0.9);
    if (report.removed() > 0) keep_unmarked(cloud, drop, context);
    context.checkpoint(1.0);
    return report;
}

}  // namespace stipple
