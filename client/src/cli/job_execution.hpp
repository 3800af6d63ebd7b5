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

/// A folder beside or in the one where results will stand, so that moving them there is one step;
/// gone in the end.
class ScratchFolder {
public:
    /// @throws Error naming `parent` when nothing can be written there.
    explicit ScratchFolder(const std::filesystem::path& parent);
    ~ScratchFolder();
    ScratchFolder(const ScratchFolder&) = delete;
    ScratchFolder& operator=(const ScratchFolder&) = delete;
    const std::filesystem::path& path() const noexcept { return path_; }

private:
    std::filesystem::path path_;
};

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
        throw Error(error.code(),
                    std::string(error.what()) +
                        ": give one that it knows with --api-key or in STIPPLE_API_KEY");
    }
}

/// The folder in which `file` stands, as a path that can be opened.
std::filesystem::path folder_of(const std::filesystem::path& file);

/// Before the work that ends in the file; a file without a name, or named `-`, needs no place.
/// @throws Error naming its folder when nothing can be written there.
void require_place_of(const std::filesystem::path& file);

}  // namespace stipple::cli
