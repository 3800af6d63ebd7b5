#include "store/sqlite_job_store.hpp"

#include "log_text.hpp"
#include "store/sqlite_schema.hpp"

#include "stipple/error.hpp"

#include <spdlog/spdlog.h>
#include <algorithm>
#include <array>
#include <chrono>

namespace stipple::server {

using proto::JobReport;
using proto::JobStatus;
using sqlite::Rows;

namespace {

constexpr std::int64_t kProgressPeriodMs = 250;
constexpr double kProgressStep = 1.0;  // percent
constexpr std::int64_t kCrashesToFail = 2;
constexpr std::uint64_t kMostLost = 10;  // attempts of a job that are lost with their workers
constexpr std::uint64_t kMostFull = 3;   // the same on a full disk, with what was lost before
/// What is removed goes through the log of the database first: on a full disk the reserve has room
/// for that of so many jobs, not of all.
constexpr std::int64_t kRemovedAtOnce = 200;
constexpr std::string_view kWaitsForRoom = "the disk was full: waiting for room";

const std::array<std::string, 4> kBlobsNamed = {
    "SELECT id FROM clouds", "SELECT sha256 FROM outputs",
    "SELECT input FROM jobs WHERE status IN ('accepted', 'running')",
    "SELECT value FROM jobs, json_each(request, '$.candidates') "
    "WHERE status IN ('accepted', 'running')"};
const std::string kAllBlobsNamed = kBlobsNamed[0] + " UNION " + kBlobsNamed[1] + " UNION " +
                                   kBlobsNamed[2] + " UNION " + kBlobsNamed[3];

std::vector<std::string> blobs_named_by(sqlite::Connection& connection) {
    Rows rows = connection.query(kAllBlobsNamed.c_str());
    std::vector<std::string> blobs;
    while (rows.next()) blobs.push_back(rows.text(0));
    return blobs;
}

/// In milliseconds since 1970; nothing where it is before that: what is kept for so long never
/// goes.
std::optional<std::int64_t> time_before(std::chrono::seconds ago) {
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    if (ago >= std::chrono::floor<std::chrono::seconds>(now)) return {};
    return now_ms() - milliseconds(ago);
}

}  // namespace

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
                log_decided(*row);
            }
        }
        return std::nullopt;
    });
}

std::optional<std::int64_t> SqliteJobStore::next_in_queue(const QueueLimits& limits) {
    // A job that was put off rests, unless the clock was set back since.
    Rows rows = writer_.query(
        "WITH busy AS (SELECT tenant, count(*) AS jobs FROM jobs "
        "              WHERE status = 'running' GROUP BY tenant), "
        "     waiting AS (SELECT DISTINCT tenant FROM jobs WHERE status = 'accepted'), "
        "     head AS (SELECT tenant, (SELECT row FROM jobs "
        "                              WHERE jobs.tenant = waiting.tenant AND status = 'accepted' "
        "                              AND (lease_until <= ?2 OR updated > ?2) "
        "                              ORDER BY row LIMIT 1) AS row FROM waiting) "
        "SELECT head.row FROM head LEFT JOIN busy USING (tenant) LEFT JOIN turns USING (tenant) "
        "WHERE head.row IS NOT NULL AND coalesce(busy.jobs, 0) < ?1 "
        "ORDER BY coalesce(busy.jobs, 0), coalesce(turns.turn, 0), head.row LIMIT 1",
        limits.max_running, now_ms());
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
    writer_.run(
        "INSERT INTO turns SELECT ?1, coalesce(max(turn), 0) + 1 FROM turns WHERE true "
        "ON CONFLICT DO UPDATE SET turn = excluded.turn",
        lease.tenant);
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
    for (const std::int64_t row : expired)
        requeue_lost(row, "its worker went silent: waiting for another");
}

std::uint64_t SqliteJobStore::count_lost(std::int64_t row) {
    writer_.run("UPDATE jobs SET lost = lost + 1 WHERE row = ?1", row);
    Rows rows = writer_.query("SELECT lost FROM jobs WHERE row = ?1", row);
    rows.next();
    return rows.count(0);
}

/// A job may be what takes its workers down, as by the memory that all of a machine share.
void SqliteJobStore::requeue_lost(std::int64_t row, const std::string& message) {
    if (count_lost(row) < kMostLost) {
        requeue(row, message);
    } else {
        finish_failed(
            row, proto::problem_from(ErrorCode::Internal,
                                     "its worker was lost in " + std::to_string(kMostLost) +
                                         " attempts: it may need more memory than is available"));
    }
    log_decided(row);
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
        const std::int64_t ago = now_ms() - rows.integer(2);
        const bool due = ago < 0 || ago >= kProgressPeriodMs;  // < 0: the clock was set back
        if (!moved || !due) return true;
    }
    return write_leased(lease, [&](std::int64_t row) {
        writer_.run("UPDATE jobs SET stage = ?1, progress = ?2, told = ?3 WHERE row = ?4", stage,
                    percent, now_ms(), row);
        add_event(row, "progress", to_json(JobReport(proto::JobProgress{stage, percent})));
    });
}

