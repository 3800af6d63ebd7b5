#include "stipple/proto/problem.hpp"

#include "json_parts.hpp"
#include "stipple/proto/job_request.hpp"

#include <algorithm>
#include <array>

namespace stipple::proto {

namespace {

/// One row of the closed list of problem types.
struct Kind {
    int status;
    std::string_view code;  ///< the last part of the type
    std::string_view title;
    ErrorCode error;  ///< what a client throws
};

constexpr std::array kKinds = {
    Kind{400, "invalid-argument", "Invalid argument", ErrorCode::InvalidArgument},
    Kind{401, "unauthorized", "Unauthorized", ErrorCode::InvalidArgument},
    Kind{403, "forbidden", "Forbidden", ErrorCode::InvalidArgument},
    Kind{404, "not-found", "Not found", ErrorCode::NotFound},
    Kind{405, "method-not-allowed", "Method not allowed", ErrorCode::InvalidArgument},
    Kind{406, "not-acceptable", "Not acceptable", ErrorCode::UnsupportedFormat},
    Kind{408, "request-timeout", "Request timeout", ErrorCode::QueueFull},
    Kind{409, "conflict", "Conflict", ErrorCode::Conflict},
    Kind{411, "length-required", "Length required", ErrorCode::InvalidArgument},
    Kind{413, "too-large", "Too large", ErrorCode::TooLarge},
    Kind{414, "uri-too-long", "URI too long", ErrorCode::InvalidArgument},
    Kind{415, "unsupported-format", "Unsupported format", ErrorCode::UnsupportedFormat},
    Kind{416, "range-not-satisfiable", "Range not satisfiable", ErrorCode::InvalidArgument},
    Kind{417, "expectation-failed", "Expectation failed", ErrorCode::InvalidArgument},
    Kind{421, "misdirected", "Misdirected request", ErrorCode::InvalidArgument},
    Kind{422, "malformed-input", "Malformed input", ErrorCode::MalformedInput},
    Kind{429, "queue-full", "Queue full", ErrorCode::QueueFull},
    Kind{431, "head-too-large", "Head too large", ErrorCode::InvalidArgument},
    Kind{500, "internal", "Internal error", ErrorCode::Internal},
    Kind{501, "not-implemented", "Not implemented", ErrorCode::InvalidArgument},
    Kind{503, "unavailable", "Unavailable", ErrorCode::QueueFull},
    Kind{505, "version-not-supported", "HTTP version not supported", ErrorCode::InvalidArgument},
    Kind{kStorageFullStatus, "storage-full", "Storage full", ErrorCode::Internal},
};

const Kind& kind_of_status(int status) noexcept {
    const auto found = std::ranges::find(kKinds, status, &Kind::status);
    if (found != kKinds.end()) return *found;
    return *std::ranges::find(kKinds, status < 500 ? 400 : 500, &Kind::status);
}

Problem problem_of(const Kind& kind, int status, std::string detail) {
    return {.type = kProblemBase + std::string(kind.code),
            .title = std::string(kind.title),
            .status = status,
            .detail = std::move(detail),
            .stage = {},
            .retry_after = {},
            .candidate = {}};
}

/// Whether the same request may succeed later.
bool is_retryable(const Problem& problem) noexcept {
    return problem.retry_after || problem.status == 408 || problem.status == 429 ||
           problem.status == 503 || problem.status == kStorageFullStatus;
}

}  // namespace

Problem problem_from(ErrorCode code, std::string detail) {
    const Kind& kind = *std::ranges::find(kKinds, to_string(code), &Kind::code);
    return problem_of(kind, kind.status, std::move(detail));
}

Problem problem_from(const Error& error) {
    if (dynamic_cast<const StorageFull*>(&error) != nullptr)
        return problem_from_status(kStorageFullStatus, error.what());
    Problem problem = problem_from(error.code(), error.what());
    if (const auto* const about = dynamic_cast<const CandidateError*>(&error))
        problem.candidate = about->number();
    return problem;
}

Problem problem_from_status(int status, std::string detail) {
    return problem_of(kind_of_status(status), status, std::move(detail));
}

Error error_from(const Problem& problem) {
    const auto by_type = std::ranges::find_if(kKinds, [&problem](const Kind& kind) {
        return problem.type == kProblemBase + std::string(kind.code);
    });
    const Kind& kind = by_type != kKinds.end() ? *by_type : kind_of_status(problem.status);
    return Error(kind.error, problem.detail.empty() ? problem.title : problem.detail);
}

Json problem_json(const Problem& problem) {
    Json json = {{"type", problem.type},
                 {"title", problem.title},
                 {"status", problem.status},
                 {"detail", problem.detail}};
    if (problem.stage) json["stage"] = *problem.stage;
    if (problem.candidate) json["candidate"] = *problem.candidate;
    json["retryable"] = is_retryable(problem);
    if (problem.retry_after) json["retry_after"] = *problem.retry_after;
    return json;
}

Problem read_problem(const JsonValue& value) {
    JsonObject object = value.object();
    Problem problem;
    problem.type = object["type"].text();
    problem.title = object["title"].text();
    problem.status = static_cast<int>(object["status"].integer(100, 599));
    problem.detail = object["detail"].text();
    if (const auto stage = object.find("stage")) problem.stage = stage->text();
    if (const auto number = object.find("candidate"))
        problem.candidate = number->small_integer(1, kMostCandidates);
    object["retryable"].boolean();  // follows from the status and `retry_after`
    if (const auto seconds = object.find("retry_after")) problem.retry_after = seconds->number();
    object.finish();
    return problem;
}

std::string to_json(const Problem& problem) {
    return to_text(problem_json(problem));
}

Problem problem_from_json(std::string_view json) {
    return read_problem(JsonDocument(json, {}).root());
}

}  // namespace stipple::proto
