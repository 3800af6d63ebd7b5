// Counts, shares, lengths and bits on the command line.
#include "parsed_command.hpp"

#include <gtest/gtest.h>
#include <cstdint>
#include <map>

namespace stipple::cli {
namespace {

TEST(CommandLine, WholeNumbersAreDecimalWithoutASign) {
    const std::map<std::string, std::vector<std::string>> options = {
        {"--points", {"simplify", "i.ply", "o.ply"}},
        {"--seed", {"simplify", "i.ply", "o.ply", "-n", "5"}},
        {"--threads", {"simplify", "i.ply", "o.ply", "-n", "5"}},
        {"--max-cluster-size", {"simplify", "i.ply", "o.ply", "-m", "hierarchical"}},
        {"--levels", {"pyramid", "i.ply", "o"}},
        {"--base-points", {"pyramid", "i.ply", "o"}},
        {"--base-bytes", {"pyramid", "i.ply", "o"}},
        {"--tile-points", {"pyramid", "i.ply", "o"}},
        {"--bytes", {"slice", "p", "o.ply"}},
        {"--samples", {"evaluate", "i.ply", "o.ply"}},
        {"--count", {"curve", "i.ply"}}};
    for (const auto& [option, command] : options) {
        for (const char* value : {"-3", "36893488147419103232", "x"}) {  // 2^65
            std::vector<std::string> arguments = command;
            arguments.insert(arguments.end(), {option, value});
            const std::string message = refusal(arguments);
            EXPECT_NE(message.find(option), std::string::npos) << message;
            EXPECT_NE(message.find(value), std::string::npos) << message;
        }
    }
    EXPECT_EQ(
        parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "-n", "0100"}).job.options.points,
        100U);
    EXPECT_EQ(
        parsed<PyramidCommand>({"pyramid", "i.ply", "o", "--base-bytes", "15kB"}).job.base_bytes,
        15'000U);
}

TEST(CommandLine, NothingFollowsAWholeNumber) {
    for (const std::string value : {"5k", "1e3", "1.5"}) {
        EXPECT_EQ(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--seed", value}),
                  "--seed: " + value + ": expected a whole number, as in 5000 (see --help)");
    }
}

TEST(CommandLine, PointsAreCountedInThousandsAndMillionsToo) {
    const auto points = [](const char* text) {
        return parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "-n", text})
            .job.options.points;
    };
    EXPECT_EQ(points("10k"), 10'000U);
    EXPECT_EQ(points("1.001k"), 1'001U);
    EXPECT_EQ(points("1.5M"), 1'500'000U);
    EXPECT_EQ(points("18446744073709551615"), UINT64_MAX);
    EXPECT_EQ(parsed<PyramidCommand>({"pyramid", "i.ply", "o", "--levels", "500,1k,2.5k"})
                  .job.options.sizes,
              (std::vector<std::uint64_t>{500, 1'000, 2'500}));
    EXPECT_EQ(points("1e3"), 1'000U);
    EXPECT_EQ(points("1.25E+6"), 1'250'000U);
    for (const std::string value :
         {"1e-3", "1.5e0", "e3", "1e", "1e30", "-1e3", "1.5", "1e3k", "0.0001k", "0k", "5K", "5m",
          "5 k", "k", "5kB", "nank", "infM", "99999999999999M", "-5k"}) {
        EXPECT_EQ(
            refusal({"simplify", "i.ply", "o.ply", "--points=" + value}),
            "--points: " + value + ": expected points, as in 5000, 10k, 1.5M or 1e6 (see --help)");
    }
    EXPECT_EQ(refusal({"simplify", "i.ply", "o.ply", "-n", "2%"}),
              "--points: 2%: expected points, as in 5000, 10k, 1.5M or 1e6; a share of them is "
              "--ratio 2% (see --help)");
}

TEST(CommandLine, ASharePerCentIsNotRounded) {
    const auto ratio = [](const char* text) {
        return parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "-r", text})
            .job.options.ratio;
    };
    EXPECT_EQ(ratio("0.123456789"), 0.123456789);
    EXPECT_EQ(ratio("12.3456789%"), 12.3456789 / 100);
    EXPECT_EQ(ratio("1e-7%"), 1e-7 / 100);
}

