#include "store/sqlite_job_store.hpp"

#include "store/cursor.hpp"
#include "store/posix_file.hpp"
#include "store/sqlite_schema.hpp"
#include "store/store_fault.hpp"

#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/problem.hpp"

#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <ctime>
#include <limits>
#include <span>
#include <thread>
#include <utility>

namespace stipple::server {

namespace {

namespace fs = std::filesystem;
using proto::JobDocument;
using proto::JobStatus;
using sqlite::Rows;

/// Between two looks at what other processes wrote.
constexpr std::chrono::milliseconds kLookPeriod{20};

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

// Columns as `document_of` reads them.
const std::string kSelectJob =
    "SELECT id, request, status, stage, message, progress, created, started, finished, updated, "
    "problem, (SELECT count(*) FROM levels WHERE job = jobs.row), "
    "(SELECT name FROM clouds WHERE clouds.tenant = jobs.tenant AND clouds.id = jobs.input), row "
    "FROM jobs ";
const std::string kFindJob = kSelectJob + "WHERE tenant = ?1 AND id = ?2";
const std::string kJobOfRow = kSelectJob + "WHERE row = ?1";
const std::string kListJobs =
    kSelectJob +
    "WHERE tenant = ?1 AND row < ?2 AND (?3 IS NULL OR type = ?3) AND (?4 IS NULL OR status = ?4) "
    "AND (?5 IS NULL OR input = ?5) ORDER BY row DESC LIMIT ?6";
constexpr int kJobRowColumn = 13;

JobDocument document_of(const Rows& rows) {
    JobDocument document;
    document.id = rows.text(0);
    document.request = proto::stored_request_from_json(rows.text(1));
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
    document.input_name = rows.maybe_text(12);
    return document;
}

// Columns as `cloud_of` reads them.
const std::string kSelectCloud =
    "SELECT tenant, id, name, format, bytes, created, statistics, row, used FROM clouds ";
const std::string kFindCloud = kSelectCloud + "WHERE tenant = ?1 AND id = ?2";
const std::string kListClouds =
    kSelectCloud + "WHERE tenant = ?1 AND row < ?2 ORDER BY row DESC LIMIT ?3";
constexpr int kCloudRowColumn = 7, kCloudUsedColumn = 8;

CloudRow cloud_of(const Rows& rows) {
    CloudRow cloud{.tenant = rows.text(0),
                   .id = rows.text(1),
                   .name = rows.maybe_text(2),
                   .format = cloud_format_from_name(rows.text(3)),
                   .bytes = rows.count(4),
                   .created = time_text(rows, 5),
                   .statistics = {}};
    if (const auto statistics = rows.maybe_text(6)) {
        cloud.statistics = proto::cloud_statistics_from_json(*statistics);
    }
    return cloud;
}

/// A page or a batch of events ends after so many bytes: a request may have 64 KiB, and a page a
/// thousand of them.
constexpr std::size_t kPageBytes = 1U << 20;

/// Reads one row more than a page holds, to know whether another page follows. What a later version
/// wrote and this one cannot read is left out: it hides nothing else.
template <typename ItemOf>
auto read_page(Rows& rows, unsigned limit, std::string_view listing, int row_column,
               ItemOf item_of) {
    Page<decltype(item_of(rows))> page;
    std::int64_t last_row = 0;
    std::size_t bytes = 0;
    while (rows.next()) {
        if (page.items.size() == limit || bytes >= kPageBytes) {
            page.next = encode_cursor(listing, last_row);
            break;
        }
        last_row = rows.integer(row_column);
        bytes += rows.text_bytes();
        try {
            page.items.push_back(item_of(rows));
        } catch (const Error&) {
        }
    }
    return page;
}

/// To read a cloud is a use of it, which is written no more often.
constexpr std::int64_t kUsePeriodMs = 3'600'000;

constexpr std::string_view kClouds = "clouds";
constexpr std::string_view kJobs = "jobs";

/// Newest first: the first page starts above every row.
std::int64_t first_row(std::string_view listing, const std::optional<std::string>& cursor) {
    return cursor ? decode_cursor(listing, *cursor) : std::numeric_limits<std::int64_t>::max();
}

/// SQLite changes the journal at once or not at all: not while others open the same new file.
void use_write_ahead_log(sqlite::Connection& connection) {
    constexpr auto kPatience = std::chrono::seconds(10);
    constexpr auto kPause = std::chrono::milliseconds(5);
    constexpr auto kChange = "PRAGMA journal_mode = WAL";
    const auto end = std::chrono::steady_clock::now() + kPatience;
    while (!connection.try_script(kChange)) {
        if (std::chrono::steady_clock::now() > end) return connection.script(kChange);  // says why
        std::this_thread::sleep_for(kPause);
    }
}

std::string fingerprint_of(const std::string& canonical) {
    return proto::sha256_hex(std::as_bytes(std::span(canonical)));
}

/// The row of the job that a key was used for.
std::optional<std::int64_t> find_replayed(sqlite::Connection& connection, const std::string& tenant,
                                          const std::string& key, const std::string& fingerprint) {
    Rows rows = connection.query(
        "SELECT job, fingerprint FROM idempotency WHERE tenant = ?1 AND key = ?2", tenant, key);
    if (!rows.next()) return std::nullopt;
    if (rows.text(1) != fingerprint) {
        throw Error(ErrorCode::Conflict,
                    "idempotency key \"" + key +
                        "\" was used for another request: use a new key for a new request");
    }
    return rows.integer(0);
}

JobDocument document_of_row(sqlite::Connection& connection, std::int64_t row) {
    Rows rows = connection.query(kJobOfRow.c_str(), row);
    rows.next();
    return document_of(rows);
}

}  // namespace

SqliteJobStore::SqliteJobStore(const fs::path& file, Sharing sharing)
    : writer_(file), reader_(file) {
    sqlite::migrate(writer_);  // first: it refuses what is another's
    use_write_ahead_log(writer_);
    writer_.script("PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON");
    // What a large change made of the log is given back: of a disk that fills up it is missed.
    writer_.script("PRAGMA journal_size_limit = 16777216");
    reader_.script("PRAGMA query_only = ON");
    sync_folder(fs::absolute(file).parent_path());
    if (sharing == Sharing::WithOtherProcesses) {
        lookout_ = std::jthread([this](const std::stop_token& stop) { look_out_for_others(stop); });
    }
}

/// SQLite tells whether another connection wrote, and wakes nobody.
void SqliteJobStore::look_out_for_others(const std::stop_token& stop) {
    std::mutex mutex;
    std::unique_lock lock(mutex);
    std::condition_variable_any stopped;
    std::optional<std::int64_t> seen;
    while (!stopped.wait_for(lock, stop, kLookPeriod, [&] { return stop.stop_requested(); })) {
        const auto version = [this]() -> std::optional<std::int64_t> {
            const std::lock_guard writing(writer_mutex_);
            try {
                Rows rows = writer_.query("PRAGMA data_version");
                rows.next();
                return rows.integer(0);
            } catch (const Error&) {
                return std::nullopt;  // who needs the database next finds out
            }
        }();
        if (seen && version != seen) changes_.bump();
        seen = version;
    }
}

// Clouds.

Submitted SqliteJobStore::put_cloud(const CloudRow& row) {
    return write([&] {
        std::optional<std::string> statistics;
        if (row.statistics) statistics = to_json(*row.statistics);
        const std::int64_t added = writer_.run(
            "INSERT INTO clouds (tenant, id, name, format, bytes, created, used, statistics) "
            "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?6, ?7) ON CONFLICT DO NOTHING",
            row.tenant, row.id, row.name, to_string(row.format), row.bytes, now_ms(), statistics);
        if (added == 1) return Submitted::Created;
        note_use(row.tenant, row.id);
        if (row.name) {
            writer_.run("UPDATE clouds SET name = ?1 WHERE tenant = ?2 AND id = ?3", row.name,
                        row.tenant, row.id);
        }
        return Submitted::Existing;
    });
}

std::optional<CloudRow> SqliteJobStore::find_cloud(const std::string& tenant,
                                                   const std::string& id) {
    std::optional<CloudRow> cloud;
    bool is_noted = false;
    {
        const std::lock_guard lock(reader_mutex_);
        Rows rows = reader_.query(kFindCloud.c_str(), tenant, id);
        if (!rows.next()) return std::nullopt;
        cloud = cloud_of(rows);
        is_noted = rows.integer(kCloudUsedColumn) > now_ms() - kUsePeriodMs;
    }
    if (is_noted) return cloud;
    try {
        write([&] { return note_use(tenant, id), true; });
    } catch (const proto::StorageFull&) {  // it can be read all the same
    } catch (const StoreFault&) {
    }
    return cloud;
}

Page<CloudRow> SqliteJobStore::list_clouds(const std::string& tenant, unsigned limit,
                                           const std::optional<std::string>& cursor) {
    const std::int64_t below = first_row(kClouds, cursor);
    const std::lock_guard lock(reader_mutex_);
    Rows rows = reader_.query(kListClouds.c_str(), tenant, below, limit + 1);
    return read_page(rows, limit, kClouds, kCloudRowColumn, cloud_of);
}

void SqliteJobStore::note_use(const std::string& tenant, const std::string& cloud) {
    writer_.run("UPDATE clouds SET used = ?1 WHERE tenant = ?2 AND id = ?3", now_ms(), tenant,
                cloud);
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

Submission<JobDocument> SqliteJobStore::submit(const std::string& tenant,
                                               const proto::JobRequest& request,
                                               const std::optional<std::string>& idempotency_key,
                                               const QueueLimits& limits) {
    const std::string canonical = to_json(request);
    const std::string fingerprint = fingerprint_of(canonical);
    return write([&]() -> Submission<JobDocument> {
        if (idempotency_key) {
            if (const auto row = find_replayed(writer_, tenant, *idempotency_key, fingerprint))
                return {document(*row), true};
        }
        check_queue(tenant, limits);
        const std::int64_t row = insert_job(tenant, request, canonical);
        if (idempotency_key) {
            writer_.run(
                "INSERT INTO idempotency (tenant, key, fingerprint, job) VALUES (?1, ?2, ?3, ?4)",
                tenant, *idempotency_key, fingerprint, row);
        }
        return {document(row), false};
    });
}

void SqliteJobStore::check_queue(const std::string& tenant, const QueueLimits& limits) {
    Rows rows = writer_.query("SELECT count(*) FROM jobs WHERE tenant = ?1 AND status = 'accepted'",
                              tenant);
    rows.next();
    check_queued(rows.count(0), limits);
}

/// Whether a job of the tenant's made such a cloud. Its tiles and pictures are none that can be
/// read.
void SqliteJobStore::require_made_cloud(const std::string& tenant, const std::string& id,
                                        const std::string& field) {
    Rows made = writer_.query(
        "SELECT jobs.row FROM jobs JOIN outputs ON outputs.job = jobs.row "
        "WHERE tenant = ?1 AND sha256 = ?2 LIMIT 1",
        tenant, id);
    if (!made.next()) throw Error(ErrorCode::NotFound, field + " " + id + ": no such cloud");
    Rows level = writer_.query("SELECT body FROM levels WHERE job = ?1 AND instr(body, ?2) > 0",
                               made.integer(0), id);
    std::optional<CloudFormat> format;  // none of a picture
    if (level.next()) {
        const auto report = proto::job_report_from_json(level.text(0));
        for (const proto::OutputFile& file : std::get<proto::OutputCloud>(report).files)
            if (file.sha256 == id) format = file.format;
    }
    if (format == CloudFormat::Ply || format == CloudFormat::Draco ||
        format == CloudFormat::Progressive)
        return;
    throw Error(ErrorCode::UnsupportedFormat,
                field + " " + id + ": a " + (format ? std::string(to_string(*format)) : "png") +
                    " file that a job made: expected a cloud, or a result as ply, drc or stpc");
}

std::int64_t SqliteJobStore::insert_job(const std::string& tenant, const proto::JobRequest& request,
                                        const std::string& canonical) {
    const std::vector<std::string> inputs = proto::inputs_of(request);
    for (std::size_t i = 0; i < inputs.size(); ++i) {
        const std::string& id = inputs[i];
        Rows cloud =
            writer_.query("SELECT 1 FROM clouds WHERE tenant = ?1 AND id = ?2", tenant, id);
        if (!cloud.next()) require_made_cloud(tenant, id, proto::input_field(request, i));
        note_use(tenant, id);
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
    return document_of_row(writer_, row);
}

std::optional<JobDocument> SqliteJobStore::find_submitted(const std::string& tenant,
                                                          const proto::JobRequest& request,
                                                          const std::string& idempotency_key) {
    const std::string fingerprint = fingerprint_of(to_json(request));
    const std::lock_guard lock(reader_mutex_);
    const auto row = find_replayed(reader_, tenant, idempotency_key, fingerprint);
    if (!row) return std::nullopt;
    return document_of_row(reader_, *row);
}

std::optional<JobDocument> SqliteJobStore::find_job(const std::string& tenant,
                                                    const std::string& id) {
    const std::lock_guard lock(reader_mutex_);
    Rows rows = reader_.query(kFindJob.c_str(), tenant, id);
    if (!rows.next()) return std::nullopt;
    return document_of(rows);
}

Page<JobDocument> SqliteJobStore::list_jobs(const std::string& tenant, const JobFilter& filter,
                                            unsigned limit,
                                            const std::optional<std::string>& cursor) {
    const std::int64_t below = first_row(kJobs, cursor);
    const std::lock_guard lock(reader_mutex_);
    Rows rows = reader_.query(kListJobs.c_str(), tenant, below, filter.type, filter.status,
                              filter.input, limit + 1);
    return read_page(rows, limit, kJobs, kJobRowColumn, document_of);
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
        return dismissed(row);
    });
}

std::optional<JobDocument> SqliteJobStore::cancel(const std::string& tenant,
                                                  const std::string& id) {
    return write([&]() -> std::optional<JobDocument> {
        std::int64_t row = 0;
        {
            Rows rows = writer_.query(kFindJob.c_str(), tenant, id);
            if (!rows.next()) return std::nullopt;
            row = rows.integer(kJobRowColumn);
            const JobStatus status = document_of(rows).status;
            if (is_final(status)) {
                throw Error(ErrorCode::Conflict, "job " + id + " has ended already: it is " +
                                                     std::string(to_string(status)));
            }
        }
        return dismissed(row);
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
    for (std::size_t bytes = 0; bytes < kPageBytes && rows.next();
         bytes += events.back().data.size())
        events.push_back({rows.count(0), rows.text(1), rows.text(2)});
    return events;
}

std::optional<proto::Results> SqliteJobStore::results(const std::string& tenant,
                                                      const std::string& id) {
    std::string request, status;
    std::optional<std::string> source, cost;
    std::vector<std::string> levels;
    {
        const std::lock_guard lock(reader_mutex_);
        // One row per level, and one with nulls for a job without any: a single consistent read.
        Rows rows = reader_.query(
            "SELECT request, status, source, cost, body FROM jobs "
            "LEFT JOIN levels ON levels.job = jobs.row "
            "WHERE tenant = ?1 AND id = ?2 ORDER BY level",
            tenant, id);
        if (!rows.next()) return std::nullopt;
        request = rows.text(0);
        status = rows.text(1);
        source = rows.maybe_text(2);
        cost = rows.maybe_text(3);
        do {
            if (auto body = rows.maybe_text(4)) levels.push_back(*std::move(body));
        } while (rows.next());
    }
    // Levels of many tiles take a second to read: others do not wait for that.
    proto::Results results;
    results.request = proto::stored_request_from_json(request);
    results.complete = proto::job_status_from_name(status) == JobStatus::Successful;
    if (source) results.source = proto::cloud_statistics_from_json(*source);
    if (cost) results.cost = std::get<proto::JobCost>(proto::job_report_from_json(*cost));
    for (const std::string& level : levels)
        results.levels.push_back(std::get<proto::OutputCloud>(proto::job_report_from_json(level)));
    require_parents_first(results.levels);
    return results;
}

std::unique_ptr<JobStore> open_sqlite_job_store(const fs::path& file, Sharing sharing) {
    return std::make_unique<SqliteJobStore>(file, sharing);
}

}  // namespace stipple::server
