#include "base/parallel_for.hpp"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <atomic>

namespace stipple {
namespace {

TEST(ParallelFor, LeavesTheThreadsOfOthersToThem) {
    constexpr auto kAllowed = tbb::global_control::max_allowed_parallelism;
    const tbb::global_control many(kAllowed, 8);
    RunContext context;
    context.threads = 2;
    std::atomic<std::size_t> least = 8;
    parallel_for_blocks(16, 1, context, [&](std::size_t, std::size_t) {
        least = std::min(least.load(), tbb::global_control::active_value(kAllowed));
    });
    EXPECT_EQ(least, 8U);
}

}  // namespace
}  // namespace stipple
