#pragma once

#include "stipple/proto/job.hpp"
#include "stipple/proto/job_process.hpp"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace stipple::server {

struct CloudRow {
    std::string tenant, id;
    std::optional<std::string> name;
    CloudFormat format = CloudFormat::Ply;
    std::uint64_t bytes = 0;
    std::string created;
    std::optional<proto::CloudStatistics> statistics;
};

/// The right to work on a job, for a while. Every write names the token; one that is stale touches
/// no row.
struct Lease {
    std::string job_id;
    std::string tenant;
    std::uint64_t token = 0;
    proto::JobRequest request;
};

/// What happened to a job. `data` is JSON by `type`:
///
///     status    {"status": "running"}           every change of status
///     progress  {"progress": {stage, percent}}  thinned out: one per 1 % and 250 ms at most
///     source    {"source": {statistics}}        the cloud was decoded
///     level     {"level": {as in the results}}  it can be fetched
///
/// The last three are what stipple-job reported (proto::JobReport); `href`s of a level are filled
/// by the service.
struct JobEvent {
    std::uint64_t id = 0;  ///< per job, from 1
    std::string type;
    std::string data;
    std::shared_ptr<const std::vector<std::byte>> shared{};  ///< instead of it, of a large one

    std::string_view text() const noexcept {
        if (!shared) return data;
        return {reinterpret_cast<const char*>(shared->data()), shared->size()};
    }
};

struct QueueLimits {
    std::uint64_t max_queued = 1000;  ///< per tenant
    std::uint64_t max_running = 4;    ///< per tenant
};

/// Whether one more can wait. @throws Error(QueueFull).
void check_queued(std::uint64_t waiting, const QueueLimits& limits);

enum class Submitted { Created, Existing };

/// What there is after a submission.
template <typename Document>
struct Submission {
    Document document;
    bool existed = false;  ///< it was there already
};

/// A part of a listing.
template <typename Item>
struct Page {
    std::vector<Item> items;
    std::optional<std::string> next;  ///< the cursor of the page after it, where there is one
};

/// Clouds, jobs, their events and results: rows that survive a power cut once a call has returned.
/// Safe to call from any thread. Every read is by tenant; another tenant's row is as missing.
class JobStore {
public:
    virtual ~JobStore() = default;

    // Clouds.
    /// Of one that is there already, a name takes the place of the one it had.
    virtual Submitted put_cloud(const CloudRow& row) = 0;
    /// Counts as a use of it, by which clouds are kept, to the hour.
    virtual std::optional<CloudRow> find_cloud(const std::string& tenant,
                                               const std::string& id) = 0;
    virtual Page<CloudRow> list_clouds(const std::string& tenant, unsigned limit,
                                       const std::optional<std::string>& cursor) = 0;
    /// @throws Error(Conflict) while an unfinished job needs it. False when there is none.
    virtual bool remove_cloud(const std::string& tenant, const std::string& id) = 0;

    // Jobs.
    /// Adds a job. With an idempotency key seen before: the same request returns that job, another
    /// throws Error(Conflict). @throws Error(NotFound) when an input is neither a cloud nor a
    /// file of a result, Error(QueueFull) over the limit.
    virtual Submission<proto::JobDocument> submit(const std::string& tenant,
                                                  const proto::JobRequest& request,
                                                  const std::optional<std::string>& idempotency_key,
                                                  const QueueLimits& limits) = 0;
    /// The job that this request with this key was given; nothing when the key is new.
    /// @throws Error(Conflict) when it was used for another request.
    virtual std::optional<proto::JobDocument> find_submitted(
        const std::string& tenant, const proto::JobRequest& request,
        const std::string& idempotency_key) = 0;
    virtual std::optional<proto::JobDocument> find_job(const std::string& tenant,
                                                       const std::string& id) = 0;
    struct JobFilter {
        std::optional<std::string> type, status, input;
    };
    virtual Page<proto::JobDocument> list_jobs(const std::string& tenant, const JobFilter& filter,
                                               unsigned limit,
                                               const std::optional<std::string>& cursor) = 0;
    /// Unfinished: dismissed at once, which also ends the lease of its worker. Final: removed with
    /// its results. Returns the document after it, or as it last was when removed; nothing when
    /// missing.
    virtual std::optional<proto::JobDocument> dismiss(const std::string& tenant,
                                                      const std::string& id) = 0;
    /// Unfinished: dismissed. @throws Error(Conflict) for one that is final, which stays.
    virtual std::optional<proto::JobDocument> cancel(const std::string& tenant,
                                                     const std::string& id) = 0;
    /// The next after `after`: at least one, if there is any, and no more once they take 1 MiB.
    virtual std::vector<JobEvent> events_after(const std::string& tenant, const std::string& id,
                                               std::uint64_t after) = 0;
    virtual std::optional<proto::Results> results(const std::string& tenant,
                                                  const std::string& id) = 0;
    /// Grows every time something is written: a cheap way to see that something may have changed.
    /// Of what another process wrote, within 20 ms or so.
    virtual std::uint64_t version() const noexcept = 0;
    virtual bool is_shared() const noexcept = 0;  ///< whether other processes write to it, too
    /// Returns when `version()` is no longer `seen`, at `deadline`, or when asked to stop.
    virtual void wait_for_change(std::uint64_t seen, std::chrono::steady_clock::time_point deadline,
                                 std::stop_token stop) const = 0;

