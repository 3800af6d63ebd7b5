#include "cli/units.hpp"

#include <gtest/gtest.h>

namespace stipple::cli {
namespace {

TEST(Units, ShowBytesWithThreeDigitsAtMost) {
    EXPECT_EQ(readable_bytes(0), "0 B");
    EXPECT_EQ(readable_bytes(999), "999 B");
    EXPECT_EQ(readable_bytes(1000), "1 kB");
    EXPECT_EQ(readable_bytes(60'000), "60 kB");
    EXPECT_EQ(readable_bytes(10'400'000), "10.4 MB");
    EXPECT_EQ(readable_bytes(999'600), "1 MB");
    EXPECT_EQ(readable_bytes(123'456), "123 kB");
    EXPECT_EQ(readable_bytes(2'147'483'648), "2.1 GB");
}

TEST(Units, ShowTimesAsPeopleSayThem) {
    EXPECT_EQ(readable_seconds(0.0004), "0.4 ms");
    EXPECT_EQ(readable_seconds(0.042), "42 ms");
    EXPECT_EQ(readable_seconds(0.9999), "1 s");
    EXPECT_EQ(readable_seconds(1.84), "1.8 s");
    EXPECT_EQ(readable_seconds(12.3), "12 s");
    EXPECT_EQ(readable_seconds(59.6), "1 min 0 s");
    EXPECT_EQ(readable_seconds(200), "3 min 20 s");
    EXPECT_EQ(readable_seconds(7500), "2 h 5 min");
}

TEST(Units, ShowMeasuredValuesWithThreeDigits) {
    EXPECT_EQ(three_digits(0), "0");
    EXPECT_EQ(three_digits(0.0123456), "0.0123");
    EXPECT_EQ(three_digits(15'432), "1.54e+04");
}

TEST(Units, CountOneThingAsOne) {
    EXPECT_EQ(counted(1, "point"), "1 point");
    EXPECT_EQ(counted(0, "point"), "0 points");
    EXPECT_EQ(counted(435'545, "point"), "435,545 points");
    EXPECT_EQ(counted(2, "try", "tries"), "2 tries");
}

TEST(Units, ShowSharesWithoutFalsePrecision) {
    EXPECT_EQ(readable_share(5000, 435'545), "1.1 %");
    EXPECT_EQ(readable_share(1, 4), "25 %");
    EXPECT_EQ(readable_share(1, 1), "100 %");
    EXPECT_EQ(readable_share(1, 1'000'000), "<0.1 %");
    EXPECT_EQ(readable_share(0, 10), "0 %");
    EXPECT_EQ(readable_share(0, 0), "0 %");
}

}  // namespace
}  // namespace stipple::cli
