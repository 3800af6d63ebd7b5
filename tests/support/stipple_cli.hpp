#pragma once

#include "support/stippled_process.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace stipple::test {

inline std::string content(const std::filesystem::path& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
}

struct Outcome {
    int exit_code = -1;
    std::string out, err;
};

/// Runs the real program in a folder of its own.
class StippleCli : public testing::Test {
protected:
    /// @param before  what starts the program, as `timeout 1 `.
    Outcome stipple(const std::string& arguments, const std::string& before = "") const {
        const std::string command = "cd '" + folder_.path().string() + "' && " + before + "'" +
                                    program("stipple").string() + "' " + arguments +
                                    " > out.txt 2> err.txt";
        const int status = std::system(command.c_str());
        Outcome outcome{WIFEXITED(status) ? WEXITSTATUS(status) : -1, content(folder_ / "out.txt"),
                        content(folder_ / "err.txt")};
        std::filesystem::remove(folder_ / "out.txt");
        std::filesystem::remove(folder_ / "err.txt");
        return outcome;
    }

    void synthesize(const std::string& name, int points) const {
        const Outcome outcome =
            stipple("synthesize " + name + " --points " + std::to_string(points));
        ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    }

    std::vector<std::string> files() const {
        std::vector<std::string> names;
        for (const auto& entry : std::filesystem::directory_iterator(folder_.path()))
            names.push_back(entry.path().filename().string());
        std::sort(names.begin(), names.end());
        return names;
    }

    TemporaryFolder folder_;
};

}  // namespace stipple::test
