#include "cli/command_line.hpp"

#include <gtest/gtest.h>

namespace stipple::cli {
namespace {

template <typename T>
T parsed(const std::vector<std::string>& arguments) {
    return std::get<T>(parse_command_line(arguments));
}

std::string refusal(const std::vector<std::string>& arguments) {
    try {
        parse_command_line(arguments);
    } catch (const UsageError& error) {
        return error.what();
    }
    return "accepted";
}

TEST(CommandLine, SimplifyTakesTheFormThatMeasurementsRelyOn) {
    const auto command = parsed<SimplifyCommand>({"simplify", "in.ply", "out.drc", "--method",
                                                  "hierarchical", "--points", "5000", "--threads",
                                                  "2", "--seed", "9", "--json", "f.json"});
    EXPECT_EQ(command.input, "in.ply");
    EXPECT_EQ(command.job.options.points, 5000U);
    EXPECT_EQ(command.job.options.seed, 9U);
    EXPECT_EQ(command.job.output.formats, std::vector{CloudFormat::Draco});
    EXPECT_EQ(command.common.threads, 2U);
    EXPECT_EQ(command.common.json, "f.json");
}

TEST(CommandLine, DashIsStandardOutputForTheFigures) {
    EXPECT_EQ(parsed<InspectCommand>({"inspect", "in.ply", "--json", "-"}).common.json, "-");
}

TEST(CommandLine, PyramidTakesALadderOrARatio) {
    const auto ladder = parsed<PyramidCommand>({"pyramid", "in.ply", "out", "--levels", "10,100"});
    EXPECT_EQ(ladder.job.options.sizes, (std::vector<std::uint64_t>{10, 100}));
    const auto ratio =
        parsed<PyramidCommand>({"pyramid", "in.ply", "out", "--ratio", "2", "--base-points", "50"});
    EXPECT_EQ(ratio.job.options.ratio, 2.0);
    EXPECT_EQ(ratio.job.options.base_points, 50U);
    EXPECT_EQ(ratio.job.output.formats.size(), 2U);
    EXPECT_NE(refusal({"pyramid", "in.ply", "out", "--levels", "10", "--ratio", "2"}), "accepted");
}

TEST(CommandLine, ReductionsAreByName) {
    const auto command =
        parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "-n", "5", "--reduce",
                                 "intensity=max", "--reduce", "label=mode"});
    EXPECT_EQ(command.job.options.reductions.at("intensity"), Reduction::Max);
    EXPECT_EQ(command.job.options.reductions.at("label"), Reduction::Mode);
}

TEST(CommandLine, MaxErrorIsAnsweredWithTheRemedy) {
    const std::string message = refusal({"simplify", "i.ply", "o.ply", "--max-error", "0.1"});
    EXPECT_NE(message.find("--points"), std::string::npos);
    EXPECT_NE(message.find("--ratio"), std::string::npos);
}

TEST(CommandLine, RefusesWhatCannotBeDoneByNameAndValue) {
    EXPECT_NE(refusal({"simplify", "i.ply", "o.ply"}).find("--points"), std::string::npos);
    EXPECT_NE(refusal({"simplify", "i.ply", "o.xyz", "-n", "5"}).find("o.xyz"), std::string::npos);
    EXPECT_NE(refusal({"simplify", "i.ply", "o.ply", "-n", "0"}).find("points 0"),
              std::string::npos);
    EXPECT_NE(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "-r", "0.5"}), "accepted");
    EXPECT_NE(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--method", "magic"}).find("magic"),
              std::string::npos);
    EXPECT_NE(
        refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--reduce", "=max"}).find("NAME=POLICY"),
        std::string::npos);
    EXPECT_NE(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--api-key", "k"}).find("--server"),
              std::string::npos);
    EXPECT_NE(refusal({"frobnicate"}).find("frobnicate"), std::string::npos);
}

TEST(CommandLine, HelpOfACommandShowsExamples) {
    for (const char* command : {"simplify", "pyramid", "inspect", "convert", "synthesize"}) {
        const std::string text = parsed<InfoCommand>({command, "--help"}).text;
        EXPECT_NE(text.find(std::string("stipple ") + command), std::string::npos) << text;
        EXPECT_NE(text.find("Example"), std::string::npos);
    }
}

}  // namespace
}  // namespace stipple::cli
