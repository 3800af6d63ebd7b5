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
    MalformedInput,     ///< the bytes are not what their format promises: mend the file
    UnsupportedFormat,  ///< well-formed perhaps, but nothing here reads it
    TooLarge,           ///< over a limit: the message names limit, value and remedy
    NotFound,           ///< no such thing, or not yours
    Conflict,           ///< clashes with what is there already
    QueueFull,          ///< try again later
    Internal,           ///< our fault
};

/// `invalid-argument`, `malformed-input`, ...: the name on the wire.
std::string_view to_string(ErrorCode code) noexcept;

/// Every failure that a caller can be told about. The message is one sentence that says what was
/// wrong, with the value, the limit and, where there is one, the remedy: `points 0:
/// expected 1..435545`.
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
