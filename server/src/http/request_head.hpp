#pragma once

#include "http/message.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace stipple::server::http {

/// What a head may be at most.
inline constexpr std::size_t kMaxHeadBytes = 64 * 1024;
inline constexpr std::size_t kMaxHeaderFields = 100;
inline constexpr std::size_t kMaxTargetBytes = 4 * 1024;

/// The head of a request, read strictly: what two readers could understand in two ways is refused,
/// for a proxy before us may be the other reader.
struct RequestHead {
    std::string method;
    std::string target;  ///< as it came: begins with a slash, printable ASCII
    bool http_1_0 = false;
    Headers headers;
    std::optional<std::uint64_t> content_length;
    bool chunked = false;
    bool expects_continue = false;
    bool wants_close = false;  ///< no further request on this connection

    bool has_body() const noexcept { return chunked || content_length.value_or(0) > 0; }
};

/// @param text  from the request line up to and without the empty line.
/// @throws HttpError: 400, 411, 414, 415, 417, 431, 501, 505, saying what was wrong.
RequestHead parse_head(std::string_view text);

/// The `X-Request-Id` of a head that may be refused; empty when there is none.
std::string_view given_id(std::string_view text);

/// Refuses a head that is too large before its end has come. @throws HttpError(414, 431).
void check_head_size(std::string_view so_far);

}  // namespace stipple::server::http
