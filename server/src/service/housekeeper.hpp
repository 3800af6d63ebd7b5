#pragma once

#include "store/blob_store.hpp"
#include "store/job_store.hpp"

#include <chrono>
#include <cstdint>
#include <set>
#include <string>
#include <thread>

namespace stipple::server {

struct HousekeeperOptions {
    std::chrono::seconds retention;               ///< of a job and its results after its end
    std::chrono::seconds cloud_retention;         ///< of a cloud after its last use
    std::chrono::milliseconds period{60'000};     ///< between two sweeps
    std::chrono::milliseconds grace{3'600'000};   ///< a blob younger than this is never removed
    std::chrono::milliseconds settling{300'000};  ///< after the start nothing expires for so long,
                                                  ///< or for its retention if that is shorter
};

/// Removes expired jobs and clouds, and blobs that no row needs any more. Starts in the
/// constructor, ends in the destructor.
///
/// A blob goes when it is older than the grace period and two sweeps in a row found no row that
/// names it: bytes are durable before the row that names them is written, so a young blob may be
/// waiting for its row.
class Housekeeper {
public:
    Housekeeper(const HousekeeperOptions& options, JobStore& jobs, BlobStore& blobs);

private:
    void run(std::stop_token stop);
    void sweep();
    std::uint64_t remove_expired(std::chrono::seconds retention,
                                 std::uint64_t (JobStore::*remove)(std::chrono::seconds));

    const HousekeeperOptions options_;
    JobStore& jobs_;
    BlobStore& blobs_;
    const std::chrono::steady_clock::time_point started_ = std::chrono::steady_clock::now();
    std::set<std::string>
        candidates_;  ///< unreferenced at the last sweep; of the thread below only
    std::jthread thread_;
};

}  // namespace stipple::server