    // The worker's side. Each returns false, having changed nothing, when the lease is stale: the
    // job was dismissed, or given to another worker.
    /// The oldest job of the tenant with the fewest running ones; of several, whose last turn is
    /// longest ago. Jobs whose lease ran out go back to the queue first.
    virtual std::optional<Lease> claim(const QueueLimits& limits,
                                       std::chrono::seconds lease_time) = 0;
    virtual bool renew(const Lease& lease, std::chrono::seconds lease_time) = 0;
    virtual bool report_progress(const Lease& lease, const std::string& stage, double percent) = 0;
    virtual bool report_source(const Lease& lease, const proto::CloudStatistics& source) = 0;
    virtual bool publish_level(const Lease& lease, const proto::OutputCloud& level) = 0;
    virtual bool succeed(const Lease& lease, const proto::JobCost& cost) = 0;
    virtual bool fail(const Lease& lease, const proto::Problem& problem) = 0;
    /// The child died (signal, no last word). Back to the queue, or failed as poison the second
    /// time.
    virtual bool crashed(const Lease& lease, const std::string& how) = 0;
    /// The disk was full. Back to the queue, or failed by the problem the third time.
    virtual bool ran_out_of_room(const Lease& lease, const proto::Problem& problem) = 0;
    /// The system that it runs on failed, not the job. Back to the queue, where it is given to
    /// nobody for the time of `rest`, or failed by the problem the tenth time.
    virtual bool put_off(const Lease& lease, const proto::Problem& problem,
                         std::chrono::milliseconds rest) = 0;
    /// The disk has been full for so long that jobs which wait for room would have been tried
    /// again: counts as a try that ran out of it.
    virtual void still_no_room(std::chrono::milliseconds rest, const proto::Problem& problem) = 0;
    virtual bool release(const Lease& lease) = 0;  ///< back to the queue, at no cost: shutdown
    virtual bool holds(const Lease& lease) = 0;    ///< whether the lease is good; changes nothing

    // Housekeeping.
    virtual void recover() = 0;  ///< at start of the only process with workers on this store:
                                 ///< running rows go back to the queue
    struct Counts {
        std::uint64_t queued = 0, running = 0;
        double oldest_queued_seconds = 0;
        std::map<std::string, std::uint64_t> ended;  ///< ever, by status; removed ones too
    };
    virtual Counts counts() = 0;
    /// Removes jobs that ended longer ago than `retention`, with their results. Returns how many.
    virtual std::uint64_t remove_expired_jobs(std::chrono::seconds retention) = 0;
    /// Removes clouds that were uploaded, last named by a new job and last looked for longer ago
    /// than `retention`, but those that an unfinished job needs. Returns how many.
    virtual std::uint64_t remove_expired_clouds(std::chrono::seconds retention) = 0;
    /// Blobs that a row needs: clouds, inputs of unfinished jobs, results.
    virtual std::vector<std::string> referenced_blobs() = 0;
    /// @throws Error(Internal) when the database does not answer.
    virtual void probe() = 0;
};

/// Whether other processes write to a store while this one has it open.
enum class Sharing { Alone, WithOtherProcesses };

/// SQLite in WAL mode, `synchronous=FULL`.
std::unique_ptr<JobStore> open_sqlite_job_store(const std::filesystem::path& file,
                                                Sharing sharing = Sharing::Alone);

/// `referenced_blobs` of a store that no process writes to, its disk may be read-only. Nothing is
/// changed.
std::vector<std::string> read_referenced_blobs(const std::filesystem::path& file);

/// The same of one that is damaged, as far as they can be read; adds to `damage` what kept it from
/// the rest.
std::vector<std::string> read_referenced_blobs(const std::filesystem::path& file,
                                               std::vector<std::string>& damage);

/// What is wrong with the pages of such a store, a line each; nothing when it is intact.
std::vector<std::string> find_damage(const std::filesystem::path& file);

}  // namespace stipple::server
