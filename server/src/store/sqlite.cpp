#include "store/sqlite.hpp"

#include "stipple/error.hpp"

#include <cassert>

namespace stipple::server::sqlite {

namespace {

[[noreturn]] void throw_failure(sqlite3* connection) {
    const bool full = sqlite3_errcode(connection) == SQLITE_FULL;
    throw Error(ErrorCode::Internal, std::string(full ? "storage full: " : "") +
                                         "database: " + sqlite3_errmsg(connection));
}

}  // namespace

Rows::~Rows() {
    sqlite3_reset(statement_);
    sqlite3_clear_bindings(statement_);
}

bool Rows::next() {
    const int result = sqlite3_step(statement_);
    if (result == SQLITE_ROW) return true;
    if (result != SQLITE_DONE) throw_failure(connection_);
    return false;
}

std::string Rows::text(int column) const {
    const auto* bytes = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
    const auto size = static_cast<std::size_t>(sqlite3_column_bytes(statement_, column));
    return bytes ? std::string(bytes, size) : std::string();
}

std::optional<std::string> Rows::maybe_text(int column) const {
    if (is_null(column)) return std::nullopt;
    return text(column);
}

Connection::Connection(const std::filesystem::path& file) {
    sqlite3* connection = nullptr;
    // The caller's mutex guards the connection, so SQLite needs none of its own.
    const int result =
        sqlite3_open_v2(file.c_str(), &connection,
                        SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, nullptr);
    connection_.reset(connection);
    if (result != SQLITE_OK) {
        throw Error(ErrorCode::Internal,
                    "cannot open " + file.string() + ": " +
                        (connection ? sqlite3_errmsg(connection) : sqlite3_errstr(result)));
    }
    sqlite3_busy_timeout(connection, 10'000);
}

void Connection::script(const std::string& sql) {
    if (sqlite3_exec(connection_.get(), sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK) {
        throw_failure(connection_.get());
    }
}

sqlite3_stmt* Connection::prepared(const char* sql) {
    auto& statement = statements_[sql];
    if (!statement) {
        sqlite3_stmt* fresh = nullptr;
        if (sqlite3_prepare_v3(connection_.get(), sql, -1, SQLITE_PREPARE_PERSISTENT, &fresh,
                               nullptr) != SQLITE_OK) {
            throw_failure(connection_.get());
        }
        statement.reset(fresh);
    }
    assert(sqlite3_stmt_busy(statement.get()) == 0 && "the same statement inside its own loop");
    return statement.get();
}

Transaction::~Transaction() {
    if (!open_) return;
    try {
        connection_.run("ROLLBACK");
    } catch (const Error&) {
        // SQLite has rolled back by itself, as it does when the disk is full.
    }
}

void Transaction::commit() {
    connection_.run("COMMIT");
    open_ = false;
}

}  // namespace stipple::server::sqlite
