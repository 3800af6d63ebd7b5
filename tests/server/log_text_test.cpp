#include "log_text.hpp"

#include <gtest/gtest.h>

namespace stipple::server {
namespace {

TEST(LogText, KeepsATextInItsField) {
    EXPECT_EQ(log_text("line 2: größer"), "\"line 2: größer\"");
    EXPECT_EQ(log_text(R"(x" status=200 tenant=root)"), R"("x\" status=200 tenant=root")");
    EXPECT_EQ(log_text(R"(x\" y)"), R"("x\\\" y")");
    EXPECT_EQ(log_text("a\nb\x1b[2J\x7f"), R"("a\x0ab\x1b[2J\x7f")");
}

TEST(LogText, LeavesANameOfOneWordAsItIs) {
    EXPECT_EQ(log_name("lab-7.ada@example:x"), "lab-7.ada@example:x");
    EXPECT_EQ(log_name("my org"), "\"my org\"");
    EXPECT_EQ(log_name("a\nb"), R"("a\x0ab")");
    EXPECT_EQ(log_name(""), "-");
}

}  // namespace
}  // namespace stipple::server