TEST(CommandLine, MaxErrorIsALengthOrAPartOfTheDiagonal) {
    const auto length =
        parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "--max-error", "0.1"});
    EXPECT_EQ(length.job.options.max_error, 0.1);
    EXPECT_FALSE(length.job.options.max_error_rel);
    const auto part =
        parsed<SimplifyCommand>({"simplify", "i.ply", "o.ply", "--max-error", "0.5%"});
    EXPECT_EQ(part.job.options.max_error_rel, 0.005);
    EXPECT_FALSE(part.job.options.max_error);
}

TEST(CommandLine, RefusesAMaxErrorThatNoCloudCanKeep) {
    for (const char* const value : {"0", "-1", "0%", "nan", "inf", "1km", "%"})
        EXPECT_NE(refusal({"simplify", "i.ply", "o.ply", "--max-error", value}).find("--max-error"),
                  std::string::npos)
            << value;
}

TEST(CommandLine, ARefusedNumberIsToldTheLimit) {
    for (const std::string value : {"abc", ""})
        EXPECT_EQ(refusal({"simplify", "i.ply", "o.ply", "-n", "5", "--oversampling", value}),
                  "--oversampling: " + value +
                      ": expected clusters per point, 1..1000, as in 3 (see --help)");
    EXPECT_EQ(refusal({"upsample", "i.ply", "o.ply", "--ratio", "200%"}),
              "--ratio: 200%: expected a factor above 1, as in 2 (see --help)");
    EXPECT_EQ(refusal({"pyramid", "i.ply", "o", "--ratio", "25%"}),
              "--ratio: 25%: expected a factor in (1, 64], as in 4 (see --help)");
    EXPECT_EQ(refusal({"upsample", "i.ply", "o.ply", "-n", "5", "--max-iterations", "99999999999"}),
              "--max-iterations: 99999999999: expected a whole number, 1..4294967295 (see --help)");
}

TEST(CommandLine, RefusesBitsAndPrecisionsThatNoFileHas) {
    const std::string bits = ": expected 1..30, or 0: exact floats (see --help)";
    const std::vector<std::vector<std::string>> commands = {
        {"simplify", "i.ply", "o.drc", "-n", "5"},
        {"convert", "i.ply", "o.drc"},
        {"pyramid", "i.ply", "o"}};
    for (const std::vector<std::string>& command : commands) {
        const auto refused = [&](const std::string& option, const std::string& value) {
            std::vector<std::string> arguments = command;
            arguments.insert(arguments.end(), {option, value});
            return refusal(arguments);
        };
        EXPECT_EQ(refused("--position-bits", "31"), "--position-bits: 31" + bits);
        EXPECT_EQ(refused("--attribute-bits", "31"), "--attribute-bits: 31" + bits);
        for (const std::string value : {"0", "1", "31"})
            EXPECT_EQ(refused("--normal-bits", value),
                      "--normal-bits: " + value + ": expected 2..30 (see --help)");
        for (const std::string value : {"0", "-1", "nan", "inf", "", "1m"})
            EXPECT_EQ(refused("--precision", value),
                      "--precision: " + value +
                          ": expected a length above 0, in input units, as in 0.001 (see --help)");
        for (const char* const option : {"--position-bits", "--attribute-bits"})
            EXPECT_EQ(refused(option, "0"), "accepted");
    }
}

TEST(CommandLine, ThreadsHaveALimit) {
    EXPECT_EQ(parsed<InspectCommand>({"inspect", "i.ply", "--threads", "1024"}).common.threads,
              1024U);
    EXPECT_NE(refusal({"inspect", "i.ply", "--threads", "1025"}).find("0 to 1024"),
              std::string::npos);
}

}  // namespace
}  // namespace stipple::cli
