#include "stipple/proto/thousands.hpp"

#include <gtest/gtest.h>

namespace stipple::proto {
namespace {

TEST(Thousands, AreSeparated) {
    EXPECT_EQ(with_separators(0), "0");
    EXPECT_EQ(with_separators(999), "999");
    EXPECT_EQ(with_separators(1000), "1,000");
    EXPECT_EQ(with_separators(435'545), "435,545");
    EXPECT_EQ(with_separators(12'345'678), "12,345,678");
    EXPECT_EQ(with_separators(UINT64_MAX), "18,446,744,073,709,551,615");
}

}  // namespace
}  // namespace stipple::proto
