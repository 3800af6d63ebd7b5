#pragma once

#include <sqlite3.h>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

namespace stipple::server::sqlite {

/// The rows of a statement, one at a time. Its connection keeps the prepared statement for the next
/// time.
class Rows {
public:
    Rows(sqlite3* connection, sqlite3_stmt* statement) noexcept
        : connection_(connection), statement_(statement) {}
    Rows(const Rows&) = delete;
    Rows& operator=(const Rows&) = delete;
    ~Rows();

    /// Moves to the next row; false after the last.
    bool next();

    std::int64_t integer(int column) const { return sqlite3_column_int64(statement_, column); }
    std::uint64_t count(int column) const { return static_cast<std::uint64_t>(integer(column)); }
    double real(int column) const { return sqlite3_column_double(statement_, column); }
    bool is_null(int column) const {
        return sqlite3_column_type(statement_, column) == SQLITE_NULL;
    }
    std::string text(int column) const;
    /// Of all texts of the row.
    std::size_t text_bytes() const;
    std::optional<std::string> maybe_text(int column) const;

private:
    sqlite3* connection_;
    sqlite3_stmt* statement_;
};

/// Read: of a file that no process writes to. Nothing is changed or made.
enum class Access { Write, Read };

/// A connection, for one thread at a time. All failures are Error(Internal) with the name of the
/// file; proto::StorageFull when the disk is, StoreFault when another process holds it or the
/// system refuses.
class Connection {
public:
    explicit Connection(const std::filesystem::path& file, Access access = Access::Write);

    std::string file() const;

    /// `sql` is a literal: its prepared statement is kept. Values are bound to ?1, ?2, ... in
    /// order.
    template <typename... Values>
    Rows query(const char* sql, const Values&... values) {
        return Rows(connection_.get(), bound(sql, values...));
    }

    /// Runs a statement without rows; returns how many rows it changed.
    template <typename... Values>
    std::int64_t run(const char* sql, const Values&... values) {
        Rows rows(connection_.get(), bound(sql, values...));
        while (rows.next()) {
        }
        return sqlite3_changes64(connection_.get());
    }

    /// Runs statements that are not kept, separated by semicolons.
    void script(const std::string& sql);
    /// The same. @return whether no other connection was in the way of what SQLite does not wait
    /// for.
    bool try_script(const std::string& sql);

    /// Rows ever changed over this connection.
    std::int64_t total_changes() const { return sqlite3_total_changes64(connection_.get()); }
    std::int64_t last_row() const { return sqlite3_last_insert_rowid(connection_.get()); }

private:
    template <typename... Values>
    sqlite3_stmt* bound(const char* sql, const Values&... values) {
        sqlite3_stmt* statement = prepared(sql);
        int parameter = 0;
        (bind(statement, ++parameter, values), ...);
        return statement;
    }

    template <typename Value>
    void bind(sqlite3_stmt* statement, int parameter, const Value& value) {
        if constexpr (std::is_integral_v<Value>) {
            sqlite3_bind_int64(statement, parameter, static_cast<std::int64_t>(value));
        } else if constexpr (std::is_floating_point_v<Value>) {
            sqlite3_bind_double(statement, parameter, value);
        } else if constexpr (std::is_convertible_v<Value, std::string_view>) {
            const std::string_view text = value;
            sqlite3_bind_text64(statement, parameter, text.data(), text.size(), SQLITE_TRANSIENT,
                                SQLITE_UTF8);
        } else if (value) {
            bind(statement, parameter, *value);
        } else {
            sqlite3_bind_null(statement, parameter);
        }
    }

    sqlite3_stmt* prepared(const char* sql);

    struct Close {
        void operator()(sqlite3* connection) const noexcept { sqlite3_close_v2(connection); }
        void operator()(sqlite3_stmt* statement) const noexcept { sqlite3_finalize(statement); }
    };
    std::unique_ptr<sqlite3, Close> connection_;
    std::map<const char*, std::unique_ptr<sqlite3_stmt, Close>> statements_;
};

/// All or nothing: undone unless committed. Takes the right to write at once, so it never fails
/// half-way for another writer.
class Transaction {
public:
    explicit Transaction(Connection& connection) : connection_(connection) {
        connection_.run("BEGIN IMMEDIATE");
    }
    Transaction(const Transaction&) = delete;
    Transaction& operator=(const Transaction&) = delete;
    ~Transaction();
    void commit();

private:
    Connection& connection_;
    bool open_ = true;
};

}  // namespace stipple::server::sqlite
