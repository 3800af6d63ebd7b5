#include "store/sqlite_schema.hpp"

#include "stipple/error.hpp"

#include <array>

namespace stipple::server::sqlite {

namespace {

// Times are milliseconds since 1970 in UTC. Documents of proto are kept in their JSON form.
constexpr const char* kFirstSchema = R"sql(
CREATE TABLE clouds (
    row        INTEGER PRIMARY KEY AUTOINCREMENT,
    tenant     TEXT NOT NULL,
    id         TEXT NOT NULL,
    format     TEXT NOT NULL,
    bytes      INTEGER NOT NULL,
    created    INTEGER NOT NULL,
    statistics TEXT,
    UNIQUE (tenant, id)
) STRICT;

CREATE TABLE jobs (
    row         INTEGER PRIMARY KEY AUTOINCREMENT,
    id          TEXT NOT NULL UNIQUE,
    tenant      TEXT NOT NULL,
    type        TEXT NOT NULL,
    input       TEXT NOT NULL,
    request     TEXT NOT NULL,
    status      TEXT NOT NULL DEFAULT 'accepted'
                CHECK (status IN ('accepted', 'running', 'successful', 'failed', 'dismissed')),
    stage       TEXT NOT NULL DEFAULT 'queued',
    message     TEXT NOT NULL,
    progress    REAL NOT NULL DEFAULT 0,
    told        INTEGER NOT NULL DEFAULT 0,  -- when progress was last written
    created     INTEGER NOT NULL,
    started     INTEGER,
    finished    INTEGER,
    updated     INTEGER NOT NULL,
    lease_token INTEGER NOT NULL DEFAULT 0,
    lease_until INTEGER NOT NULL DEFAULT 0,
    crashes     INTEGER NOT NULL DEFAULT 0,
    last_event  INTEGER NOT NULL DEFAULT 0,
    problem     TEXT,
    source      TEXT,
    cost        TEXT
) STRICT;
CREATE INDEX jobs_by_tenant ON jobs (tenant, row);
CREATE INDEX jobs_queued ON jobs (tenant, row) WHERE status = 'accepted';
CREATE INDEX jobs_running ON jobs (tenant, lease_until) WHERE status = 'running';
CREATE INDEX jobs_finished ON jobs (finished) WHERE finished IS NOT NULL;

CREATE TABLE levels (
    job   INTEGER NOT NULL REFERENCES jobs ON DELETE CASCADE,
    level INTEGER NOT NULL,
    body  TEXT NOT NULL,
    PRIMARY KEY (job, level)
) STRICT, WITHOUT ROWID;

CREATE TABLE outputs (
    job    INTEGER NOT NULL REFERENCES jobs ON DELETE CASCADE,
    sha256 TEXT NOT NULL,
    PRIMARY KEY (job, sha256)
) STRICT, WITHOUT ROWID;

CREATE TABLE events (
    job  INTEGER NOT NULL REFERENCES jobs ON DELETE CASCADE,
    id   INTEGER NOT NULL,
    type TEXT NOT NULL,
    data TEXT NOT NULL,
    PRIMARY KEY (job, id)
) STRICT, WITHOUT ROWID;

CREATE TABLE idempotency (
    tenant      TEXT NOT NULL,
    key         TEXT NOT NULL,
    fingerprint TEXT NOT NULL,
    job         INTEGER NOT NULL REFERENCES jobs ON DELETE CASCADE,
    PRIMARY KEY (tenant, key)
) STRICT, WITHOUT ROWID;
CREATE INDEX idempotency_by_job ON idempotency (job);
)sql";

constexpr const char* kNamesOfClouds = "ALTER TABLE clouds ADD COLUMN name TEXT";

/// The number by which SQLite tells whose a database is: `STPL`.
constexpr std::uint64_t kApplication = 0x5354504C;

constexpr const char* kCountsOfEnds = R"sql(
ALTER TABLE jobs ADD COLUMN lost INTEGER NOT NULL DEFAULT 0;  -- workers that were lost with it

CREATE TABLE ended (
    status TEXT PRIMARY KEY,
    jobs   INTEGER NOT NULL DEFAULT 0  -- that ever ended so, also those removed since
) STRICT, WITHOUT ROWID;
INSERT INTO ended (status) VALUES ('successful'), ('failed'), ('dismissed');
PRAGMA application_id = 0x5354504C;
)sql";

// Of clouds that are there already nobody knows: their time begins now.
constexpr const char* kUseOfClouds = R"sql(
ALTER TABLE clouds ADD COLUMN used INTEGER NOT NULL DEFAULT 0;  -- uploaded, or named by a new job
UPDATE clouds SET used = strftime('%s', 'now') * 1000;
CREATE INDEX clouds_by_use ON clouds (used);
)sql";

constexpr const char* kTurnsOfTenants = R"sql(
CREATE TABLE turns (
    tenant TEXT PRIMARY KEY,
    turn   INTEGER NOT NULL  -- grows with every job that is begun
) STRICT, WITHOUT ROWID;
)sql";

// Whether a job needs a cloud is asked for each that is removed.
constexpr const char* kUnfinishedJobs =
    "CREATE INDEX jobs_unfinished ON jobs (tenant) WHERE status IN ('accepted', 'running')";

/// Step n leads from schema n to n + 1. Steps that were released are never changed.
constexpr std::array kSteps = {kFirstSchema, kNamesOfClouds,  kCountsOfEnds,
                               kUseOfClouds, kTurnsOfTenants, kUnfinishedJobs};
/// The first schema of a database that says whose it is.
constexpr std::size_t kFirstNamed = 3;

std::uint64_t number_of(Connection& connection, const char* query) {
    Rows rows = connection.query(query);
    rows.next();
    return rows.count(0);
}

bool is_ours(Connection& connection, std::size_t schema) {
    const std::uint64_t application = number_of(connection, "PRAGMA application_id");
    if (application != 0) return application == kApplication;
    if (schema == 0) return number_of(connection, "SELECT count(*) FROM sqlite_schema") == 0;
    return schema < kFirstNamed &&
           number_of(connection,
                     "SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND "
                     "name IN ('clouds', 'jobs', 'idempotency')") == 3;
}

}  // namespace

std::size_t check_schema(Connection& connection) {
    const std::size_t present = number_of(connection, "PRAGMA user_version");
    if (!is_ours(connection, present)) {
        throw Error(ErrorCode::InvalidArgument,
                    connection.file() +
                        ": it is a database of another program: expected one of "
                        "stippled, or none: give another folder");
    }
    if (present > kSteps.size()) {
        throw Error(ErrorCode::InvalidArgument,
                    connection.file() + " has schema " + std::to_string(present) +
                        ", this program knows schemas up to " + std::to_string(kSteps.size()) +
                        ": start the version that wrote it, or a newer one");
    }
    return present;
}

void migrate(Connection& connection) {
    // Before the look at what is there: another process may start on the same file.
    Transaction transaction(connection);
    for (std::size_t step = check_schema(connection); step < kSteps.size(); ++step) {
        connection.script(kSteps[step]);
        connection.script("PRAGMA user_version = " + std::to_string(step + 1));
    }
    transaction.commit();
}

}  // namespace stipple::server::sqlite
