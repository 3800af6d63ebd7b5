#include "service/housekeeper.hpp"

#include "log_text.hpp"

#include <spdlog/spdlog.h>
#include <algorithm>
#include <condition_variable>
#include <mutex>

namespace stipple::server {

Housekeeper::Housekeeper(const HousekeeperOptions& options, JobStore& jobs, BlobStore& blobs)
    : options_(options),
      jobs_(jobs),
      blobs_(blobs),
      thread_([this](std::stop_token stop) { run(std::move(stop)); }) {}

void Housekeeper::run(std::stop_token stop) {
    std::mutex mutex;
    std::condition_variable_any stopped;
    while (!stop.stop_requested()) {
        try {
            sweep();
        } catch (const std::exception& error) {
            spdlog::error("housekeeper.failed error={}", log_text(error.what()));
        }
        std::unique_lock lock(mutex);
        stopped.wait_for(lock, stop, options_.period, [] { return false; });
    }
}

void Housekeeper::sweep() {
    const auto grace =
        std::chrono::duration_cast<std::chrono::system_clock::duration>(options_.grace);
    const auto time = std::chrono::system_clock::now() - grace;
    const std::vector<std::string> old = blobs_.older_than(time);
    const std::vector<std::string> referenced = jobs_.referenced_blobs();
    std::set<std::string> unreferenced(old.begin(), old.end());
    for (const std::string& blob : referenced) unreferenced.erase(blob);

    for (auto blob = unreferenced.begin(); blob != unreferenced.end();) {
        const bool again = candidates_.contains(*blob);
        if (again && blobs_.remove_older(*blob, time)) {
            spdlog::info("blob.removed sha256={}", *blob);
            blob = unreferenced.erase(blob);
        } else {
            ++blob;
        }
    }
    candidates_ = std::move(unreferenced);

    // Files first: on a full disk no row can be removed before they made room.
    const std::uint64_t jobs = remove_expired(options_.retention, &JobStore::remove_expired_jobs),
                        clouds = remove_expired(options_.cloud_retention,
                                                &JobStore::remove_expired_clouds);
    if (jobs + clouds > 0) spdlog::info("expired.removed jobs={} clouds={}", jobs, clouds);
}

std::uint64_t Housekeeper::remove_expired(
    std::chrono::seconds retention, std::uint64_t (JobStore::*remove)(std::chrono::seconds)) try {
    // What expires is told by the clock, and that of a machine that has just started may yet be set
    // right. Who keeps things for less than that has asked for them to go.
    const auto wait = std::min<std::chrono::milliseconds>(options_.settling, retention);
    if (std::chrono::steady_clock::now() - started_ < wait) return 0;
    return (jobs_.*remove)(retention);
} catch (const std::exception& error) {  // the rest may go all the same
    spdlog::error("housekeeper.failed error={}", log_text(error.what()));
    return 0;
}

}  // namespace stipple::server
