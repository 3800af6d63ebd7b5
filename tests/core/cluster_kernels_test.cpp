#include "clustering/cluster_kernels.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>

namespace stipple {
namespace {

/// Samples of their own for one kernel to work on.
struct Work {
    Samples samples, scratch;

    explicit Work(const std::vector<Vec3f>& points)
        : samples(points.size()), scratch(points.size()) {
        const MutableSampleSpan s = samples.all();
        for (std::size_t i = 0; i < points.size(); ++i) {
            s.x[i] = points[i].x();
            s.y[i] = points[i].y();
            s.z[i] = points[i].z();
            s.index[i] = static_cast<Index>(i);
        }
    }
};

std::vector<Index> order_of(const SampleSpan& s) {
    return {s.index, s.index + s.size};
}

const SplitPlane kPlane = {{0.4F, 0.5F, 0.6F}, {0.6F, -0.64F, 0.48F}, 0.05F};

bool is_left(const Vec3f& p) {
    const auto& [reference, normal, offset] = kPlane;
    return (p.x() - reference[0]) * normal[0] + (p.y() - reference[1]) * normal[1] +
               (p.z() - reference[2]) * normal[2] <
           offset;
}

class EveryKernel : public testing::TestWithParam<std::size_t> {};

TEST_P(EveryKernel, PartitionsAsPlainCodeDoes) {
    const std::vector<Vec3f> points = test::cube(GetParam()).positions;
    Work plain(points);
    const auto left = available_cluster_kernels().front().partition(plain.samples.all(), kPlane,
                                                                    plain.scratch.all());
    EXPECT_EQ(left, static_cast<std::size_t>(std::ranges::count_if(points, is_left)));
    for (const ClusterKernels& kernels : available_cluster_kernels()) {
        Work work(points);
        EXPECT_EQ(kernels.partition(work.samples.all(), kPlane, work.scratch.all()), left)
            << kernels.name;
        const SampleSpan result = work.scratch.all();
        EXPECT_EQ(order_of(result), order_of(plain.scratch.all())) << kernels.name;
        std::vector<bool> found(points.size());
        for (std::size_t i = 0; i < points.size(); ++i) {
            EXPECT_EQ(result.position(i), points[result.index[i]]) << kernels.name;
            EXPECT_EQ(is_left(result.position(i)), i < left) << kernels.name;
            found[result.index[i]] = true;
        }
        EXPECT_EQ(std::ranges::count(found, true), std::ranges::ssize(points)) << kernels.name;
    }
}

TEST_P(EveryKernel, PartitionsWhatLiesOnOneSideToThatSide) {
    std::vector<Vec3f> left, right;
    for (const Vec3f& p : test::cube(4 * GetParam() + 100, 3).positions)
        (is_left(p) ? left : right).push_back(p);
    left.resize(std::min(left.size(), GetParam()));
    right.resize(std::min(right.size(), GetParam()));
    for (const ClusterKernels& kernels : available_cluster_kernels()) {
        for (const auto& points : {left, right}) {
            Work work(points);
            const std::size_t expected = is_left(points.front()) ? points.size() : 0;
            EXPECT_EQ(kernels.partition(work.samples.all(), kPlane, work.scratch.all()), expected);
            std::vector<Index> order = order_of(work.scratch.all());
            std::ranges::sort(order);
            for (std::size_t i = 0; i < order.size(); ++i) EXPECT_EQ(order[i], i);
        }
    }
}

/// Points in ten blocks, every third taken, under two groups of boxes.
struct TenBlocks {
    static constexpr std::size_t kBlocks = 10;

