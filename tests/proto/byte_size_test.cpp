#include "stipple/proto/byte_size.hpp"

#include <gtest/gtest.h>

namespace stipple::proto {
namespace {

TEST(ByteSize, IsWhatPeopleWrite) {
    EXPECT_EQ(bytes_of_size("0"), 0U);
    EXPECT_EQ(bytes_of_size("14600"), 14'600U);
    EXPECT_EQ(bytes_of_size("15kB"), 15'000U);
    EXPECT_EQ(bytes_of_size("10k"), 10'000U);
    EXPECT_EQ(bytes_of_size("1.5 MiB"), 1'572'864U);
    EXPECT_EQ(bytes_of_size("2gb"), 2'000'000'000U);
    EXPECT_EQ(bytes_of_size("1TB"), 1'000'000'000'000U);
    EXPECT_EQ(bytes_of_size("1e6"), 1'000'000U);
    EXPECT_EQ(bytes_of_size("1e6", std::chars_format::fixed), std::nullopt);
    EXPECT_EQ(bytes_of_size("2TiB"), 2'199'023'255'552U);
}

TEST(ByteSize, IsNothingElse) {
    for (const char* const text :
         {"", "kB", "5kg", "-1", "nan", "inf", "1e19", "2000000TB", "3 kk", "3 k B", "0x10"})
        EXPECT_EQ(bytes_of_size(text), std::nullopt) << text;
}

}  // namespace
}  // namespace stipple::proto
