#pragma once

#include "cli/command_line.hpp"
#include "cli/progress_bar.hpp"
#include "stipple/client.hpp"
#include "stipple/proto/results.hpp"

#include <filesystem>
#include <stop_token>
#include <string>
#include <vector>

namespace stipple::cli {

struct JobExecution {
    ServerOptions server;  ///< here, when it names no server
    unsigned threads = 0;
    std::stop_token stop;
    std::vector<std::filesystem::path> candidates{};  ///< of an evaluation
};

/// Does a job on the cloud in `input`, here or on a server, and leaves the same files in `folder`
/// either way, named in the results. @throws Error,
/// Cancelled.
proto::Results execute(proto::JobRequest request, const std::filesystem::path& input,
                       const std::filesystem::path& folder, const JobExecution& execution,
                       ProgressDisplay& display);

/// Calls `work`, which asks a server, and says how a key is given where the server wants another.
template <typename Work>
auto naming_key(Work&& work) {
    try {
        return work();
    } catch (const Unauthorized& error) {
        throw Error(error.code(), std::string(error.what()) +
                                      ": give a valid one with --api-key or in STIPPLE_API_KEY");
    }
}

}  // namespace stipple::cli
