#include "store/job_store.hpp"

#include "store/change_signal.hpp"
#include "store/cursor.hpp"
#include "store/posix_file.hpp"
#include "store/sqlite.hpp"
#include "store/sqlite_schema.hpp"

#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <limits>
#include <mutex>
#include <span>
#include <utility>

namespace stipple::server {

namespace {

namespace fs = std::filesystem;
using proto::JobDocument;
using proto::JobReport;
using proto::JobStatus;
using sqlite::Rows;
using sqlite::Transaction;

constexpr std::int64_t kProgressPeriodMs = 250;
constexpr double kProgressStep = 1.0;  // percent
constexpr std::int64_t kCrashesToFail = 2;

std::int64_t milliseconds(std::chrono::system_clock::duration duration) {
    return std::chrono::duration_cast<std::chrono::milliseconds>(duration).count();
}

std::int64_t now_ms() {
    return milliseconds(std::chrono::system_clock::now().time_since_epoch());
}

/// RFC 3339 in UTC: `2026-11-21T04:00:28.123Z`.
std::string time_text(std::int64_t ms) {
    const std::time_t seconds = ms / 1000;
    std::tm utc{};
    ::gmtime_r(&seconds, &utc);
    char date[32];
    const std::size_t length = std::strftime(date, sizeof date, "%Y-%m-%dT%H:%M:%S", &utc);
    char fraction[8];
    std::snprintf(fraction, sizeof fraction, ".%03dZ", static_cast<int>(ms % 1000));
    return std::string(date, length) + fraction;
}

std::string time_text(const Rows& rows, int column) {
    return rows.is_null(column) ? std::string() : time_text(rows.integer(column));
}

/// One process at a time: another would take this one's running jobs for left behind ones.
FileDescriptor lock_for_this_process(const fs::path& file) {
    const fs::path lock_file = file.string() + ".lock";
    FileDescriptor fd = open_file(lock_file, O_RDWR | O_CREAT);
    if (!fd) throw_errno("cannot open", lock_file);
    if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
        throw Error(ErrorCode::Conflict,
                    file.string() +
                        " is in use by another process: stop it, or give this one a "
                        "data folder of its own");
    }
    return fd;
}

// Columns as `document_of` reads them.
const std::string kSelectJob =
    "SELECT id, request, status, stage, message, progress, created, started, finished, updated, "
    "problem, (SELECT count(*) FROM levels WHERE job = jobs.row), row FROM jobs ";
const std::string kFindJob = kSelectJob + "WHERE tenant = ?1 AND id = ?2";
const std::string kJobOfRow = kSelectJob + "WHERE row = ?1";
const std::string kListJobs =
    kSelectJob +
    "WHERE tenant = ?1 AND row < ?2 AND (?3 IS NULL OR type = ?3) AND (?4 IS NULL OR status = ?4) "
    "AND (?5 IS NULL OR input = ?5) ORDER BY row DESC LIMIT ?6";
constexpr int kJobRowColumn = 12;

JobDocument document_of(const Rows& rows) {
    JobDocument document;
    document.id = rows.text(0);
    document.request = proto::job_request_from_json(rows.text(1));
    document.status = proto::job_status_from_name(rows.text(2));
    document.stage = rows.text(3);
    document.message = rows.text(4);
    document.progress = rows.real(5);
    document.created = time_text(rows, 6);
    document.started = time_text(rows, 7);
    document.finished = time_text(rows, 8);
    document.updated = time_text(rows, 9);
    if (const auto problem = rows.maybe_text(10)) {
        document.problem = proto::problem_from_json(*problem);
    }
    document.levels_ready = static_cast<unsigned>(rows.count(11));
    return document;
}

// Columns as `cloud_of` reads them.
const std::string kSelectCloud =
    "SELECT tenant, id, format, bytes, created, statistics, row FROM clouds ";
const std::string kFindCloud = kSelectCloud + "WHERE tenant = ?1 AND id = ?2";
const std::string kListClouds =
    kSelectCloud + "WHERE tenant = ?1 AND row < ?2 ORDER BY row DESC LIMIT ?3";
constexpr int kCloudRowColumn = 6;

CloudRow cloud_of(const Rows& rows) {
    CloudRow cloud{.tenant = rows.text(0),
                   .id = rows.text(1),
                   .format = cloud_format_from_name(rows.text(2)),
                   .bytes = rows.count(3),
                   .created = time_text(rows, 4),
                   .statistics = {}};
    if (const auto statistics = rows.maybe_text(5)) {
        cloud.statistics = proto::cloud_statistics_from_json(*statistics);
    }
    return cloud;
}

/// Reads one row more than a page holds, to know whether another page follows.
template <typename ItemOf>
auto read_page(Rows& rows, unsigned limit, std::string_view listing, int row_column, ItemOf item_of,
               std::optional<std::string>& next) {
    std::vector<decltype(item_of(rows))> page;
    std::int64_t last_row = 0;
    next.reset();
    while (rows.next()) {
        if (page.size() == limit) {
            next = encode_cursor(listing, last_row);
            break;
        }
        page.push_back(item_of(rows));
        last_row = rows.integer(row_column);
    }
    return page;
}

constexpr std::string_view kClouds = "clouds";
constexpr std::string_view kJobs = "jobs";

/// Newest first: the first page starts above every row.
std::int64_t first_row(std::string_view listing, const std::optional<std::string>& cursor) {
    return cursor ? decode_cursor(listing, *cursor) : std::numeric_limits<std::int64_t>::max();
}

class SqliteJobStore final : public JobStore {
public:
    explicit SqliteJobStore(const fs::path& file);

