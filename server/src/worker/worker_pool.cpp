#include "worker/worker_pool.hpp"

#include "log_text.hpp"
#include "store/data_folder.hpp"
#include "worker/job_attempt.hpp"

#include "stipple/proto/problem.hpp"

#include <spdlog/spdlog.h>
#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

namespace stipple::server {

namespace {

using std::chrono::steady_clock;
using std::chrono::system_clock;

/// An idle worker looks at the queue at least so often: a lease of another may have run out.
constexpr std::chrono::seconds kIdlePoll{1};
/// Between two looks at the leases while much is written: a dismissal is noticed within this time.
constexpr std::chrono::milliseconds kLookPeriod{20};

/// Returns after `time`, or when asked to stop.
void pause(steady_clock::duration time, const std::stop_token& stop) {
    std::mutex mutex;
    std::unique_lock lock(mutex);
    std::condition_variable_any().wait_for(lock, stop, time, [] { return false; });
}

}  // namespace

struct WorkerPool::State {
    State(const WorkerPoolOptions& given_options, const Limits& given_limits, JobStore& job_store,
          BlobStore& blob_store, JobRunner& job_runner);
    ~State();

    void begin_drain();
    void work(const std::stop_token& stop);
    std::optional<Lease> claim(const std::stop_token& stop);
    void give_up_waiting_for_room();
    void run(Lease lease, const std::stop_token& stop);
    void keep_leases(const std::stop_token& stop);
    void renew_leases();
    void stop_before_others_may_claim(steady_clock::duration silent);
    std::vector<std::shared_ptr<JobAttempt>> attempts();

    const WorkerPoolOptions options;
    const Limits limits;
    JobStore& jobs;
    BlobStore& blobs;
    JobRunner& runner;

    std::mutex claiming;  ///< held from the look at the stop to the claim
    std::mutex mutex;
    std::vector<std::shared_ptr<JobAttempt>> running;
    bool drained = false;                               ///< no job may go on
    std::optional<steady_clock::time_point> drain_end;  ///< once it is draining
    std::condition_variable ended;                      ///< one fewer is running
    std::atomic<bool> is_full = false;                  ///< the disk was, as it was said
    std::atomic<system_clock::time_point> renewed{system_clock::now()};  ///< the leases were

    std::jthread keeper;  ///< renews leases until the last worker has ended
    std::vector<std::jthread> workers;
};

WorkerPool::State::State(const WorkerPoolOptions& given_options, const Limits& given_limits,
                         JobStore& job_store, BlobStore& blob_store, JobRunner& job_runner)
    : options(given_options),
      limits(given_limits),
      jobs(job_store),
      blobs(blob_store),
      runner(job_runner) {
    clear_leftovers(options.scratch);
    keeper = std::jthread([this](const std::stop_token& stop) { keep_leases(stop); });
    for (unsigned i = 0; i < options.workers; ++i) {
        workers.emplace_back([this](const std::stop_token& stop) { work(stop); });
    }
}

void WorkerPool::State::begin_drain() {
    for (std::jthread& worker : workers) worker.request_stop();
    const std::scoped_lock lock(claiming, mutex);  // from here on no job is claimed
    if (!drain_end) drain_end = steady_clock::now() + options.drain;
}

WorkerPool::State::~State() {
    begin_drain();
    {
        std::unique_lock lock(mutex);
        ended.wait_until(lock, *drain_end, [this] { return running.empty(); });
        drained = true;
    }
    for (const auto& attempt : attempts()) attempt->stop(JobAttempt::Stop::Drained);
    workers.clear();
}

void WorkerPool::State::work(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
        // Taken before the look at the queue: a job that is submitted after it ends the wait at
        // once.
        const std::uint64_t seen = jobs.version();
        if (auto lease = claim(stop)) {
            run(std::move(*lease), stop);
        } else {
            jobs.wait_for_change(seen, steady_clock::now() + kIdlePoll, stop);
        }
    }
}

