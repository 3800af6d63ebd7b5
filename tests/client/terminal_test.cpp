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

TEST(CutAmid, KeepsTheBeginningAndTheEnd) {
    EXPECT_EQ(cut_amid("scan.ply", 8, true), "scan.ply");
    EXPECT_EQ(cut_amid("scan_of_a_stair_5k.ply", 12, true), "scan_…5k.ply");
    EXPECT_EQ(cut_amid("scan_of_a_stair_5k.ply", 12, false), "scan_~5k.ply");
    EXPECT_EQ(cut_amid("Größe über alles.ply", 9, true), "Größ….ply");
    EXPECT_EQ(cut_amid("abc", 1, true), "…");
}

}  // namespace
}  // namespace stipple::cli
