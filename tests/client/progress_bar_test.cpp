#include "cli/progress_bar.hpp"

#include <gtest/gtest.h>

namespace stipple::cli {
namespace {

constexpr TextStyle kPlain{false, false}, kUnicode{true, false}, kColour{true, true};

TEST(ProgressBar, FillsFromLeftToRight) {
    EXPECT_EQ(progress_bar(0, 4, kPlain), "[----]");
    EXPECT_EQ(progress_bar(0.5, 4, kPlain), "[##--]");
    EXPECT_EQ(progress_bar(1, 4, kPlain), "[####]");
}

TEST(ProgressBar, ShowsEighthsOfACellWhereUnicodeIs) {
    EXPECT_EQ(progress_bar(0, 2, kUnicode), "▕  ▏");
    EXPECT_EQ(progress_bar(1.0 / 16, 2, kUnicode), "▕▏ ▏");
    EXPECT_EQ(progress_bar(0.75, 2, kUnicode), "▕█▌▏");
    EXPECT_EQ(progress_bar(1, 2, kUnicode), "▕██▏");
}

TEST(ProgressBar, IsAsWideAsAskedForAtEveryFraction) {
    for (const TextStyle& style : {kPlain, kUnicode, kColour})
        for (int i = -5; i <= 1005; ++i)
            ASSERT_EQ(display_width(progress_bar(i / 1000.0, 30, style)), style.color ? 30U : 32U)
                << i;
}

TEST(ProgressBar, HoldsEscapesOnlyInColour) {
    EXPECT_EQ(progress_bar(0.3, 9, kUnicode).find('\033'), std::string::npos);
    EXPECT_NE(progress_bar(0.3, 9, kColour).find('\033'), std::string::npos);
}

TEST(ProgressLine, NamesStageShareAndTime) {
    const std::string line = progress_line({"simplify", 0.5, 10}, kPlain, 80);
    EXPECT_NE(line.find("simplify"), std::string::npos);
    EXPECT_NE(line.find("50 %"), std::string::npos);
    EXPECT_NE(line.find("10 s left"), std::string::npos);
}

TEST(ProgressLine, ForeseesNothingBeforeThereIsSomethingToGoBy) {
    EXPECT_EQ(time_note({"decode", 0.5, 0.3}), "300 ms");
    EXPECT_EQ(time_note({"decode", 0.01, 30}), "30 s");
    EXPECT_EQ(time_note({"decode", 0.25, 5}), "15 s left");
    // Standing still it counts down, and then tells no more what it does not know.
    EXPECT_EQ(time_note({"decode", 0.25, 6, 1}), "14 s left");
    EXPECT_EQ(time_note({"decode", 0.25, 25, 20}), "25 s");
}

TEST(ProgressLine, NeverShowsAHundredPercent) {
    EXPECT_NE(progress_line({"encode", 1, 3}, kPlain, 80).find("99 %"), std::string::npos);
}

TEST(ProgressLine, FitsIntoEveryTerminal) {
    for (unsigned columns = 1; columns <= 200; ++columns)
        for (const TextStyle& style : {kPlain, kUnicode, kColour})
            ASSERT_LT(display_width(progress_line({"simplify", 0.4, 5000}, style, columns)),
                      columns);
}

TEST(ProgressLine, KeepsTheBarInOnePlaceWhileTheRestChanges) {
    const std::string early = progress_line({"clean", 0.05, 0.1}, kPlain, 80);
    const std::string late = progress_line({"simplify", 0.95, 4000}, kPlain, 80);
    EXPECT_EQ(early.find('['), late.find('['));
    EXPECT_EQ(early.find(']'), late.find(']'));
}

}  // namespace
}  // namespace stipple::cli
