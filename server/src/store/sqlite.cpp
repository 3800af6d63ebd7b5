#include "store/sqlite.hpp"

#include "store/store_fault.hpp"

#include "stipple/proto/problem.hpp"

#include <cassert>
#include <cerrno>
#include <system_error>

namespace stipple::server::sqlite {

namespace {

std::string file_of(sqlite3* connection) {
    const char* const file = sqlite3_db_filename(connection, "main");
    return file == nullptr ? std::string() : file;
}

[[noreturn]] void throw_failure(sqlite3* connection) {
    constexpr int kPrimary = 0xFF;
    const int code = sqlite3_errcode(connection) & kPrimary;
    // What the system said, where it was asked: SQLite's own text does not have it.
    const bool asked = code == SQLITE_IOERR || code == SQLITE_CANTOPEN;
    const int cause = asked ? sqlite3_system_errno(connection) : 0;
    const bool full = code == SQLITE_FULL || cause == ENOSPC || cause == EDQUOT;
    std::string text = "database " + file_of(connection) + ": " + sqlite3_errmsg(connection);
    if (cause != 0) text += ": " + std::generic_category().message(cause);
    if (full) throw proto::StorageFull(text);
    if (code == SQLITE_BUSY || code == SQLITE_READONLY || cause != 0) throw StoreFault(text);
    throw Error(ErrorCode::Internal, text);
}

/// As a URI, in which a read-only file can be said to have no writer: then SQLite needs no files
/// beside it. A log with changes, as a killed server leaves it, has to be read all the same.
std::string address_to_read(const std::filesystem::path& file) {
    std::string address = "file:";
    for (const char c : std::filesystem::absolute(file).string()) {
        if (c == '%' || c == '?' || c == '#') {
            constexpr std::string_view kDigits = "0123456789ABCDEF";
            const auto byte = static_cast<unsigned char>(c);
            address += {'%', kDigits[byte >> 4U], kDigits[byte & 15U]};
        } else {
            address += c;
        }
    }
    std::error_code missing;
    const auto log = std::filesystem::file_size(file.string() + "-wal", missing);
    return address + (!missing && log > 0 ? "?mode=ro" : "?mode=ro&immutable=1");
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

std::size_t Rows::text_bytes() const {
    std::size_t bytes = 0;
    for (int column = 0; column < sqlite3_data_count(statement_); ++column)
        if (sqlite3_column_type(statement_, column) == SQLITE_TEXT)  // the size of a number is none
            bytes += static_cast<std::size_t>(sqlite3_column_bytes(statement_, column));
    return bytes;
}

std::optional<std::string> Rows::maybe_text(int column) const {
    if (is_null(column)) return std::nullopt;
    return text(column);
}

Connection::Connection(const std::filesystem::path& file, Access access) {
    sqlite3* connection = nullptr;
    // The caller's mutex guards the connection, so SQLite needs none of its own.
    const bool reading = access == Access::Read;
    const int flags = reading ? SQLITE_OPEN_READONLY | SQLITE_OPEN_URI
                              : SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE;
    const std::string name = reading ? address_to_read(file) : file.string();
    const int result =
        sqlite3_open_v2(name.c_str(), &connection, flags | SQLITE_OPEN_NOMUTEX, nullptr);
    connection_.reset(connection);
    if (result != SQLITE_OK) {
        std::string text = "cannot open " + file.string() + ": " +
                           (connection ? sqlite3_errmsg(connection) : sqlite3_errstr(result));
        if (const int cause = connection ? sqlite3_system_errno(connection) : 0; cause != 0)
            text += ": " + std::generic_category().message(cause);
        throw Error(ErrorCode::Internal, text);
    }
    // SQLite makes do with reading where the system refuses to let it write.
    if (!reading && sqlite3_db_readonly(connection, "main") == 1)
        throw StoreFault("cannot write " + file.string() +
                         ": it may only be read: give it, with all of its folder, to the user that "
                         "runs the server, and mount its disk for writing");
    sqlite3_busy_timeout(connection, 10'000);
}

std::string Connection::file() const {
    return file_of(connection_.get());
}

void Connection::script(const std::string& sql) {
    if (!try_script(sql)) throw_failure(connection_.get());
}

bool Connection::try_script(const std::string& sql) {
    const int result = sqlite3_exec(connection_.get(), sql.c_str(), nullptr, nullptr, nullptr);
    if (result == SQLITE_BUSY) return false;
    if (result != SQLITE_OK) throw_failure(connection_.get());
    return true;
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
