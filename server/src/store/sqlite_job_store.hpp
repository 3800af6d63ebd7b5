#pragma once

#include "store/change_signal.hpp"
#include "store/job_store.hpp"
#include "store/sqlite.hpp"

#include <mutex>
#include <thread>

namespace stipple::server {

template <typename Rep, typename Period>
std::int64_t milliseconds(std::chrono::duration<Rep, Period> duration) {
    return std::chrono::duration_cast<std::chrono::milliseconds>(duration).count();
}

inline std::int64_t now_ms() {
    return milliseconds(std::chrono::system_clock::now().time_since_epoch());
}

/// The job store of `open_sqlite_job_store`: what clients see of it is in sqlite_job_store.cpp,
/// what workers and housekeeping do in sqlite_job_queue.cpp.
class SqliteJobStore final : public JobStore {
public:
    SqliteJobStore(const std::filesystem::path& file, Sharing sharing);

    Submitted put_cloud(const CloudRow& row) override;
    std::optional<CloudRow> find_cloud(const std::string& tenant, const std::string& id) override;
    Page<CloudRow> list_clouds(const std::string& tenant, unsigned limit,
                               const std::optional<std::string>& cursor) override;
    bool remove_cloud(const std::string& tenant, const std::string& id) override;

    Submission<proto::JobDocument> submit(const std::string& tenant,
                                          const proto::JobRequest& request,
                                          const std::optional<std::string>& idempotency_key,
                                          const QueueLimits& limits) override;
    std::optional<proto::JobDocument> find_submitted(const std::string& tenant,
                                                     const proto::JobRequest& request,
                                                     const std::string& idempotency_key) override;
    std::optional<proto::JobDocument> find_job(const std::string& tenant,
                                               const std::string& id) override;
    Page<proto::JobDocument> list_jobs(const std::string& tenant, const JobFilter& filter,
                                       unsigned limit,
                                       const std::optional<std::string>& cursor) override;
    std::optional<proto::JobDocument> dismiss(const std::string& tenant,
                                              const std::string& id) override;
    std::optional<proto::JobDocument> cancel(const std::string& tenant,
                                             const std::string& id) override;
    std::vector<JobEvent> events_after(const std::string& tenant, const std::string& id,
                                       std::uint64_t after) override;
    std::optional<proto::Results> results(const std::string& tenant,
                                          const std::string& id) override;
    std::uint64_t version() const noexcept override { return changes_.version(); }
    bool is_shared() const noexcept override { return lookout_.joinable(); }
    void wait_for_change(std::uint64_t seen, std::chrono::steady_clock::time_point deadline,
                         std::stop_token stop) const override {
        changes_.wait(seen, deadline, std::move(stop));
    }

    std::optional<Lease> claim(const QueueLimits& limits, std::chrono::seconds lease_time) override;
    bool renew(const Lease& lease, std::chrono::seconds lease_time) override;
    bool report_progress(const Lease& lease, const std::string& stage, double percent) override;
    bool report_source(const Lease& lease, const proto::CloudStatistics& source) override;
    bool publish_level(const Lease& lease, const proto::OutputCloud& level) override;
    bool succeed(const Lease& lease, const proto::JobCost& cost) override;
    bool fail(const Lease& lease, const proto::Problem& problem) override;
    bool crashed(const Lease& lease, const std::string& how) override;
    bool ran_out_of_room(const Lease& lease, const proto::Problem& problem) override;
    bool put_off(const Lease& lease, const proto::Problem& problem,
                 std::chrono::milliseconds rest) override;
    void still_no_room(std::chrono::milliseconds rest, const proto::Problem& problem) override;
    bool release(const Lease& lease) override;
    bool holds(const Lease& lease) override;

    void recover() override;
    Counts counts() override;
    std::uint64_t remove_expired_jobs(std::chrono::seconds retention) override;
    std::uint64_t remove_expired_clouds(std::chrono::seconds retention) override;
    std::vector<std::string> referenced_blobs() override;
    void probe() override;

private:
    /// Runs `change` in a transaction; once that is durable, wakes who waits, if anything changed.
    template <typename Change>
    auto write(Change change);
    /// The same for a worker: `change` gets the job's row, and is not called when the lease is
    /// stale.
    template <typename Change>
    bool write_leased(const Lease& lease, Change change);

    /// Runs `remove`, which tells how many rows it removed, until it finds fewer than a batch.
    template <typename Remove>
    std::uint64_t remove_in_batches(Remove remove);
    void give_back_log();

    // Parts of a write: the caller holds the writer and a transaction.
    std::int64_t insert_job(const std::string& tenant, const proto::JobRequest& request,
                            const std::string& canonical);
    void check_queue(const std::string& tenant, const QueueLimits& limits);
    proto::JobDocument document(std::int64_t row);
    void add_event(std::int64_t row, std::string_view type, const std::string& data);
    void add_status_event(std::int64_t row, proto::JobStatus status);
    std::optional<std::int64_t> next_in_queue(const QueueLimits& limits);
    Lease start(std::int64_t row, std::chrono::seconds lease_time);
    void requeue(std::int64_t row, const std::string& message);
    void requeue_expired();
    void requeue_without_room(std::int64_t row, const proto::Problem& problem);
    void require_made_cloud(const std::string& tenant, const std::string& id,
                            const std::string& field);
    void note_use(const std::string& tenant, const std::string& cloud);
    void requeue_lost(std::int64_t row, const std::string& message);
    std::uint64_t count_lost(std::int64_t row);
    void finish(std::int64_t row, proto::JobStatus status, const std::string& message);
    proto::JobDocument dismissed(std::int64_t row);
    void finish_failed(std::int64_t row, const proto::Problem& problem);
    void log_decided(std::int64_t row);

    void look_out_for_others(const std::stop_token& stop);

    ChangeSignal changes_;
    std::mutex writer_mutex_;
    sqlite::Connection writer_;
    std::mutex reader_mutex_;
    sqlite::Connection reader_;  ///< reads go on while a write waits for the disk
    std::jthread lookout_;       ///< tells of what other processes write
};

template <typename Change>
auto SqliteJobStore::write(Change change) {
    bool changed = false;
    auto result = [&] {
        const std::lock_guard lock(writer_mutex_);
        const std::int64_t before = writer_.total_changes();
        sqlite::Transaction transaction(writer_);
        auto value = change();
        transaction.commit();
        changed = writer_.total_changes() != before;
        return value;
    }();
    if (changed) changes_.bump();
    return result;
}

template <typename Change>
bool SqliteJobStore::write_leased(const Lease& lease, Change change) {
    return write([&] {
        const std::int64_t touched = writer_.run(
            "UPDATE jobs SET updated = ?1 WHERE id = ?2 AND lease_token = ?3 AND "
            "status = 'running'",
            now_ms(), lease.job_id, lease.token);
        if (touched == 0) return false;
        sqlite::Rows rows = writer_.query("SELECT row FROM jobs WHERE id = ?1", lease.job_id);
        rows.next();
        change(rows.integer(0));
        return true;
    });
}

}  // namespace stipple::server
