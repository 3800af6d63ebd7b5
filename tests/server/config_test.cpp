#include "config.hpp"

#include "stipple/error.hpp"
#include "store_fixtures.hpp"

#include <gtest/gtest.h>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace stipple::server {
namespace {

ServerConfig served(std::vector<const char*> flags) {
    flags.insert(flags.begin(), {"stippled", "serve", "--data", "d"});
    return parse_command_line(static_cast<int>(flags.size()), flags.data()).value().config;
}

std::string refusal(const std::vector<const char*>& flags) {
    try {
        served(flags);
    } catch (const Error& error) {
        return error.what();
    }
    return "accepted";
}

std::string printed(std::vector<const char*> arguments) {
    arguments.insert(arguments.begin(), "stippled");
    testing::internal::CaptureStdout();
    parse_command_line(static_cast<int>(arguments.size()), arguments.data());
    return testing::internal::GetCapturedStdout();
}

TEST(Config, NumbersHaveNoSign) {
    for (const char* flag : {"--max-points", "--max-upload", "--retention-seconds", "--threads"})
        EXPECT_EQ(refusal({flag, "-5"}), flag + std::string(": -5: expected no sign"));
}

TEST(Config, SizesHaveUnits) {
    EXPECT_EQ(served({"--max-upload", "3MB"}).limits.max_upload_bytes, 3'000'000U);
    EXPECT_EQ(served({"--max-upload", "3MiB"}).limits.max_upload_bytes, 3U << 20U);
    EXPECT_EQ(served({"--max-points", "7"}).limits.decode.max_points, 7U);
}

TEST(Config, AFileWithAnUnknownFlagIsRefused) {
    const test::TemporaryFolder folder;
    const std::string file = (folder.path() / "stippled.ini").string();
    std::ofstream(file) << "[serve]\nmax-points=5\n";
    EXPECT_EQ(served({"--config", file.c_str()}).limits.decode.max_points, 5U);
    std::ofstream(file) << "[serve]\nmax-pionts=5\n";
    EXPECT_EQ(refusal({"--config", file.c_str()}), "--config: serve.max-pionts: no such flag");
}

TEST(Config, ASiteHasAScheme) {
    EXPECT_EQ(served({"--cors-origin", "https://example.org"}).cors_origins.size(), 1U);
    EXPECT_EQ(served({"--cors-origin", "*"}).cors_origins.size(), 1U);
    EXPECT_NE(refusal({"--cors-origin", "example.org"}).find("expected https://example.org"),
              std::string::npos);
}

TEST(Config, HelpHasEightyColumns) {
    for (const std::vector<const char*>& command :
         {std::vector<const char*>{}, {"serve"}, {"healthcheck"}, {"scrub"}}) {
        std::vector<const char*> arguments = command;
        arguments.push_back("--help");
        std::istringstream help(printed(arguments));
        int lines = 0;
        for (std::string line; std::getline(help, line); ++lines)
            EXPECT_LE(line.size(), 80U) << line;
        EXPECT_GT(lines, 4);
    }
}

TEST(Config, VersionNamesTheProgram) {
    EXPECT_TRUE(printed({"--version"}).starts_with("stippled "));
}

TEST(Config, WhoNamesNoCommandIsToldOfTheHelp) {
    for (const std::vector<const char*>& arguments :
         {std::vector<const char*>{"stippled"}, {"stippled", "help"}}) {
        test::expect_error(ErrorCode::InvalidArgument, "; see stippled --help", [&] {
            parse_command_line(static_cast<int>(arguments.size()), arguments.data());
        });
    }
}

}  // namespace
}  // namespace stipple::server