    explicit TenBlocks(const std::vector<Vec3f>& cloud)
        : points(cloud), work(padded(cloud)), taken(cloud.size() + 8), boxes(2) {
        for (std::size_t i = 0; i < points.size(); i += 3) taken[i] = HUGE_VALF;
        for (std::size_t b = 0; b <= kBlocks; ++b)
            begins.push_back(static_cast<Index>(b * points.size() / kBlocks));
        for (EightBoxes& group : boxes) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                group.low[axis].fill(HUGE_VALF);
                group.high[axis].fill(-HUGE_VALF);
            }
        }
        for (std::size_t b = 0; b < kBlocks; ++b) {
            for (Index i = begins[b]; i < begins[b + 1]; ++i) {
                for (std::size_t axis = 0; axis < 3; ++axis) {
                    const float c = points[i][static_cast<Eigen::Index>(axis)];
                    float &low = boxes[b / 8].low[axis][b % 8],
                          &high = boxes[b / 8].high[axis][b % 8];
                    low = std::min(low, c);
                    high = std::max(high, c);
                }
            }
        }
    }
    static std::vector<Vec3f> padded(std::vector<Vec3f> cloud) {
        cloud.resize(cloud.size() + 8);
        return cloud;
    }
    SampleBlocks view() const {
        return {work.samples.all(), taken.data(), begins.data(), boxes.data()};
    }

    std::vector<Vec3f> points;
    Work work;
    std::vector<float> taken;
    std::vector<Index> begins;
    std::vector<EightBoxes> boxes;
};

/// What `nearby` finds of the samples up to `end`.
struct Found {
    std::vector<float> all, free;
    std::vector<Index> places;

    Found(const TenBlocks& blocks, const NearbyQuery& query, std::size_t end) {
        for (std::size_t i = 0; i < end; ++i) {
            const Vec3f d = blocks.points[i] - Vec3f(query.center.data());
            const float distance_sq = d.x() * d.x() + d.y() * d.y() + d.z() * d.z();
            if (distance_sq <= query.counted_sq) all.push_back(distance_sq);
            if (distance_sq > query.limit_sq || blocks.taken[i] > 0) continue;
            free.push_back(distance_sq);
            places.push_back(static_cast<Index>(i));
        }
    }
    /// Whether a kernel finds the same, and tells as much of what lies beyond.
    bool is_as_by(const ClusterKernels& kernels, const TenBlocks& blocks, const NearbyQuery& query,
                  bool is_beyond) const {
        const std::size_t room = blocks.taken.size();
        std::vector<float> all_sq(room), free_sq(room);
        std::vector<Index> free_places(room);
        const std::array<Index, 2> groups = {0, 1};
        const NearbyOutput end =
            kernels.nearby(blocks.view(), groups.data(), groups.size(), query,
                           {all_sq.data(), free_sq.data(), free_places.data()});
        all_sq.resize(static_cast<std::size_t>(end.all_sq - all_sq.data()));
        free_sq.resize(static_cast<std::size_t>(end.free_sq - free_sq.data()));
        free_places.resize(static_cast<std::size_t>(end.free - free_places.data()));
        return all_sq == all && free_sq == free && free_places == places &&
               end.is_beyond == is_beyond;
    }
};

/// Expects every kernel to find the samples up to `end` of those that the query asks for.
void expect_found(const TenBlocks& blocks, const NearbyQuery& query, Index end, bool is_beyond) {
    const Found expected(blocks, query, end);
    for (const ClusterKernels& kernels : available_cluster_kernels())
        EXPECT_TRUE(expected.is_as_by(kernels, blocks, query, is_beyond)) << kernels.name;
}

constexpr std::array<float, 3> kSomewhere = {0.4F, 0.5F, 0.6F};
constexpr float kAllSq = 9;  // of a cube of side 1

TEST_P(EveryKernel, FindsWhatIsNearbyAsPlainCodeDoes) {
    const Index n = GetParam();
    const TenBlocks blocks(test::cube(n, 5).positions);
    expect_found(blocks, {kSomewhere, 0.1F, 0.2F, 0, n, 2 * n}, n, false);
}

TEST_P(EveryKernel, LooksAtNothingBeyondButTells) {
    const Index n = GetParam();
    const TenBlocks blocks(test::cube(n, 5).positions);
    const Index end = blocks.begins[9];
    expect_found(blocks, {kSomewhere, kAllSq, kAllSq, 0, end, 2 * n}, end, true);
}

TEST_P(EveryKernel, StopsBehindEightBlocksOnceItHasEnough) {
    const Index n = GetParam();
    const TenBlocks blocks(test::cube(n, 5).positions);
    const Index first = blocks.begins[8];
    expect_found(blocks, {kSomewhere, kAllSq, kAllSq, 0, n, 0}, first > 0 ? first : n, false);
}