std::optional<Lease> WorkerPool::State::claim(const std::stop_token& stop) try {
    blobs.check_room();  // on a full disk no job is worth beginning
    if (is_full.exchange(false)) spdlog::info("disk.has_room");
    // Where the whole process slept, as with its machine, its own jobs' leases have run out.
    if (system_clock::now() >= renewed.load() + options.lease / 2) renew_leases();
    const std::lock_guard lock(claiming);
    if (stop.stop_requested()) return std::nullopt;
    return jobs.claim(limits.queue, options.lease);
} catch (const proto::StorageFull& error) {
    if (!is_full.exchange(true)) spdlog::error("disk.full error={}", log_text(error.what()));
    give_up_waiting_for_room();
    return std::nullopt;
} catch (const std::exception& error) {
    spdlog::error("queue.failed error={}", log_text(error.what()));
    return std::nullopt;
}

/// What a job has published may be what fills the disk.
void WorkerPool::State::give_up_waiting_for_room() try {
    jobs.still_no_room(options.rest, storage_full_problem());
} catch (const std::exception& failure) {
    spdlog::error("queue.failed error={}", log_text(failure.what()));
}

void WorkerPool::State::run(Lease lease, const std::stop_token& stop) {
    const auto attempt =
        std::make_shared<JobAttempt>(std::move(lease), options, limits, jobs, blobs);
    {
        const std::lock_guard lock(mutex);
        running.push_back(attempt);
        if (drained) attempt->stop(JobAttempt::Stop::Drained);
    }
    attempt->run(runner);
    {
        const std::lock_guard lock(mutex);
        std::erase(running, attempt);
    }
    ended.notify_all();
    if (attempt->needs_rest()) pause(options.rest, stop);
}

std::vector<std::shared_ptr<JobAttempt>> WorkerPool::State::attempts() {
    const std::lock_guard lock(mutex);
    return running;
}

void WorkerPool::State::keep_leases(const std::stop_token& stop) {
    const steady_clock::duration renewal = steady_clock::duration(options.lease) / 3;
    steady_clock::time_point renewed_at = steady_clock::now();
    bool has_failed = false;  // as it was said
    while (!stop.stop_requested()) {
        const std::uint64_t seen = jobs.version();
        const steady_clock::time_point now = steady_clock::now();
        const bool renewing = now >= renewed_at + renewal;
        try {
            if (renewing) {
                renew_leases();
                renewed_at = now;
            } else {
                for (const auto& attempt : attempts())
                    if (!jobs.holds(attempt->lease())) attempt->stop(JobAttempt::Stop::LeaseLost);
            }
            has_failed = false;
        } catch (const std::exception& error) {
            if (!std::exchange(has_failed, true))
                spdlog::error("lease.failed error={}", log_text(error.what()));
            stop_before_others_may_claim(now - renewed_at);
        }
        pause(kLookPeriod, stop);
        jobs.wait_for_change(seen, std::max(renewed_at + renewal, now + kLookPeriod), stop);
    }
}

void WorkerPool::State::renew_leases() {
    for (const auto& attempt : attempts())
        if (!jobs.renew(attempt->lease(), options.lease))
            attempt->stop(JobAttempt::Stop::LeaseLost);
    renewed = system_clock::now();
}

/// A lease that could not be renewed for so long may soon be another's: its job must not run twice
/// at a time.
void WorkerPool::State::stop_before_others_may_claim(steady_clock::duration silent) {
    if (silent < steady_clock::duration(options.lease) * 2 / 3) return;
    for (const auto& attempt : attempts()) attempt->stop(JobAttempt::Stop::LeaseLost);
}

WorkerPool::WorkerPool(const WorkerPoolOptions& options, const Limits& limits, JobStore& jobs,
                       BlobStore& blobs, JobRunner& runner)
    : state_(std::make_unique<State>(options, limits, jobs, blobs, runner)) {}

WorkerPool::~WorkerPool() = default;

void WorkerPool::begin_drain() {
    state_->begin_drain();
}

}  // namespace stipple::server
