#include "cli/text.hpp"

#include <gtest/gtest.h>

namespace stipple::cli {
namespace {

TEST(Printable, LeavesNothingThatATerminalObeys) {
    EXPECT_EQ(printable("odd \x01\x1b[31m red"), "odd   [31m red");
    EXPECT_EQ(printable("a\rb\nc\td\x7f"), "a b c d ");
    EXPECT_EQ(printable("\x1b]0;title\x07"), " ]0;title ");
    EXPECT_EQ(printable("\xc2\x9b"
                        "2J"),
              " 2J");  // CSI as UTF-8
    EXPECT_EQ(printable("\x9b"
                        "2J"),
              "\xef\xbf\xbd"
              "2J");  // CSI as a byte
}

TEST(Printable, KeepsTextAndMendsWhatIsNoUtf8) {
    EXPECT_EQ(printable("Größe · 点群"), "Größe · 点群");
    EXPECT_EQ(printable("\xc2\xa0\xc2\xb5"), "\xc2\xa0\xc2\xb5");
    EXPECT_EQ(printable("scan_\xe9.ply"), "scan_\xef\xbf\xbd.ply");
    EXPECT_EQ(printable(""), "");
}

TEST(Shortened, CutsNoCharacter) {
    EXPECT_EQ(shortened("abc", 3), "abc");
    EXPECT_EQ(shortened("abcd", 3), "abc");
    EXPECT_EQ(shortened("点群", 6), "点群");
    EXPECT_EQ(shortened("点群", 5), "点");
    EXPECT_EQ(shortened("点群", 2), "");
}

}  // namespace
}  // namespace stipple::cli