TEST_P(EveryKernel, FindsTheBoxesThatAPartOfIsNear) {
    const std::vector<Vec3f> points = test::cube(GetParam() + 18, 7).positions;
    const Vec3f center = points[16], far = points[17];
    const float radius_sq = (far - center).squaredNorm();
    EightBoxes boxes;
    unsigned expected = 0;
    for (std::size_t i = 0; i < 8; ++i) {
        const Vec3f low = points[2 * i].cwiseMin(points[2 * i + 1]),
                    high = points[2 * i].cwiseMax(points[2 * i + 1]);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            boxes.low[axis][i] = i == 5 ? HUGE_VALF : low[static_cast<Eigen::Index>(axis)];
            boxes.high[axis][i] = i == 5 ? -HUGE_VALF : high[static_cast<Eigen::Index>(axis)];
        }
        const float distance_sq = (center.cwiseMax(low).cwiseMin(high) - center).squaredNorm();
        if (i != 5 && distance_sq <= radius_sq) expected |= 1U << i;
    }
    for (const ClusterKernels& kernels : available_cluster_kernels()) {
        EXPECT_EQ(kernels.boxes_within(boxes, {center.x(), center.y(), center.z()}, radius_sq),
                  expected)
            << kernels.name;
    }
}

TEST_P(EveryKernel, PacksWhatIsBetweenLimitsAsPlainCodeDoes) {
    std::vector<float> values;
    std::vector<Index> places;
    for (const Vec3f& p : test::cube(GetParam(), 6).positions) {
        places.push_back(static_cast<Index>(1000 - values.size()));
        values.push_back(p.x());
    }
    const std::size_t n = values.size();
    const float low = values[n / 2], high = std::max(low, values[n / 3]);  // one left out, one in
    std::vector<float> between;
    std::vector<Index> beside;
    for (std::size_t i = 0; i < n; ++i) {
        if (!(values[i] > low && values[i] <= high)) continue;
        between.push_back(values[i]);
        beside.push_back(places[i]);
    }
    values.resize(n + 8, HUGE_VALF);
    places.resize(n + 8);
    for (const ClusterKernels& kernels : available_cluster_kernels()) {
        std::vector<float> packed(n + 8);
        std::vector<Index> packed_places(n + 8);
        packed.resize(kernels.values_between(values.data(), n, low, high, packed.data()));
        packed_places.resize(kernels.places_between(values.data(), places.data(), n, low, high,
                                                    packed_places.data()));
        EXPECT_EQ(packed, between) << kernels.name;
        EXPECT_EQ(packed_places, beside) << kernels.name;
    }
}

TEST_P(EveryKernel, GivesTheLeastBoxAndTheCount) {
    const std::vector<Vec3f> points = test::cube(GetParam(), 6).positions;
    Vec3f low = points.front(), high = low;
    std::vector<float> values;
    for (const Vec3f& p : points) {
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
        values.push_back(p.x());
    }
    const float limit = values.front();
    const auto count = std::ranges::count_if(values, [&](float v) { return v <= limit; });
    values.resize(values.size() + 8, HUGE_VALF);
    const Work work(points);
    for (const ClusterKernels& kernels : available_cluster_kernels()) {
        const SampleBox box = kernels.box(work.samples.all());
        EXPECT_EQ(Vec3f(box.low[0], box.low[1], box.low[2]), low) << kernels.name;
        EXPECT_EQ(Vec3f(box.high[0], box.high[1], box.high[2]), high) << kernels.name;
        EXPECT_EQ(kernels.count(values.data(), points.size(), limit),
                  static_cast<std::size_t>(count))
            << kernels.name;
    }
}

