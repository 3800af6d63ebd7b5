#include "worker/job_attempt.hpp"

#include "log_text.hpp"
#include "store/store_fault.hpp"

#include "stipple/error.hpp"

#include <spdlog/spdlog.h>
#include <algorithm>
#include <cerrno>
#include <set>
#include <system_error>
#include <utility>
#include <variant>

namespace stipple::server {

namespace {

namespace fs = std::filesystem;

/// A pyramid of 2^32 points by the smallest sensible ratio has fewer levels.
constexpr unsigned kMaxLevels = 256;

/// A folder for the files of one attempt, gone with all in it at the end.
class ScratchFolder {
public:
    explicit ScratchFolder(fs::path path) : path_(std::move(path)) {
        fs::create_directories(path_ / "output");
    }
    ScratchFolder(const ScratchFolder&) = delete;
    ScratchFolder& operator=(const ScratchFolder&) = delete;
    ~ScratchFolder() {
        std::error_code failure;
        fs::remove_all(path_, failure);
        if (failure) {
            spdlog::warn("scratch.left path={} error={}", path_.string(),
                         log_text(failure.message()));
        }
    }
    const fs::path& path() const noexcept { return path_; }

private:
    const fs::path path_;
};

bool is_full(const proto::Problem& problem) noexcept {
    return problem.status == proto::kStorageFullStatus;
}
bool is_full(const std::system_error& fault) noexcept {
    return fault.code() == std::errc::no_space_on_device ||
           fault.code() == std::error_code(EDQUOT, std::generic_category());
}

proto::Problem broken_problem() {
    return proto::problem_from(ErrorCode::Internal,
                               "the service could not run the job; its log says why");
}

}  // namespace

proto::Problem storage_full_problem() {
    return proto::problem_from_status(proto::kStorageFullStatus,
                                      "storage full: the operator must free space");
}

JobAttempt::JobAttempt(Lease lease, const WorkerPoolOptions& options, const Limits& limits,
                       JobStore& jobs, BlobStore& blobs)
    : lease_(std::move(lease)), options_(options), limits_(limits), jobs_(jobs), blobs_(blobs) {}

void JobAttempt::stop(Stop reason) {
    Stop none = Stop::None;
    reason_.compare_exchange_strong(none, reason);
    stop_.request_stop();
}

void JobAttempt::run(JobRunner& runner) noexcept try {
    spdlog::info("job.started id={} tenant={} type={} attempt={}", lease_.job_id,
                 log_name(lease_.tenant), type_name(lease_.request), lease_.token);
    try {
        // Of its own: an attempt that lost its lease may still be ending.
        const ScratchFolder folder(options_.scratch /
                                   (lease_.job_id + '-' + std::to_string(lease_.token)));
        run_in(folder.path(), runner);
    } catch (const std::exception& error) {
        note(error);
        fault_ ? put_off(*fault_) : fail(*problem_);  // now that its files are gone: there is room
    }
} catch (const std::exception& error) {
    // Not even the failure could be written: the lease runs out, and the job is tried again.
    spdlog::error("job.abandoned id={} error={}", lease_.job_id, log_text(error.what()));
}

void JobAttempt::run_in(const fs::path& folder, JobRunner& runner) {
    std::vector<std::shared_ptr<const BlobReader>> inputs;
    for (const std::string& id : proto::inputs_of(lease_.request)) {
        inputs.push_back(blobs_.open(id));
        if (inputs.back()) continue;
        blobs_.probe();  // a disk that is away as a whole is no fault of the job's
        spdlog::error("blob.missing sha256={} job={}", id, lease_.job_id);
        throw Error(ErrorCode::NotFound,
                    "input " + id +
                        ": its bytes are missing from the store of the server: upload the cloud "
                        "again, or repeat the job that made it");
    }
    output_ = folder / "output";
    conclude(runner.run(
        spec_for(inputs, output_), [this](const proto::JobReport& report) { on_report(report); },
        stop_.get_token()));
}

proto::JobSpec JobAttempt::spec_for(const std::vector<std::shared_ptr<const BlobReader>>& inputs,
                                    const fs::path& output) const {
    std::uint64_t bytes = 0;
    std::vector<std::string> files;
    for (const auto& input : inputs) {
        bytes += input->size();
        files.push_back(input->path().string());
    }
    return {.request = lease_.request,
            .input_file = files.front(),
            .candidate_files = {files.begin() + 1, files.end()},
            .output_dir = output.string(),
            .limits = limits_.decode,
            .max_memory_bytes = limits_.memory_for(bytes, options_.threads_per_job),
            .max_cpu_seconds = limits_.max_job_cpu_seconds,
            .max_file_bytes = limits_.max_job_output_bytes,
            .threads = options_.threads_per_job};
}

void JobAttempt::on_report(const proto::JobReport& report) {
    if (stop_.stop_requested()) return;
    try {
        std::visit([this](const auto& what) { take(what); }, report);
    } catch (const std::exception& error) {
        note(error);
    }
    if (problem_ || fault_) stop_.request_stop();
}

/// Of the service: as a fault of the system that it runs on, which may pass, or as the problem of
/// the job.
void JobAttempt::note(const std::exception& failure) {
    if (const auto* const fault = dynamic_cast<const std::system_error*>(&failure)) {
        if (is_full(*fault))
            problem_ = storage_full_problem();
        else
            fault_ = fault->what();
        return;
    }
    if (const auto* const fault = dynamic_cast<const StoreFault*>(&failure)) {
        fault_ = fault->what();
        return;
    }
    const auto* const error = dynamic_cast<const Error*>(&failure);
    problem_ =
        for_caller(error != nullptr ? proto::problem_from(*error)
                                    : proto::problem_from(ErrorCode::Internal, failure.what()));
}

/// What the caller can use: the words of a failure of the service itself may name folders.
proto::Problem JobAttempt::for_caller(proto::Problem problem) const {
    if (problem.status < 500) return problem;
    spdlog::error("job.broken id={} error={}", lease_.job_id, log_text(problem.detail));
    proto::Problem told = is_full(problem) ? storage_full_problem() : broken_problem();
    told.stage = std::move(problem.stage);
    return told;
}

void JobAttempt::take(const proto::JobProgress& progress) {
    taken(jobs_.report_progress(lease_, progress.stage, progress.percent));
}

void JobAttempt::take(const proto::CloudStatistics& source) {
    taken(jobs_.report_source(lease_, source));
}

void JobAttempt::take(const proto::OutputCloud& reported) {
    // Durable first, then the row that names it.
    const proto::OutputCloud level = adopt_files(reported);
    if (!taken(jobs_.publish_level(lease_, level))) return;
    if (options_.on_level) options_.on_level(level);
    spdlog::debug("job.level id={} level={} points={}", lease_.job_id, level.level, level.points);
}

void JobAttempt::take(const proto::JobCost& cost) {
    cost_ = cost;
}

void JobAttempt::take(const proto::Problem& problem) {
    problem_ = for_caller(problem);
}

// The job process worked on foreign bytes: nothing it says of its files is believed.

/// Tiles are numbered level by level, each after its parent (`require_parents_first`).
void JobAttempt::check_tiles(const proto::OutputCloud& level) {
    for (const proto::OutputFile& file : level.files) {
        if (!file.tile) continue;
        const bool in_order = level.level >= next_tiled_level_;
        if (!in_order || (file.tile->parent && *file.tile->parent >= tiles_)) {
            throw Error(ErrorCode::Internal, "the job reported tile " + std::to_string(tiles_) +
                                                 " of level " + std::to_string(level.level) +
                                                 " before its parent");
        }
        ++tiles_;
    }
    next_tiled_level_ = std::max(next_tiled_level_, level.level + 1);
}

proto::OutputCloud JobAttempt::adopt_files(proto::OutputCloud level) {
    if (level.level >= kMaxLevels) {
        throw Error(ErrorCode::Internal, "the job reported level " + std::to_string(level.level) +
                                             ": expected fewer than " + std::to_string(kMaxLevels));
    }
    check_tiles(level);
    std::vector<fs::path> paths;
    std::vector<std::string> hashes;  // that these are said to have
    std::set<fs::path> listed;
    const auto check = [&](auto& file) {
        const fs::path name = std::exchange(file.href, {});
        const fs::path path = output_ / name;
        // Two tiles of the same bytes have one name: the first may be taken with both written.
        if (const auto known = adopted_.find(file.sha256);
            known != adopted_.end() &&
            (listed.contains(path) || !fs::exists(fs::symlink_status(path)))) {
            file.bytes = known->second;
            return;
        }
        if (name.empty() || name != name.filename() ||
            !fs::is_regular_file(fs::symlink_status(path))) {
            throw Error(ErrorCode::Internal,
                        "the job reported a file that it did not make: " + name.string());
        }
        file.bytes = fs::file_size(path);
        output_bytes_ += file.bytes;
        if (output_bytes_ > limits_.max_job_output_bytes) {
            throw Error(ErrorCode::TooLarge, "the results take more than " +
                                                 std::to_string(limits_.max_job_output_bytes) +
                                                 " bytes: ask for fewer points, levels or formats");
        }
        adopted_[file.sha256] = file.bytes;
        paths.push_back(path);
        hashes.push_back(file.sha256);
        listed.insert(path);
    };
    std::ranges::for_each(level.files, check);
    std::ranges::for_each(level.pictures, check);
    const std::vector<std::string> found = blobs_.adopt(paths);
    for (std::size_t i = 0; i < found.size(); ++i) {
        if (found[i] == hashes[i]) continue;
        throw Error(ErrorCode::Internal, "the job reported " + paths[i].filename().string() +
                                             " with hash " + hashes[i] + ", its bytes have " +
                                             found[i]);
    }
    return level;
}

void JobAttempt::conclude(const JobRunner::Outcome& outcome) {
    const Stop reason = reason_;
    if (reason == Stop::LeaseLost) {
        tell("lost");
        spdlog::info("job.stopped id={} reason=\"dismissed or given to another worker\"",
                     lease_.job_id);
    } else if (fault_) {
        put_off(*fault_);
    } else if (problem_) {
        fail(*problem_);
    } else if (cost_) {
        succeed();
    } else if (reason == Stop::Drained) {
        hand_back();
    } else {
        crash(outcome.how.empty() ? "it ended without a result" : outcome.how);
    }
}

void JobAttempt::tell(std::string_view outcome) const {
    if (options_.on_end) options_.on_end(outcome);
}

void JobAttempt::succeed() {
    if (!taken(jobs_.succeed(lease_, *cost_))) return;
    tell("successful");
    const auto ms = std::chrono::duration_cast<std::chrono::milliseconds>(
        std::chrono::steady_clock::now() - started_);
    spdlog::info("job.succeeded id={} type={} bytes={} ms={}", lease_.job_id,
                 type_name(lease_.request), output_bytes_, ms.count());
}

void JobAttempt::fail(const proto::Problem& problem) {
    if (!is_full(problem)) {
        if (!taken(jobs_.fail(lease_, problem))) return;
        tell(problem.status < 500 ? "failed" : "broken");
        log_failed(problem);
        return;
    }
    needs_rest_ = true;
    tell("no_room");
    if (taken(jobs_.ran_out_of_room(lease_, problem))) {
        spdlog::warn("job.ran_out_of_room id={}", lease_.job_id);
        log_if_failed();
    }
}

/// No fault of the job's: the system may take it a while later.
void JobAttempt::put_off(const std::string& fault) {
    needs_rest_ = true;
    tell("put_off");
    spdlog::error("job.put_off id={} error={}", lease_.job_id, log_text(fault));
    // For longer than the worker rests: another job is tried before it, and does well where the
    // fault is of this one alone.
    if (taken(jobs_.put_off(lease_, broken_problem(), 2 * options_.rest))) log_if_failed();
}

void JobAttempt::log_failed(const proto::Problem& problem) const {
    const auto level = problem.status >= 500 ? spdlog::level::err : spdlog::level::warn;
    spdlog::log(level, "job.failed id={} status={} detail={}", lease_.job_id, problem.status,
                log_text(problem.detail));
}

/// Where the store decided whether the job is tried again.
void JobAttempt::log_if_failed() const {
    const auto job = jobs_.find_job(lease_.tenant, lease_.job_id);
    if (job && job->status == proto::JobStatus::Failed && job->problem) log_failed(*job->problem);
}

void JobAttempt::crash(const std::string& how) {
    if (!taken(jobs_.crashed(lease_, how))) return;
    tell("crashed");
    spdlog::warn("job.crashed id={} how={}", lease_.job_id, log_text(how));
    log_if_failed();
}

void JobAttempt::hand_back() {
    if (!taken(jobs_.release(lease_))) return;
    tell("released");
    spdlog::info("job.released id={}", lease_.job_id);
}

bool JobAttempt::taken(bool written) {
    if (!written) stop(Stop::LeaseLost);
    return written;
}

}  // namespace stipple::server
