#include "cluster_kernels.hpp"

#include "support/support.hpp"

#include <algorithm>
#include <gtest/gtest.h>
#include <numeric>

namespace stipple {
namespace {

/// Samples of their own for one kernel to work on.
struct Work {
    Samples samples, scratch;

    explicit Work(const std::vector<Vec3f>& points) : samples(points.size()), scratch(points.size()) {
        const MutableSampleSpan s = samples.all();
        for (std::size_t i = 0; i < points.size(); ++i) {
            s.x[i] = points[i].x();
            s.y[i] = points[i].y();
            s.z[i] = points[i].z();
            s.index[i] = static_cast<Index>(i);
        }
    }
    std::vector<Index> order() const {
        const SampleSpan s = samples.all();
        return {s.index, s.index + s.size};
    }
};

const SplitPlane kPlane = {{0.4F, 0.5F, 0.6F}, {0.6F, -0.64F, 0.48F}, 0.05F};

bool is_left(const Vec3f& p) {
    const auto& [reference, normal, offset] = kPlane;
    return (p.x() - reference[0]) * normal[0] + (p.y() - reference[1]) * normal[1] + (p.z() - reference[2]) * normal[2] <
           offset;
}

class EveryKernel : public testing::TestWithParam<std::size_t> {};

TEST_P(EveryKernel, PartitionsAsStablePartitionDoes) {
    const std::vector<Vec3f> points = test::cube(GetParam()).positions;
    std::vector<Index> expected(points.size());
    std::iota(expected.begin(), expected.end(), Index{0});
    const auto middle = std::ranges::stable_partition(expected, [&](Index i) { return is_left(points[i]); }).begin();
    for (const ClusterKernels& kernels : available_cluster_kernels()) {
        Work work(points);
        const std::size_t left = kernels.partition(work.samples.all(), kPlane, work.scratch.all());
        EXPECT_EQ(left, static_cast<std::size_t>(middle - expected.begin())) << kernels.name;
        EXPECT_EQ(work.order(), expected) << kernels.name;
        for (std::size_t i = 0; i < points.size(); ++i) {
            EXPECT_EQ(work.samples.all().position(i), points[expected[i]]) << kernels.name;
        }
    }
}

TEST_P(EveryKernel, GivesTheSameBitsOfSumsNearThoseOfDoubles) {
    const std::vector<Vec3f> points = test::cube(GetParam(), 2).positions;
    SampleSums exact{};
    for (const Vec3f& p : points) {
        const Vec3d d = (p - Vec3f(kPlane.reference[0], kPlane.reference[1], kPlane.reference[2])).cast<double>();
        const SampleSums terms = {d.x(), d.y(), d.z(), d.x() * d.x(), d.x() * d.y(),
                                  d.x() * d.z(), d.y() * d.y(), d.y() * d.z(), d.z() * d.z()};
        for (std::size_t k = 0; k < exact.size(); ++k) exact[k] += terms[k];
    }
    const Work work(points);
    const SampleSums plain = available_cluster_kernels().front().sums(work.samples.all(), kPlane.reference);
    for (std::size_t k = 0; k < exact.size(); ++k) {
        EXPECT_NEAR(plain[k], exact[k], 1e-6 * static_cast<double>(points.size()));
    }
    for (const ClusterKernels& kernels : available_cluster_kernels()) {
        EXPECT_EQ(kernels.sums(work.samples.all(), kPlane.reference), plain) << kernels.name;
    }
}

INSTANTIATE_TEST_SUITE_P(Sizes, EveryKernel, testing::Values(1U, 2U, 7U, 8U, 9U, 16U, 31U, 127U, 128U, 129U, 1000U, 5003U));

}  // namespace
}  // namespace stipple