    Submitted put_cloud(const CloudRow& row) override;
    std::optional<CloudRow> find_cloud(const std::string& tenant, const std::string& id) override;
    std::vector<CloudRow> list_clouds(const std::string& tenant, unsigned limit,
                                      const std::optional<std::string>& cursor,
                                      std::optional<std::string>& next) override;
    void set_statistics(const std::string& tenant, const std::string& id,
                        const proto::CloudStatistics& statistics) override;
    bool remove_cloud(const std::string& tenant, const std::string& id) override;

    Submitted submit(const std::string& tenant, const proto::JobRequest& request,
                     const std::optional<std::string>& idempotency_key, const QueueLimits& limits,
                     JobDocument& document) override;
    std::optional<JobDocument> find_job(const std::string& tenant, const std::string& id) override;
    std::vector<JobDocument> list_jobs(const std::string& tenant, const JobFilter& filter,
                                       unsigned limit, const std::optional<std::string>& cursor,
                                       std::optional<std::string>& next) override;
    std::optional<JobDocument> dismiss(const std::string& tenant, const std::string& id) override;
    std::vector<JobEvent> events_after(const std::string& tenant, const std::string& id,
                                       std::uint64_t after) override;
    std::optional<proto::Results> results(const std::string& tenant,
                                          const std::string& id) override;
    std::uint64_t version() const noexcept override { return changes_.version(); }
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
    bool release(const Lease& lease) override;
    bool holds(const Lease& lease) override;

    void recover() override;
    Counts counts() override;
    void remove_expired(std::chrono::seconds retention) override;
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

    // Parts of a write: the caller holds the writer and a transaction.
    std::optional<std::int64_t> find_replayed(const std::string& tenant, const std::string& key,
                                              const std::string& fingerprint);
    std::int64_t insert_job(const std::string& tenant, const proto::JobRequest& request,
                            const std::string& canonical);
    void check_queue(const std::string& tenant, const QueueLimits& limits);
    JobDocument document(std::int64_t row);
    void add_event(std::int64_t row, std::string_view type, const std::string& data);
    void add_status_event(std::int64_t row, JobStatus status);
    std::optional<std::int64_t> next_in_queue(const QueueLimits& limits);
    Lease start(std::int64_t row, std::chrono::seconds lease_time);
    void requeue(std::int64_t row, const std::string& message);
    void requeue_expired();
    void finish(std::int64_t row, JobStatus status, const std::string& message);
    void finish_failed(std::int64_t row, const proto::Problem& problem);

