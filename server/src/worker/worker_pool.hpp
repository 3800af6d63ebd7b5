#pragma once

#include "service/service.hpp"

#include <array>
#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <stop_token>
#include <string_view>

namespace stipple::server {

/// Runs one job to its end. The one seam that tests replace: production spawns stipple-job, tests
/// run a function.
class JobRunner {
public:
    virtual ~JobRunner() = default;
    struct Outcome {
        enum class Kind {
            Finished,
            Crashed,
            Stopped
        } kind = Kind::Finished;  ///< Finished: a cost or problem was reported
        std::string how;          ///< of a crash: `signal 9 (Killed)`, `exit status 3`
    };
    /// Reports as they come, on the calling thread; `report` does not throw. Returns soon (under
    /// 100 ms) after `stop` is requested, which `report` may do.
    virtual Outcome run(const proto::JobSpec& spec,
                        const std::function<void(const proto::JobReport&)>& report,
                        std::stop_token stop) = 0;
};

/// Spawns `program` (stipple-job) for each job, in a process group of its own, deaf to all signals
/// but the SIGKILL of a stop: those that end the service are for the server alone.
std::unique_ptr<JobRunner> make_process_job_runner(const std::filesystem::path& program);

/// How an attempt at a job may end. `failed` is by its request or its files, `broken` by the
/// service, `released` by a worker that stops, `lost` where the job was dismissed or given to
/// another; after `crashed`, `no_room` and `put_off` it may be tried again.
inline constexpr std::array<std::string_view, 8> kAttemptOutcomes = {
    "successful", "failed", "broken", "crashed", "no_room", "put_off", "released", "lost"};

struct WorkerPoolOptions {
    unsigned workers = 1;           ///< jobs at a time
    unsigned threads_per_job = 0;   ///< 0: all
    std::filesystem::path scratch;  ///< one folder a running job; leftovers go at start
    std::chrono::seconds lease{30};
    std::chrono::seconds drain{
        30};  ///< how long running jobs may go on when stopping; then they are handed back
    std::chrono::milliseconds rest{60'000};  ///< of a worker whose job found the disk full, or
                                             ///< could not be run: it may go by then
    std::function<void(const proto::OutputCloud&)> on_level{};  ///< told of each published level
    std::function<void(std::string_view)> on_end{};  ///< told the outcome of each attempt
};

/// Claims, spawns, watches, publishes. Starts in the constructor; the destructor drains. Learns
/// from the store at once of jobs that were submitted or dismissed.
class WorkerPool {
public:
    WorkerPool(const WorkerPoolOptions& options, const Limits& limits, JobStore& jobs,
               BlobStore& blobs, JobRunner& runner);
    ~WorkerPool();

    /// Takes no job from now on; the time that running ones have to finish begins. Returns at once.
    void begin_drain();

private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace stipple::server