bool SqliteJobStore::report_source(const Lease& lease, const proto::CloudStatistics& source) {
    return write_leased(lease, [&](std::int64_t row) {
        writer_.run("UPDATE jobs SET source = ?1 WHERE row = ?2", to_json(source), row);
        // Outliers are the job's alone, and so are bounds without them: better ones may be known.
        proto::CloudStatistics cloud = source;
        cloud.outliers.reset();
        writer_.run(source.outliers ? "UPDATE clouds SET statistics = COALESCE(statistics, ?1) "
                                      "WHERE tenant = ?2 AND id = ?3"
                                    : "UPDATE clouds SET statistics = ?1 "
                                      "WHERE tenant = ?2 AND id = ?3",
                    to_json(cloud), lease.tenant, lease.request.input);
        add_event(row, "source", to_json(JobReport(source)));
    });
}

bool SqliteJobStore::publish_level(const Lease& lease, const proto::OutputCloud& level) {
    const std::string body = to_json(JobReport(level));
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
        writer_.run("UPDATE jobs SET cost = ?1, stage = 'done', progress = 100 WHERE row = ?2",
                    to_json(JobReport(cost)), row);
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
            requeue(row, "the job process died (" + how + "): retrying once");
            return;
        }
        proto::Problem problem =
            proto::problem_from(ErrorCode::Internal, "the job process died twice: " + how);
        problem.stage = rows.text(1);
        finish_failed(row, problem);
    });
}

bool SqliteJobStore::ran_out_of_room(const Lease& lease, const proto::Problem& problem) {
    return write_leased(lease, [&](std::int64_t row) { requeue_without_room(row, problem); });
}

bool SqliteJobStore::put_off(const Lease& lease, const proto::Problem& problem,
                             std::chrono::milliseconds rest) {
    return write_leased(lease, [&](std::int64_t row) {
        if (count_lost(row) >= kMostLost) return finish_failed(row, problem);
        requeue(row, "the service could not run it: waiting to try again");
        // Of a job that waits, the time before which nobody gets it.
        writer_.run("UPDATE jobs SET lease_until = updated + ?1 WHERE row = ?2", rest.count(), row);
    });
}

void SqliteJobStore::still_no_room(std::chrono::milliseconds rest, const proto::Problem& problem) {
    write([&] {
        std::vector<std::int64_t> waiting;
        {
            Rows rows = writer_.query(
                "SELECT row FROM jobs WHERE status = 'accepted' AND message = ?1 AND updated <= ?2",
                kWaitsForRoom, now_ms() - rest.count());
            while (rows.next()) waiting.push_back(rows.integer(0));
        }
        for (const std::int64_t row : waiting) {
            requeue_without_room(row, problem);
            log_decided(row);
        }
        return waiting.size();
    });
}

void SqliteJobStore::requeue_without_room(std::int64_t row, const proto::Problem& problem) {
    if (count_lost(row) >= kMostFull) return finish_failed(row, problem);
    requeue(row, std::string(kWaitsForRoom));
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
        "started = NULL, updated = ?2, lease_until = 0 WHERE row = ?3",
        message, now_ms(), row);
    add_status_event(row, JobStatus::Accepted);
}

void SqliteJobStore::finish(std::int64_t row, JobStatus status, const std::string& message) {
    writer_.run(
        "UPDATE jobs SET status = ?1, message = ?2, finished = ?3, updated = ?3 WHERE row = ?4",
        to_string(status), message, now_ms(), row);
    writer_.run("UPDATE ended SET jobs = jobs + 1 WHERE status = ?1", to_string(status));
    add_status_event(row, status);
}

proto::JobDocument SqliteJobStore::dismissed(std::int64_t row) {
    finish(row, JobStatus::Dismissed, "dismissed by request");
    return document(row);
}

void SqliteJobStore::finish_failed(std::int64_t row, const proto::Problem& problem) {
    writer_.run("UPDATE jobs SET problem = ?1, stage = coalesce(?2, stage) WHERE row = ?3",
                to_json(problem), problem.stage, row);
    finish(row, JobStatus::Failed, problem.detail);
}

/// What no attempt at the job can tell of.
void SqliteJobStore::log_decided(std::int64_t row) {
    Rows rows = writer_.query("SELECT id, status, message FROM jobs WHERE row = ?1", row);
    rows.next();
    const bool failed = rows.text(1) == to_string(JobStatus::Failed);
    spdlog::log(failed ? spdlog::level::err : spdlog::level::warn, "job.{} id={} reason={}",
                failed ? "failed" : "requeued", rows.text(0), log_text(rows.text(2)));
}