    const FileDescriptor lock_;
    ChangeSignal changes_;
    std::mutex writer_mutex_;
    sqlite::Connection writer_;
    std::mutex reader_mutex_;
    sqlite::Connection reader_;  ///< reads go on while a write waits for the disk
};

SqliteJobStore::SqliteJobStore(const fs::path& file)
    : lock_(lock_for_this_process(file)), writer_(file), reader_(file) {
    writer_.script(
        "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON");
    sqlite::migrate(writer_);
    reader_.script("PRAGMA query_only = ON");
    sync_folder(fs::absolute(file).parent_path());
}

template <typename Change>
auto SqliteJobStore::write(Change change) {
    bool changed = false;
    auto result = [&] {
        const std::lock_guard lock(writer_mutex_);
        const std::int64_t before = writer_.total_changes();
        Transaction transaction(writer_);
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
        Rows rows = writer_.query("SELECT row FROM jobs WHERE id = ?1", lease.job_id);
        rows.next();
        change(rows.integer(0));
        return true;
    });
}

// Clouds.

Submitted SqliteJobStore::put_cloud(const CloudRow& row) {
    return write([&] {
        std::optional<std::string> statistics;
        if (row.statistics) statistics = to_json(*row.statistics);
        const std::int64_t added = writer_.run(
            "INSERT INTO clouds (tenant, id, format, bytes, created, statistics) "
            "VALUES (?1, ?2, ?3, ?4, ?5, ?6) ON CONFLICT DO NOTHING",
            row.tenant, row.id, to_string(row.format), row.bytes, now_ms(), statistics);
        return added == 1 ? Submitted::Created : Submitted::Existing;
    });
}

std::optional<CloudRow> SqliteJobStore::find_cloud(const std::string& tenant,
                                                   const std::string& id) {
    const std::lock_guard lock(reader_mutex_);
    Rows rows = reader_.query(kFindCloud.c_str(), tenant, id);
    if (!rows.next()) return std::nullopt;
    return cloud_of(rows);
}

std::vector<CloudRow> SqliteJobStore::list_clouds(const std::string& tenant, unsigned limit,
                                                  const std::optional<std::string>& cursor,
                                                  std::optional<std::string>& next) {
    const std::int64_t below = first_row(kClouds, cursor);
    const std::lock_guard lock(reader_mutex_);
    Rows rows = reader_.query(kListClouds.c_str(), tenant, below, limit + 1);
    return read_page(rows, limit, kClouds, kCloudRowColumn, cloud_of, next);
}

void SqliteJobStore::set_statistics(const std::string& tenant, const std::string& id,
                                    const proto::CloudStatistics& statistics) {
    write([&] {
        return writer_.run("UPDATE clouds SET statistics = ?1 WHERE tenant = ?2 AND id = ?3",
                           to_json(statistics), tenant, id);
    });
}

bool SqliteJobStore::remove_cloud(const std::string& tenant, const std::string& id) {
    return write([&] {
        Rows users = writer_.query(
            "SELECT id FROM jobs WHERE tenant = ?1 AND status IN ('accepted', 'running') AND "
            "(input = ?2 OR "
            " ?2 IN (SELECT value FROM json_each(request, '$.candidates'))) LIMIT 1",
            tenant, id);
        if (users.next()) {
            throw Error(ErrorCode::Conflict, "cloud " + id + " is needed by job " + users.text(0) +
                                                 ": wait for it, or dismiss it first");
        }
        return writer_.run("DELETE FROM clouds WHERE tenant = ?1 AND id = ?2", tenant, id) > 0;
    });
}

// Jobs.

Submitted SqliteJobStore::submit(const std::string& tenant, const proto::JobRequest& request,
                                 const std::optional<std::string>& idempotency_key,
                                 const QueueLimits& limits, JobDocument& result) {
    const std::string canonical = to_json(request);
    const std::string fingerprint = proto::sha256_hex(std::as_bytes(std::span(canonical)));
    return write([&] {
        if (idempotency_key) {
            if (const auto row = find_replayed(tenant, *idempotency_key, fingerprint)) {
                result = document(*row);
                return Submitted::Existing;
            }
        }
        check_queue(tenant, limits);
        const std::int64_t row = insert_job(tenant, request, canonical);
        if (idempotency_key) {
            writer_.run(
                "INSERT INTO idempotency (tenant, key, fingerprint, job) VALUES (?1, ?2, ?3, ?4)",
                tenant, *idempotency_key, fingerprint, row);
        }
        result = document(row);
        return Submitted::Created;
    });
}

