#include "cli/curve_plot.hpp"

#include <gtest/gtest.h>

namespace stipple::cli {
namespace {

TEST(CurvePlot, IsWellFormedWhateverTheTitleHolds) {
    std::vector<proto::OutputCloud> levels(2);
    levels[0].points = 10;
    levels[1].points = 100;
    for (proto::OutputCloud& level : levels) level.curve.emplace();
    const std::string picture = curve_plot(levels, "a\xe9<b>&c\x01]]>\xef\xbf\xbe");
    EXPECT_NE(picture.find(">a\xef\xbf\xbd&lt;b&gt;&amp;c ]]&gt;\xef\xbf\xbd</text>"),
              std::string::npos)
        << picture.substr(0, 1000);
}

}  // namespace
}  // namespace stipple::cli
