#pragma once

#include <exception>
#include <stdexcept>
#include <string>
#include <string_view>

namespace stipple {

/// What kind of failure it was. The same eight, in kebab-case, are the problem types of
/// `openapi.yaml`.
enum class ErrorCode {
    InvalidArgument,    ///< an option is out of range: change the request
    MalformedInput,     ///< the bytes violate their format: repair the file
    UnsupportedFormat,  ///< perhaps well-formed, but not supported
    TooLarge,           ///< over a limit: the message gives the limit, the value and the remedy
    NotFound,           ///< does not exist, or belongs to someone else
    Conflict,           ///< conflicts with existing state
    QueueFull,          ///< try again later
    Internal,           ///< a bug or failure on our side
};

/// `invalid-argument`, `malformed-input`, ...: the name on the wire.
std::string_view to_string(ErrorCode code) noexcept;

/// Every failure reported to a caller. The message is one sentence that says what was wrong, with
/// the value, the limit and, if there is one, the remedy: `points 0: expected 1..435545`.
class Error : public std::runtime_error {
public:
    Error(ErrorCode code, const std::string& message) : std::runtime_error(message), code_(code) {}
    ErrorCode code() const noexcept { return code_; }

private:
    ErrorCode code_;
};

/// Thrown out of a computation whose `RunContext` was asked to stop. Not an error: no result
/// exists.
class Cancelled : public std::exception {
public:
    const char* what() const noexcept override { return "cancelled"; }
};

}  // namespace stipple
