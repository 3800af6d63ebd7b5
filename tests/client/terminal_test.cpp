#include "cli/terminal.hpp"

#include <gtest/gtest.h>

namespace stipple::cli {
namespace {

TEST(Wrapped, BreaksAtSpacesAsFarAsThereAreAny) {
    EXPECT_EQ(wrapped("", 10), "");
    EXPECT_EQ(wrapped("one two three", 13), "one two three");
    EXPECT_EQ(wrapped("one two three", 12), "one two\nthree");
    EXPECT_EQ(wrapped("one two three", 2), "one\ntwo\nthree");
}

TEST(Wrapped, CountsColumnsAndNotBytes) {
    EXPECT_EQ(wrapped("\033[2mé · ü\033[0m", 5), "\033[2mé · ü\033[0m");
}

}  // namespace
}  // namespace stipple::cli
