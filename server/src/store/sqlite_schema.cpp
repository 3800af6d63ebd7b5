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

/// Step n leads from schema n to n + 1. Steps that were released are never changed.
constexpr std::array kSteps = {kFirstSchema, kNamesOfClouds};

std::size_t schema_version(Connection& connection) {
    Rows rows = connection.query("PRAGMA user_version");
    rows.next();
    return rows.count(0);
}

}  // namespace

void migrate(Connection& connection) {
    const std::size_t present = schema_version(connection);
    if (present > kSteps.size()) {
        throw Error(ErrorCode::Internal, "the database has schema " + std::to_string(present) +
                                             ", this program knows schemas up to " +
                                             std::to_string(kSteps.size()) +
                                             ": start the version that wrote it, or a newer one");
    }
    for (std::size_t step = present; step < kSteps.size(); ++step) {
        Transaction transaction(connection);
        connection.script(kSteps[step]);
        connection.script("PRAGMA user_version = " + std::to_string(step + 1));
        transaction.commit();
    }
}

}  // namespace stipple::server::sqlite