std::optional<std::int64_t> SqliteJobStore::find_replayed(const std::string& tenant,
                                                          const std::string& key,
                                                          const std::string& fingerprint) {
    Rows rows = writer_.query(
        "SELECT job, fingerprint FROM idempotency WHERE tenant = ?1 AND key = ?2", tenant, key);
    if (!rows.next()) return std::nullopt;
    if (rows.text(1) != fingerprint) {
        throw Error(ErrorCode::Conflict,
                    "idempotency key \"" + key +
                        "\" came with another request before: use a new key for a new request");
    }
    return rows.integer(0);
}

void SqliteJobStore::check_queue(const std::string& tenant, const QueueLimits& limits) {
    Rows rows = writer_.query("SELECT count(*) FROM jobs WHERE tenant = ?1 AND status = 'accepted'",
                              tenant);
    rows.next();
    if (rows.count(0) < limits.max_queued) return;
    throw Error(ErrorCode::QueueFull,
                std::to_string(rows.count(0)) + " jobs are waiting already: the limit is " +
                    std::to_string(limits.max_queued) + "; try again when some have run");
}

std::int64_t SqliteJobStore::insert_job(const std::string& tenant, const proto::JobRequest& request,
                                        const std::string& canonical) {
    for (const std::string& id : proto::inputs_of(request)) {
        // A cloud of the tenant's, or a file that a job of the tenant's made.
        Rows rows = writer_.query(
            "SELECT 1 FROM clouds WHERE tenant = ?1 AND id = ?2 UNION ALL "
            "SELECT 1 FROM jobs JOIN outputs ON outputs.job = jobs.row "
            "WHERE tenant = ?1 AND sha256 = ?2 LIMIT 1",
            tenant, id);
        if (!rows.next()) throw Error(ErrorCode::NotFound, "input " + id + ": no such cloud");
    }
    writer_.run(
        "INSERT INTO jobs (id, tenant, type, input, request, message, created, updated) "
        "VALUES (?1, ?2, ?3, ?4, ?5, 'waiting for a worker', ?6, ?6)",
        proto::random_hex(16), tenant, type_name(request), request.input, canonical, now_ms());
    const std::int64_t row = writer_.last_row();
    add_status_event(row, JobStatus::Accepted);
    return row;
}

JobDocument SqliteJobStore::document(std::int64_t row) {
    Rows rows = writer_.query(kJobOfRow.c_str(), row);
    rows.next();
    return document_of(rows);
}

std::optional<JobDocument> SqliteJobStore::find_job(const std::string& tenant,
                                                    const std::string& id) {
    const std::lock_guard lock(reader_mutex_);
    Rows rows = reader_.query(kFindJob.c_str(), tenant, id);
    if (!rows.next()) return std::nullopt;
    return document_of(rows);
}

std::vector<JobDocument> SqliteJobStore::list_jobs(const std::string& tenant,
                                                   const JobFilter& filter, unsigned limit,
                                                   const std::optional<std::string>& cursor,
                                                   std::optional<std::string>& next) {
    const std::int64_t below = first_row(kJobs, cursor);
    const std::lock_guard lock(reader_mutex_);
    Rows rows = reader_.query(kListJobs.c_str(), tenant, below, filter.type, filter.status,
                              filter.input, limit + 1);
    return read_page(rows, limit, kJobs, kJobRowColumn, document_of, next);
}

std::optional<JobDocument> SqliteJobStore::dismiss(const std::string& tenant,
                                                   const std::string& id) {
    return write([&]() -> std::optional<JobDocument> {
        std::int64_t row = 0;
        JobDocument before;
        {
            Rows rows = writer_.query(kFindJob.c_str(), tenant, id);
            if (!rows.next()) return std::nullopt;
            row = rows.integer(kJobRowColumn);
            before = document_of(rows);
        }
        if (is_final(before.status)) {
            writer_.run("DELETE FROM jobs WHERE row = ?1", row);
            return before;
        }
        finish(row, JobStatus::Dismissed, "dismissed by request");
        return document(row);
    });
}

