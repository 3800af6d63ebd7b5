#pragma once

#include "worker/worker_pool.hpp"

#include <atomic>
#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <stop_token>
#include <string>

namespace stipple::server {

/// What a caller is told of a full disk: no folder of the service.
proto::Problem storage_full_problem();

/// One attempt at a job, under one lease: runs it, publishes what it reports, writes down how it
/// ended.
class JobAttempt {
public:
    enum class Stop { None, LeaseLost, Drained };

    JobAttempt(Lease lease, const WorkerPoolOptions& options, const Limits& limits, JobStore& jobs,
               BlobStore& blobs);

    const Lease& lease() const noexcept { return lease_; }

    /// To the end, whatever it is: nothing is thrown.
    void run(JobRunner& runner) noexcept;

    /// Once it has run: whether it found the disk full, or the system refused what it takes to run
    /// a job. The next would meet the same.
    bool needs_rest() const noexcept { return needs_rest_; }

    /// Ends it soon. Drained: handed back to the queue. LeaseLost: nothing more is written. Any
    /// thread; the first reason stands.
    void stop(Stop reason);

private:
    void run_in(const std::filesystem::path& folder, JobRunner& runner);
    proto::JobSpec spec_for(const std::vector<std::shared_ptr<const BlobReader>>& inputs,
                            const std::filesystem::path& output) const;
    void on_report(const proto::JobReport& report);
    void note(const std::exception& failure);
    proto::Problem for_caller(proto::Problem problem) const;
    void take(const proto::JobProgress& progress);
    void take(const proto::CloudStatistics& source);
    void take(const proto::OutputCloud& reported);
    void take(const proto::JobCost& cost);
    void take(const proto::Problem& problem);
    void check_tiles(const proto::OutputCloud& level);
    proto::OutputCloud adopt_files(proto::OutputCloud level);
    void conclude(const JobRunner::Outcome& outcome);
    void succeed();
    void fail(const proto::Problem& problem);
    void put_off(const std::string& fault);
    void tell(std::string_view outcome) const;
    void log_failed(const proto::Problem& problem) const;
    void log_if_failed() const;
    void crash(const std::string& how);
    void hand_back();
    /// Whether a write was taken; when not, the lease is lost.
    bool taken(bool written);

    const Lease lease_;
    const WorkerPoolOptions& options_;
    const Limits& limits_;
    JobStore& jobs_;
    BlobStore& blobs_;
    const std::chrono::steady_clock::time_point started_ = std::chrono::steady_clock::now();
    std::stop_source stop_;
    std::atomic<Stop> reason_ = Stop::None;

    // Of the thread in `run`.
    std::filesystem::path output_;
    std::uint64_t output_bytes_ = 0;
    std::map<std::string, std::uint64_t> adopted_;  ///< bytes of the files, by their hashes
    std::size_t tiles_ = 0;                         ///< of the levels so far
    unsigned next_tiled_level_ = 0;                 ///< the least that the next may be
    std::optional<proto::JobCost> cost_;
    std::optional<proto::Problem> problem_;
    std::optional<std::string> fault_;  ///< of the system that it runs on
    bool needs_rest_ = false;
};

}  // namespace stipple::server
