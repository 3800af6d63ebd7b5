#include "config.hpp"

#include "stipple/error.hpp"
#include "store_fixtures.hpp"

#include <gtest/gtest.h>
#include <cstdlib>
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

TEST(Config, SizesHaveFractions) {
    EXPECT_EQ(served({"--max-memory", "1.5GB"}).limits.max_job_memory_bytes, 1'500'000'000U);
    EXPECT_EQ(served({"--max-memory", "0.5 gib"}).limits.max_job_memory_bytes, 1U << 29U);
    EXPECT_EQ(served({"--max-upload", "4096"}).limits.max_upload_bytes, 4096U);
    for (const char* size : {"", "GB", "1.5XB", "1e9", "nan", "1001TB", "99999999999999999999GB"}) {
        EXPECT_EQ(refusal({"--max-upload", size}), "--max-upload: " + std::string(size) +
                                                       ": expected 0..1000TB, as in 1.5GB or "
                                                       "512MiB");
    }
}

TEST(Config, WhatWouldOnlyBreakTheServerIsRefused) {
    const std::vector<std::pair<std::vector<const char*>, std::string>> refused = {
        {{"--max-memory", "0"}, "--max-memory: 0: expected 100MB..1000TB"},
        {{"--max-output", "0"}, "--max-output: 0: expected 1kB..1000TB"},
        {{"--max-cpu-seconds", "0"}, "--max-cpu-seconds: 0: expected 1.."},
        {{"--max-points", "0"}, "--max-points: 0: expected 1.."},
        {{"--max-running", "0"}, "--max-running: 0: expected 1.."},
        {{"--drain-timeout", "10000000000"}, "--drain-timeout: 10000000000: expected 0..86400"},
        {{"--threads", "1025"}, "--threads: 1025: expected 0..1024"},
        {{"--threads", "1024"}, "--threads 1024: their stacks take"},
        {{"--threads", "64", "--max-memory", "300MB"}, "--threads 64: their stacks take"},
        {{"--max-memory", "100MB"}, "--threads 0 (one per processor): their stacks take"},
        {{"--host-name", "http://a b/"}, "--host-name: http://a b/: expected a domain"},
        {{"--host-name", "example.org:8080"}, ": expected a domain"}};
    for (const auto& [flags, words] : refused) {
        EXPECT_NE(refusal(flags).find(words), std::string::npos) << refusal(flags);
    }
    EXPECT_EQ(served({"--threads", "1024", "--max-memory", "8GB"}).threads, 1024U);
}

TEST(Config, ResultsAndCloudsAreKeptForAHundredYearsAtMost) {
    EXPECT_EQ(served({"--retention-seconds", "3155760000"}).limits.retention.count(), 3155760000);
    EXPECT_EQ(served({}).limits.cloud_retention.count(), 30 * 86400);
    const auto cloud_retention = [](const char* seconds) {
        return served({"--cloud-retention-seconds", seconds, "--retention-seconds", "3600"})
            .limits.cloud_retention.count();
    };
    EXPECT_EQ(cloud_retention("86400"), 86400);
    EXPECT_EQ(cloud_retention("60"), 3600) << "as long as results";
    for (const char* flag : {"--retention-seconds", "--cloud-retention-seconds"}) {
        for (const char* seconds :
             {"9999999999", "10000000000", "9223372036854775807", "18446744073709551615"})
            EXPECT_EQ(refusal({flag, seconds}),
                      std::string(flag) + ": " + seconds + ": expected 0..3162240000");
    }
}

TEST(Config, AFileWithAnUnknownFlagIsRefused) {
    const test::TemporaryFolder folder;
    const std::string file = (folder.path() / "stippled.ini").string();
    std::ofstream(file) << "[serve]\nmax-points=5\n";
    EXPECT_EQ(served({"--config", file.c_str()}).limits.decode.max_points, 5U);
    std::ofstream(file) << "[serve]\nmax-pionts=5\n";
    EXPECT_EQ(refusal({"--config", file.c_str()}), "--config: serve.max-pionts: no such flag");
}

TEST(Config, AKeyFileHasAName) {
    EXPECT_EQ(
        refusal({"--api-keys", ""}),
        "--api-keys: : expected the name of a file: without one, whoever asks would be served");
}

TEST(Config, AnEmptyVariableIsNoKeyFile) {
    ::setenv("STIPPLE_API_KEYS", "", 1);
    EXPECT_EQ(refusal({}),
              "STIPPLE_API_KEYS is empty: expected the name of a file, or no such variable");
    ::setenv("STIPPLE_API_KEYS", "keys.json", 1);
    EXPECT_EQ(served({}).api_keys, "keys.json");
    ::unsetenv("STIPPLE_API_KEYS");
}

TEST(Config, OnlyAnAddressOfThisMachineNeedsNoKeys) {
    for (const char* const own : {"127.0.0.1", "127.1.2.3", "::1", "localhost"})
        EXPECT_TRUE(is_loopback({own, 80})) << own;
    for (const char* const others : {"127.example.org", "0.0.0.0", "10.0.0.1", "::"})
        EXPECT_FALSE(is_loopback({others, 80})) << others;
}

TEST(Config, ASiteHasAScheme) {
    EXPECT_EQ(served({"--cors-origin", "https://example.org"}).cors_origins.size(), 1U);
    EXPECT_EQ(served({"--cors-origin", "*"}).cors_origins.size(), 1U);
    EXPECT_EQ(served({"--cors-origin", "http://[::1]:8000"}).cors_origins.size(), 1U);
    for (const char* never_sent :
         {"example.org", "https://example.org/", "https://a.org,https://b.org",
          "https://a.org https://b.org", "https://Example.org", "https://example.org:443"}) {
        EXPECT_NE(refusal({"--cors-origin", never_sent})
                      .find(": expected an origin such as https://example.org"),
                  std::string::npos)
            << never_sent;
    }
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

TEST(Config, AnUnknownWordIsNamedBeforeWhatIsMissing) {
    const auto expect = [](const char* text, const std::vector<const char*>& arguments) {
        test::expect_error(ErrorCode::InvalidArgument, text, [&] {
            parse_command_line(static_cast<int>(arguments.size()), arguments.data());
        });
    };
    expect("--lisen: no such flag; see stippled serve --help",
           {"stippled", "serve", "--lisen", "127.0.0.1:80"});
    expect("--lisen: no such flag", {"stippled", "serve", "--data", "x", "--lisen", "y"});
    expect("srve: no such command: expected serve, healthcheck or scrub",
           {"stippled", "srve", "--data", "x"});
    expect("--data is required", {"stippled", "serve"});
}

}  // namespace
}  // namespace stipple::server