std::vector<JobEvent> SqliteJobStore::events_after(const std::string& tenant, const std::string& id,
                                                   std::uint64_t after) {
    const std::lock_guard lock(reader_mutex_);
    Rows rows = reader_.query(
        "SELECT events.id, events.type, events.data FROM jobs JOIN events ON events.job = jobs.row "
        "WHERE jobs.tenant = ?1 AND jobs.id = ?2 AND events.id > ?3 ORDER BY events.id",
        tenant, id, after);
    std::vector<JobEvent> events;
    while (rows.next()) events.push_back({rows.count(0), rows.text(1), rows.text(2)});
    return events;
}

std::optional<proto::Results> SqliteJobStore::results(const std::string& tenant,
                                                      const std::string& id) {
    const std::lock_guard lock(reader_mutex_);
    // One row per level, and one with nulls for a job without any: a single consistent read.
    Rows rows = reader_.query(
        "SELECT request, status, source, cost, body FROM jobs "
        "LEFT JOIN levels ON levels.job = jobs.row "
        "WHERE tenant = ?1 AND id = ?2 ORDER BY level",
        tenant, id);
    if (!rows.next()) return std::nullopt;
    proto::Results results;
    results.request = proto::job_request_from_json(rows.text(0));
    results.complete = proto::job_status_from_name(rows.text(1)) == JobStatus::Successful;
    if (const auto source = rows.maybe_text(2)) {
        results.source = proto::cloud_statistics_from_json(*source);
    }
    if (const auto cost = rows.maybe_text(3)) {
        results.cost = proto::job_report_from_json(*cost).cost;
    }
    do {
        const auto body = rows.maybe_text(4);
        if (body) results.levels.push_back(proto::job_report_from_json(*body).level.value());
    } while (rows.next());
    return results;
}

// The worker's side.

std::optional<Lease> SqliteJobStore::claim(const QueueLimits& limits,
                                           std::chrono::seconds lease_time) {
    return write([&]() -> std::optional<Lease> {
        requeue_expired();
        while (const auto row = next_in_queue(limits)) {
            try {
                return start(*row, lease_time);
            } catch (const Error& error) {
                if (error.code() == ErrorCode::Internal) throw;
                // Its request was written by another version. It must not stand in the way of all
                // others.
                finish_failed(*row, proto::problem_from(ErrorCode::Internal, error.what()));
            }
        }
        return std::nullopt;
    });
}

std::optional<std::int64_t> SqliteJobStore::next_in_queue(const QueueLimits& limits) {
    Rows rows = writer_.query(
        "WITH busy AS (SELECT tenant, count(*) AS jobs FROM jobs "
        "              WHERE status = 'running' GROUP BY tenant), "
        "     head AS (SELECT tenant, min(row) AS row FROM jobs "
        "              WHERE status = 'accepted' GROUP BY tenant) "
        "SELECT head.row FROM head LEFT JOIN busy USING (tenant) "
        "WHERE coalesce(busy.jobs, 0) < ?1 ORDER BY coalesce(busy.jobs, 0), head.row LIMIT 1",
        limits.max_running);
    if (!rows.next()) return std::nullopt;
    return rows.integer(0);
}

Lease SqliteJobStore::start(std::int64_t row, std::chrono::seconds lease_time) {
    const std::int64_t now = now_ms();
    Rows rows =
        writer_.query("SELECT id, tenant, lease_token, request FROM jobs WHERE row = ?1", row);
    rows.next();
    Lease lease{rows.text(0), rows.text(1), rows.count(2) + 1,
                proto::job_request_from_json(rows.text(3))};
    writer_.run(
        "UPDATE jobs SET status = 'running', stage = 'decode', message = 'running', progress = 0, "
        "told = 0, started = ?1, updated = ?1, lease_token = ?2, lease_until = ?3 WHERE row = ?4",
        now, lease.token, now + milliseconds(lease_time), row);
    add_status_event(row, JobStatus::Running);
    return lease;
}

void SqliteJobStore::requeue_expired() {
    std::vector<std::int64_t> expired;
    {
        Rows rows = writer_.query(
            "SELECT row FROM jobs WHERE status = 'running' AND lease_until < ?1", now_ms());
        while (rows.next()) expired.push_back(rows.integer(0));
    }
    for (const std::int64_t row : expired) {
        requeue(row, "its worker went silent: waiting for another");
    }
}

