#pragma once

#include "stipple/error.hpp"

#include <optional>
#include <string>

namespace stipple::proto {

/// An RFC 9457 problem document: `application/problem+json`.
///
///     {"type": "https://stipple.dev/problems/malformed-input", "title": "Malformed input", "status": 422,
///      "detail": "line 7: property without a name", "stage": "decode", "retryable": false}
struct Problem {
    std::string type;    ///< one of the closed list in openapi.yaml: kProblemBase + a code in kebab-case
    std::string title;   ///< the same for every problem of this type
    int status = 500;    ///< the HTTP status
    std::string detail;  ///< one sentence: what was wrong, the value, the limit, the remedy
    std::optional<std::string> stage;   ///< for a failed job: one of `kJobStages`
    std::optional<double> retry_after;  ///< seconds until it may be tried again
    std::optional<unsigned> candidate{};  ///< for a failed evaluation: the number of the candidate
                                          ///< concerned, from 1
};

/// The disk that something was to be written to is full, or the quota on it used up.
class StorageFull : public Error {
public:
    explicit StorageFull(const std::string& message) : Error(ErrorCode::Internal, "storage full: " + message) {}
};

/// A failure of an evaluation that concerns one of the candidates.
class CandidateError : public Error {
public:
    /// @param number  from 1, in the order of the request.
    CandidateError(unsigned number, const Error& cause) : Error(cause), number_(number) {}
    unsigned number() const noexcept { return number_; }

private:
    unsigned number_;
};

inline constexpr int kStorageFullStatus = 507;
inline constexpr const char* kProblemBase = "https://stipple.dev/problems/";

/// The problem for an error: type, title and status by its code. 400 invalid-argument, 422
/// malformed-input, 415 unsupported-format, 413 too-large, 404 not-found, 409 conflict, 429
/// queue-full, 500 internal.
Problem problem_from(ErrorCode code, std::string detail);
/// The same of an error that was caught; 507 storage-full for `StorageFull`.
Problem problem_from(const Error& error);
/// The problem for an HTTP status without an `Error` (401 unauthorized, 403 forbidden, 405
/// method-not-allowed, 408 request-timeout, 411 length-required, 416 range-not-satisfiable, 431
/// head-too-large, 503 unavailable, 507 storage-full ...).
Problem problem_from_status(int status, std::string detail);
/// The error for a problem, for clients that throw.
Error error_from(const Problem& problem);

std::string to_json(const Problem& problem);
/// @throws Error(MalformedInput) naming the field.
Problem problem_from_json(std::string_view json);

}  // namespace stipple::proto
