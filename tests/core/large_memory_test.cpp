#include "base/large_memory.hpp"

#include <gtest/gtest.h>
#include <unistd.h>
#include <cstddef>
#include <cstring>
#include <fstream>
#include <numeric>
#include <utility>

// Memory of working arrays (core/src/base/large_memory.hpp).

namespace stipple {
namespace {

constexpr std::size_t kMiB = std::size_t{1} << 20;

/// What of this process is in memory.
std::size_t resident_bytes() {
    std::size_t total = 0, resident = 0;
    std::ifstream("/proc/self/statm") >> total >> resident;
    return resident * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

TEST(LargeMemory, CanBeWrittenFromEndToEnd) {
    for (const std::size_t bytes :
         {std::size_t{1}, kMiB, 2 * kMiB - 1, 2 * kMiB, 2 * kMiB + 1, 5 * kMiB + 3}) {
        const LargeMemory first(bytes), second(bytes);
        std::memset(first.data(), 1, bytes);
        std::memset(second.data(), 2, bytes);
        EXPECT_EQ(static_cast<const char*>(first.data())[0], 1) << bytes;
        EXPECT_EQ(static_cast<const char*>(first.data())[bytes - 1], 1) << bytes;
        EXPECT_EQ(static_cast<const char*>(second.data())[0], 2) << bytes;
    }
}

TEST(LargeMemory, GoesBackToTheSystemWhenItIsFreed) {
    constexpr std::size_t kBytes = 64 * kMiB;
    if (resident_bytes() == 0) GTEST_SKIP() << "no /proc";
    std::pmr::memory_resource& resource = large_memory_resource();
    void* const data = resource.allocate(kBytes);
    std::memset(data, 1, kBytes);
    const std::size_t with = resident_bytes();
    resource.deallocate(data, kBytes);
    EXPECT_LT(resident_bytes() + kBytes / 2, with);
}

TEST(LargeArray, KeepsItsValuesWhenItMoves) {
    LargeArray<int> first(3 * kMiB);
    std::iota(first.begin(), first.end(), 0);
    LargeArray<int> second;
    EXPECT_EQ(second.size(), 0U);
    second = std::move(first);
    ASSERT_EQ(second.size(), 3 * kMiB);
    EXPECT_EQ(second[0], 0);
    EXPECT_EQ(second[3 * kMiB - 1], static_cast<int>(3 * kMiB - 1));
}

}  // namespace
}  // namespace stipple