bool SqliteJobStore::renew(const Lease& lease, std::chrono::seconds lease_time) {
    return write_leased(lease, [&](std::int64_t row) {
        writer_.run("UPDATE jobs SET lease_until = ?1 WHERE row = ?2",
                    now_ms() + milliseconds(lease_time), row);
    });
}

bool SqliteJobStore::report_progress(const Lease& lease, const std::string& stage, double percent) {
    {
        const std::lock_guard lock(reader_mutex_);
        Rows rows = reader_.query(
            "SELECT stage, progress, told FROM jobs WHERE id = ?1 AND lease_token = ?2 AND "
            "status = 'running'",
            lease.job_id, lease.token);
        if (!rows.next()) return false;
        percent = std::clamp(percent, rows.real(1), 100.0);
        const bool moved = rows.text(0) != stage || percent >= rows.real(1) + kProgressStep;
        const bool due = now_ms() - rows.integer(2) >= kProgressPeriodMs;
        if (!moved || !due) return true;
    }
    return write_leased(lease, [&](std::int64_t row) {
        writer_.run("UPDATE jobs SET stage = ?1, progress = ?2, told = ?3 WHERE row = ?4", stage,
                    percent, now_ms(), row);
        JobReport report;
        report.progress = {stage, percent};
        add_event(row, "progress", to_json(report));
    });
}

bool SqliteJobStore::report_source(const Lease& lease, const proto::CloudStatistics& source) {
    return write_leased(lease, [&](std::int64_t row) {
        const std::string statistics = to_json(source);
        writer_.run("UPDATE jobs SET source = ?1 WHERE row = ?2", statistics, row);
        writer_.run("UPDATE clouds SET statistics = ?1 WHERE tenant = ?2 AND id = ?3", statistics,
                    lease.tenant, lease.request.input);
        JobReport report;
        report.source = source;
        add_event(row, "source", to_json(report));
    });
}

bool SqliteJobStore::publish_level(const Lease& lease, const proto::OutputCloud& level) {
    JobReport report;
    report.level = level;
    const std::string body = to_json(report);
    return write_leased(lease, [&](std::int64_t row) {
        // A repeated attempt makes the same level again: nothing new to tell.
        const std::int64_t changed = writer_.run(
            "INSERT INTO levels (job, level, body) VALUES (?1, ?2, ?3) "
            "ON CONFLICT DO UPDATE SET body = excluded.body WHERE body <> excluded.body",
            row, level.level, body);
        if (changed == 0) return;
        for (const proto::OutputFile& file : level.files) {
            writer_.run("INSERT INTO outputs (job, sha256) VALUES (?1, ?2) ON CONFLICT DO NOTHING",
                        row, file.sha256);
        }
        for (const proto::PictureFile& picture : level.pictures) {
            writer_.run("INSERT INTO outputs (job, sha256) VALUES (?1, ?2) ON CONFLICT DO NOTHING",
                        row, picture.sha256);
        }
        add_event(row, "level", body);
    });
}

bool SqliteJobStore::succeed(const Lease& lease, const proto::JobCost& cost) {
    return write_leased(lease, [&](std::int64_t row) {
        JobReport report;
        report.cost = cost;
        writer_.run("UPDATE jobs SET cost = ?1, stage = 'done', progress = 100 WHERE row = ?2",
                    to_json(report), row);
        finish(row, JobStatus::Successful, "done");
    });
}

bool SqliteJobStore::fail(const Lease& lease, const proto::Problem& problem) {
    return write_leased(lease, [&](std::int64_t row) { finish_failed(row, problem); });
}

bool SqliteJobStore::crashed(const Lease& lease, const std::string& how) {
    return write_leased(lease, [&](std::int64_t row) {
        writer_.run("UPDATE jobs SET crashes = crashes + 1 WHERE row = ?1", row);
        Rows rows = writer_.query("SELECT crashes, stage FROM jobs WHERE row = ?1", row);
        rows.next();
        if (rows.integer(0) < kCrashesToFail) {
            requeue(row, "the job process died (" + how + "): trying once more");
            return;
        }
        proto::Problem problem =
            proto::problem_from(ErrorCode::Internal, "the job process died twice: " + how);
        problem.stage = rows.text(1);
        finish_failed(row, problem);
    });
}