// Housekeeping.

void SqliteJobStore::recover() {
    write([&] {
        std::vector<std::int64_t> running;
        {
            Rows rows = writer_.query("SELECT row FROM jobs WHERE status = 'running'");
            while (rows.next()) running.push_back(rows.integer(0));
        }
        for (const std::int64_t row : running)
            requeue_lost(row, "the service restarted: waiting again");
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
    Counts counts{.queued = rows.count(0), .running = rows.count(1), .ended = {}};
    if (!rows.is_null(2)) {
        const auto age_ms = std::max<std::int64_t>(0, now_ms() - rows.integer(2));
        counts.oldest_queued_seconds = static_cast<double>(age_ms) / 1000;
    }
    Rows ended = reader_.query("SELECT status, jobs FROM ended");
    while (ended.next()) counts.ended[ended.text(0)] = ended.count(1);
    return counts;
}

/// So that the next change begins the log anew, which otherwise grows to some megabytes first: on a
/// full disk these may be missing.
void SqliteJobStore::give_back_log() {
    const std::lock_guard lock(writer_mutex_);
    try {
        writer_.run("PRAGMA wal_checkpoint(PASSIVE)");
    } catch (const Error&) {  // the log may have room all the same
    }
}

template <typename Remove>
std::uint64_t SqliteJobStore::remove_in_batches(Remove remove) {
    std::uint64_t removed = 0;
    for (std::int64_t batch = kRemovedAtOnce; batch == kRemovedAtOnce;) {
        give_back_log();
        batch = write(remove);
        removed += static_cast<std::uint64_t>(batch);
    }
    return removed;
}

std::uint64_t SqliteJobStore::remove_expired_jobs(std::chrono::seconds retention) {
    const std::optional<std::int64_t> before = time_before(retention);
    if (!before) return 0;
    return remove_in_batches([&] {
        return writer_.run(
            "DELETE FROM jobs WHERE row IN (SELECT row FROM jobs WHERE finished < ?1 LIMIT ?2)",
            *before, kRemovedAtOnce);
    });
}

std::uint64_t SqliteJobStore::remove_expired_clouds(std::chrono::seconds retention) {
    const std::optional<std::int64_t> before = time_before(retention);
    if (!before) return 0;
    return remove_in_batches([&] {
        return writer_.run(
            "DELETE FROM clouds WHERE row IN (SELECT row FROM clouds WHERE used < ?1 AND NOT "
            "EXISTS "
            "(SELECT 1 FROM jobs WHERE jobs.tenant = clouds.tenant AND "
            "status IN ('accepted', 'running') AND (input = clouds.id OR "
            "clouds.id IN (SELECT value FROM json_each(request, '$.candidates')))) LIMIT ?2)",
            *before, kRemovedAtOnce);
    });
}

std::vector<std::string> SqliteJobStore::referenced_blobs() {
    // Of many results this takes seconds, for which no other reader is to wait.
    sqlite::Connection connection(writer_.file());
    return blobs_named_by(connection);
}

void SqliteJobStore::probe() {
    write([&] { return writer_.query("SELECT count(*) FROM sqlite_schema").next(); });
}

std::vector<std::string> read_referenced_blobs(const std::filesystem::path& file) {
    sqlite::Connection connection(file, sqlite::Access::Read);
    sqlite::check_schema(connection);
    return blobs_named_by(connection);
}

std::vector<std::string> read_referenced_blobs(const std::filesystem::path& file,
                                               std::vector<std::string>& damage) {
    sqlite::Connection connection(file, sqlite::Access::Read);
    std::vector<std::string> blobs;
    for (const std::string& query : kBlobsNamed) {
        try {
            Rows rows = connection.query(query.c_str());
            while (rows.next()) blobs.push_back(rows.text(0));
        } catch (const Error& error) {
            const std::string what = std::string("the names of files: ") + error.what();
            if (damage.empty() || damage.back() != what) damage.push_back(what);
        }
    }
    return blobs;
}

std::vector<std::string> find_damage(const std::filesystem::path& file) {
    constexpr std::string_view kIntact = "ok";
    sqlite::Connection connection(file, sqlite::Access::Read);
    std::vector<std::string> damage;
    try {
        Rows rows = connection.query("PRAGMA quick_check");
        while (rows.next())
            if (rows.text(0) != kIntact) damage.push_back(rows.text(0));
    } catch (const Error& error) {
        damage.emplace_back(error.what());
    }
    return damage;
}

}  // namespace stipple::server