TEST_P(EveryKernel, GivesTheSameBitsOfSumsNearThoseOfDoubles) {
    const std::vector<Vec3f> points = test::cube(GetParam(), 2).positions;
    SampleSums exact{};
    for (const Vec3f& p : points) {
        const Vec3d d = (p - Vec3f(kPlane.reference[0], kPlane.reference[1], kPlane.reference[2]))
                            .cast<double>();
        const SampleSums terms = {d.x(),         d.y(),         d.z(),
                                  d.x() * d.x(), d.x() * d.y(), d.x() * d.z(),
                                  d.y() * d.y(), d.y() * d.z(), d.z() * d.z()};
        for (std::size_t k = 0; k < exact.size(); ++k) exact[k] += terms[k];
    }
    const Work work(points);
    const SampleSums plain =
        available_cluster_kernels().front().sums(work.samples.all(), kPlane.reference);
    for (std::size_t k = 0; k < exact.size(); ++k) {
        EXPECT_NEAR(plain[k], exact[k], 1e-6 * static_cast<double>(points.size()));
    }
    for (const ClusterKernels& kernels : available_cluster_kernels()) {
        EXPECT_EQ(kernels.sums(work.samples.all(), kPlane.reference), plain) << kernels.name;
    }
}

std::array<Symmetric3, kSpreads> some_scatters() {
    // A ball, a disc, a rod and a skew one.
    return {{{2, 0, 0, 2, 0, 2}, {3, 0, 0, 3, 0, 0}, {0, 0, 0, 5, 0, 0}, {4, 1, -2, 3, 0.5, 2}}};
}

TEST(Spreads, AreTheExtremeEigenvaluesAndTheVectorOfTheLargest) {
    for (const double scale : {1.0, 1e-60, 1e60}) {
        auto scatters = some_scatters();
        for (Symmetric3& s : scatters)
            s = {s.xx * scale, s.xy * scale, s.xz * scale,
                 s.yy * scale, s.yz * scale, s.zz * scale};
        for (const ClusterKernels& kernels : available_cluster_kernels()) {
            const auto spreads = kernels.spreads(scatters);
            for (std::size_t i = 0; i < kSpreads; ++i) {
                const Symmetric3& s = scatters[i];
                const auto values = eigenvalues(s);
                // Of equal eigenvalues half the digits.
                EXPECT_NEAR(spreads[i].smallest, values[0], 1e-7 * values[2]) << kernels.name << i;
                EXPECT_NEAR(spreads[i].largest, values[2], 1e-7 * values[2]) << kernels.name << i;
                const Vec3d& v = spreads[i].direction;
                const Vec3d product(s.xx * v.x() + s.xy * v.y() + s.xz * v.z(),
                                    s.xy * v.x() + s.yy * v.y() + s.yz * v.z(),
                                    s.xz * v.x() + s.yz * v.y() + s.zz * v.z());
                EXPECT_NEAR(v.norm(), 1.0, 1e-12);
                EXPECT_LT((product - spreads[i].largest * v).norm(), 1e-7 * values[2]) << i;
            }
        }
    }
}

TEST(Spreads, OfNothingAreNothing) {
    for (const ClusterKernels& kernels : available_cluster_kernels()) {
        const Spread spread = kernels.spreads({})[0];
        EXPECT_EQ(spread.smallest, 0);
        EXPECT_EQ(spread.largest, 0);
        EXPECT_EQ(spread.direction.norm(), 1);
    }
}

TEST(Spreads, AreTheSameBitsForEveryInstructionSet) {
    std::array<Symmetric3, kSpreads> scatters;
    const auto cloud = test::cube(1'000, 7).positions;
    for (std::size_t i = 0; i + 8 <= cloud.size(); i += 8) {
        for (std::size_t k = 0; k < kSpreads; ++k) {
            const Vec3d a = cloud[i + 2 * k].cast<double>(),
                        b = cloud[i + 2 * k + 1].cast<double>();
            scatters[k] = {a.x(), b.x() - 0.5, b.y() - 0.5, a.y(), b.z() - 0.5, a.z()};
        }
        const auto plain = available_cluster_kernels().front().spreads(scatters);
        for (const ClusterKernels& kernels : available_cluster_kernels()) {
            const auto spreads = kernels.spreads(scatters);
            for (std::size_t k = 0; k < kSpreads; ++k) {
                EXPECT_EQ(spreads[k].smallest, plain[k].smallest);
                EXPECT_EQ(spreads[k].largest, plain[k].largest);
                EXPECT_EQ(spreads[k].direction, plain[k].direction);
            }
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Sizes, EveryKernel,
                         testing::Values(1U, 2U, 7U, 8U, 9U, 16U, 31U, 127U, 128U, 129U, 1000U,
                                         5003U));

}  // namespace
}  // namespace stipple
