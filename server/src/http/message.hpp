#pragma once

#include "stipple/proto/problem.hpp"
#include "store/blob_store.hpp"

#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace stipple::server::http {

/// Header fields in the order they came; names are told apart without regard to case.
class Headers {
public:
    void add(std::string name, std::string value);
    /// Replaces every field of this name.
    void set(std::string_view name, std::string value);
    void remove(std::string_view name);
    /// The value of the first field of this name.
    std::optional<std::string_view> find(std::string_view name) const noexcept;
    /// A list that may stand on several lines (RFC 9110, 5.3): the values of all fields of this
    /// name, with commas between them.
    std::optional<std::string> joined(std::string_view name) const;
    std::size_t count(std::string_view name) const noexcept;
    std::size_t size() const noexcept { return fields_.size(); }
    auto begin() const noexcept { return fields_.begin(); }
    auto end() const noexcept { return fields_.end(); }

private:
    std::vector<std::pair<std::string, std::string>> fields_;
};

bool equal_ignoring_case(std::string_view a, std::string_view b) noexcept;
std::string_view trimmed(std::string_view text) noexcept;  ///< without spaces and tabs around it

/// A reply that is a problem: thrown from anywhere below a handler.
class HttpError : public std::exception {
public:
    explicit HttpError(proto::Problem the_problem, Headers the_headers = {})
        : problem(std::move(the_problem)), headers(std::move(the_headers)) {}
    HttpError(int status, std::string detail)
        : problem(proto::problem_from_status(status, std::move(detail))) {}
    const char* what() const noexcept override { return problem.detail.c_str(); }

    proto::Problem problem;
    Headers headers;
};

/// The client has gone, or is too slow to be served: no reply can reach it.
class Disconnected : public std::exception {
public:
    const char* what() const noexcept override { return "the client has gone"; }
};

/// The body of a request, read from the connection as it is asked for. A client that waits for `100
/// Continue` is told to go on with the first read, so that a request refused before it sends
/// nothing in vain.
class RequestBody {
public:
    virtual ~RequestBody() = default;
    /// Whether the head announced a body (of a length, or chunked).
    virtual bool announced() const noexcept = 0;
    /// As announced by `Content-Length`.
    virtual std::optional<std::uint64_t> length() const noexcept = 0;
    /// Fills `out` from the front; 0 at the end of the body. @throws HttpError (400, 408),
    /// Disconnected.
    virtual std::size_t read(std::span<std::byte> out) = 0;
};

/// The whole body. @throws HttpError(413) above `max_bytes`.
std::string read_all(RequestBody& body, std::size_t max_bytes);

struct Request {
    std::string method;
    std::string path;  ///< percent-decoded, without the query
    std::map<std::string, std::string, std::less<>> query;
    std::optional<std::string> repeated_query;  ///< a parameter that came twice
    std::string query_text;                     ///< as it came, with its `?`; empty without
    Headers headers;
    RequestBody* body = nullptr;
    std::string remote_address;
    std::string_view version;           ///< HTTP/1.1 or HTTP/1.0
    std::stop_token stop;               ///< requested when the server begins to stop: no waiting
    std::function<bool()> client_gone;  ///< whether no reply can reach it; cheap

    // Filled by the application.
    std::string path_prefix;  ///< of paths in replies; `path` is without it
    std::string id;           ///< of this request, in every log line and in the reply
    std::string tenant;       ///< whose things are seen
    std::size_t tenants = 1;  ///< how many there are now
    std::string_view route;   ///< template of the path: `/v1/jobs/{id}`; empty when there is none
    std::map<std::string, std::string, std::less<>> path_values;

    const std::string& path_value(std::string_view name) const {
        return path_values.find(name)->second;
    }
    std::optional<std::string> query_value(std::string_view name) const;
};

/// Bytes of a stored file, in memory or not, from `offset` on.
struct StoredRange {
    std::variant<std::shared_ptr<const std::vector<std::byte>>, std::shared_ptr<const BlobReader>>
        content;
    std::uint64_t offset = 0, length = 0;
};
/// Bytes that live as long as the program.
using FixedBytes = std::span<const std::byte>;
/// Writes a stream piece by piece until it returns.
using StreamWriter = std::function<void(std::string_view piece)>;  ///< @throws Disconnected
using Stream = std::function<void(const StreamWriter& write)>;
struct SizedStream {
    Stream write;
    std::uint64_t length = 0;  ///< what it writes, neither more nor less
};

/// The caller's own id when it can stand in a log, else one that no other request has.
std::string request_id(std::string_view given);

struct Reply {
    int status = 200;
    Headers headers;
    std::string media_type;
    std::variant<std::string, FixedBytes, StoredRange, Stream, SizedStream> content;
    std::shared_ptr<void>
        permit;  ///< given back when the reply was sent: a place among those that may take long
};

Reply json_reply(int status, std::string json);
Reply problem_reply(const HttpError& error);

}  // namespace stipple::server::http