bool SqliteJobStore::release(const Lease& lease) {
    return write_leased(lease, [&](std::int64_t row) { requeue(row, "waiting for a worker"); });
}

bool SqliteJobStore::holds(const Lease& lease) {
    const std::lock_guard lock(reader_mutex_);
    Rows rows = reader_.query(
        "SELECT 1 FROM jobs WHERE id = ?1 AND lease_token = ?2 AND status = 'running'",
        lease.job_id, lease.token);
    return rows.next();
}

// Parts of writes.

void SqliteJobStore::add_event(std::int64_t row, std::string_view type, const std::string& data) {
    writer_.run("UPDATE jobs SET last_event = last_event + 1 WHERE row = ?1", row);
    writer_.run(
        "INSERT INTO events (job, id, type, data) "
        "SELECT row, last_event, ?2, ?3 FROM jobs WHERE row = ?1",
        row, type, data);
}

void SqliteJobStore::add_status_event(std::int64_t row, JobStatus status) {
    add_event(row, "status", R"({"status":")" + std::string(to_string(status)) + R"("})");
}

void SqliteJobStore::requeue(std::int64_t row, const std::string& message) {
    writer_.run(
        "UPDATE jobs SET status = 'accepted', stage = 'queued', message = ?1, progress = 0, "
        "started = NULL, updated = ?2 WHERE row = ?3",
        message, now_ms(), row);
    add_status_event(row, JobStatus::Accepted);
}

void SqliteJobStore::finish(std::int64_t row, JobStatus status, const std::string& message) {
    writer_.run(
        "UPDATE jobs SET status = ?1, message = ?2, finished = ?3, updated = ?3 WHERE row = ?4",
        to_string(status), message, now_ms(), row);
    add_status_event(row, status);
}

void SqliteJobStore::finish_failed(std::int64_t row, const proto::Problem& problem) {
    writer_.run("UPDATE jobs SET problem = ?1 WHERE row = ?2", to_json(problem), row);
    finish(row, JobStatus::Failed, problem.detail);
}

// Housekeeping.

void SqliteJobStore::recover() {
    write([&] {
        std::vector<std::int64_t> running;
        {
            Rows rows = writer_.query("SELECT row FROM jobs WHERE status = 'running'");
            while (rows.next()) running.push_back(rows.integer(0));
        }
        for (const std::int64_t row : running) requeue(row, "the service restarted: waiting again");
        return running.size();
    });
}

JobStore::Counts SqliteJobStore::counts() {
    const std::lock_guard lock(reader_mutex_);
    Rows rows = reader_.query(
        "SELECT (SELECT count(*) FROM jobs WHERE status = 'accepted'), "
        "       (SELECT count(*) FROM jobs WHERE status = 'running'), "
        "       (SELECT min(created) FROM jobs WHERE status = 'accepted')");
    rows.next();
    Counts counts{.queued = rows.count(0), .running = rows.count(1)};
    if (!rows.is_null(2)) {
        const auto age_ms = std::max<std::int64_t>(0, now_ms() - rows.integer(2));
        counts.oldest_queued_seconds = static_cast<double>(age_ms) / 1000;
    }
    return counts;
}

void SqliteJobStore::remove_expired(std::chrono::seconds retention) {
    write([&] {
        return writer_.run("DELETE FROM jobs WHERE finished < ?1",
                           now_ms() - milliseconds(retention));
    });
}

std::vector<std::string> SqliteJobStore::referenced_blobs() {
    const std::lock_guard lock(reader_mutex_);
    Rows rows = reader_.query(
        "SELECT id FROM clouds UNION SELECT sha256 FROM outputs UNION "
        "SELECT input FROM jobs WHERE status IN ('accepted', 'running') UNION "
        "SELECT value FROM jobs, json_each(request, '$.candidates') "
        "WHERE status IN ('accepted', 'running')");
    std::vector<std::string> blobs;
    while (rows.next()) blobs.push_back(rows.text(0));
    return blobs;
}

void SqliteJobStore::probe() {
    write([&] { return writer_.query("SELECT count(*) FROM sqlite_schema").next(); });
}

}  // namespace

std::unique_ptr<JobStore> open_sqlite_job_store(const fs::path& file) {
    return std::make_unique<SqliteJobStore>(file);
}

}  // namespace stipple::server
