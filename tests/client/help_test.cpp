// What `--help` says of each command.
#include "parsed_command.hpp"

#include <gtest/gtest.h>
#include <sstream>

namespace stipple::cli {
namespace {

TEST(CommandLine, HelpOfACurveHasNoTargets) {
    const std::string text = parsed<InfoCommand>({"curve", "--help"}).text;
    EXPECT_NE(text.find("--representative"), std::string::npos);
    EXPECT_EQ(text.find("--max-cluster-size"), std::string::npos);
    EXPECT_EQ(text.find("--voxel-size"), std::string::npos);
}

TEST(CommandLine, HelpFitsATerminalOf80Columns) {
    std::vector<std::vector<std::string>> asked = {{"--help"}};
    for (const char* command : {"simplify", "upsample", "analyze", "curve", "pyramid", "slice",
                                "evaluate", "inspect", "convert", "synthesize"})
        asked.push_back({command, "--help"});
    for (const std::vector<std::string>& arguments : asked) {
        std::istringstream lines(parsed<InfoCommand>(arguments).text);
        for (std::string line; std::getline(lines, line);) EXPECT_LE(line.size(), 80U) << line;
    }
}

TEST(CommandLine, HelpIsACommandToo) {
    EXPECT_EQ(parsed<InfoCommand>({"help"}).text, parsed<InfoCommand>({"--help"}).text);
    EXPECT_EQ(parsed<InfoCommand>({"help", "slice"}).text,
              parsed<InfoCommand>({"slice", "--help"}).text);
    EXPECT_TRUE(refusal({"help", "sliec"}).starts_with("sliec: no such command"));
}

TEST(CommandLine, HelpOfASliceSaysThatOneBudgetIsWanted) {
    const std::string text = parsed<InfoCommand>({"slice", "--help"}).text;
    const std::size_t budgets = text.find("\nBudget (give one):\n  -n,--points N");
    EXPECT_NE(budgets, text.npos) << text;
    EXPECT_NE(text.find("\n  --max-error E", budgets), text.npos) << text;
    EXPECT_EQ(text.find('['), text.find("[OPTIONS]")) << text;  // nothing in CLI11's own words
}

TEST(CommandLine, HelpGroupsOptionsUnderTheMethodsThatHaveThem) {
    const auto group_of = [](const char* command, const std::string& option) {
        std::istringstream lines(parsed<InfoCommand>({command, "--help"}).text);
        std::string group;
        for (std::string line; std::getline(lines, line);) {
            if (line.starts_with("  " + option + ' ')) return group;
            if (!line.starts_with(' ') && line.ends_with(':')) group = line;
        }
        return std::string();
    };
    EXPECT_EQ(group_of("simplify", "--max-cluster-size"), "For hierarchical and incremental:");
    EXPECT_EQ(group_of("simplify", "--max-variation"), "For hierarchical and incremental:");
    EXPECT_EQ(group_of("simplify", "--voxel-size"), "For voxel:");
    EXPECT_EQ(group_of("simplify", "--representative"), "For hierarchical, incremental and voxel:");
    EXPECT_EQ(group_of("simplify", "--reduce"), "Options:");
    EXPECT_EQ(group_of("curve", "--representative"), "For hierarchical:");
    EXPECT_EQ(group_of("curve", "--adaptivity"), "For particles:");
    EXPECT_EQ(group_of("pyramid", "--max-variation"), "For incremental:");
}

TEST(CommandLine, HelpOfACommandShowsExamples) {
    for (const char* command :
         {"simplify", "upsample", "analyze", "pyramid", "inspect", "convert", "synthesize"}) {
        const std::string text = parsed<InfoCommand>({command, "--help"}).text;
        EXPECT_NE(text.find(std::string("stipple ") + command), std::string::npos) << text;
        EXPECT_NE(text.find("Example"), std::string::npos);
    }
}

}  // namespace
}  // namespace stipple::cli
