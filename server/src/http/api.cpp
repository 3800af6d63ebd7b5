#include "http/api.hpp"

#include "log_text.hpp"
#include "store/store_fault.hpp"

#include <spdlog/spdlog.h>
#include <algorithm>

namespace stipple::server::http {

namespace {

constexpr double kRetrySeconds = 5;
constexpr const char* kExposed =
    "ETag, Location, Link, Retry-After, Content-Length, Content-Range, Content-Encoding, "
    "X-Request-Id, Stipple-Points, Stipple-Level, Stipple-Error-Mean, Stipple-Error-Max, "
    "Stipple-Origin";

/// `example.org:8080` of `https://example.org:8080`.
std::string_view authority_of(std::string_view origin) noexcept {
    const auto scheme = origin.find("://");
    return scheme == origin.npos ? origin : origin.substr(scheme + 3);
}

/// `example.org` of `example.org:8080`.
std::string_view name_in(std::string_view host) noexcept {
    return host.starts_with('[') ? host : host.substr(0, host.find(':'));
}

/// Whether the name is one that somebody can own: neither an address nor `localhost` nor without a
/// dot.
bool is_domain(std::string_view name) noexcept {
    constexpr std::string_view kLocal = ".localhost";
    const auto is_of_address = [](char c) { return (c >= '0' && c <= '9') || c == '.'; };
    if (name.starts_with('[') || name.find('.') == name.npos) return false;
    if (name.size() > kLocal.size() &&
        equal_ignoring_case(name.substr(name.size() - kLocal.size()), kLocal))
        return false;
    return !std::ranges::all_of(name, is_of_address);
}

HttpError unauthorized(const char* why) {
    Headers headers;
    headers.add("WWW-Authenticate", "Bearer");
    return HttpError(proto::problem_from_status(401, why), std::move(headers));
}

Reply error_reply(const Error& error, const Request& request) {
    const std::string detail = error.what();
    if (error.code() == ErrorCode::Internal) {
        spdlog::error("request.failed id={} route={} reason={}", request.id, request.route,
                      log_text(detail));
        if (dynamic_cast<const proto::StorageFull*>(&error) != nullptr) {
            return problem_reply(HttpError(proto::kStorageFullStatus,
                                           "the server's disk is full: nothing was stored or "
                                           "removed; try again when its operator has freed space"));
        }
        if (dynamic_cast<const StoreFault*>(&error) != nullptr) {
            proto::Problem fault = proto::problem_from_status(
                503,
                "the server's store does not answer: try again later; its log says why, under "
                "request " +
                    request.id);
            fault.retry_after = kRetrySeconds;
            return problem_reply(HttpError(std::move(fault)));
        }
        return problem_reply(
            HttpError(500, "the server failed; its log says why, under request " + request.id));
    }
    proto::Problem problem = proto::problem_from(error.code(), detail);
    if (error.code() == ErrorCode::QueueFull) problem.retry_after = kRetrySeconds;
    return problem_reply(HttpError(std::move(problem)));
}

}  // namespace

Reply failure_reply(std::exception_ptr failure, const Request& request) {
    try {
        std::rethrow_exception(failure);
    } catch (const HttpError& error) {
        return problem_reply(error);
    } catch (const Error& error) {
        return error_reply(error, request);
    } catch (const Disconnected&) {
        throw;
    } catch (const std::exception& error) {
        return error_reply(Error(ErrorCode::Internal, error.what()), request);
    }
}

Api::Api(ApiOptions options, Service& service, Metrics& metrics)
    : options_(std::move(options)),
      resources_(service, options_.keys != nullptr,
                 {.connections = options_.max_connections,
                  .of_address = options_.max_connections_per_address}),
      metrics_(metrics) {}

Reply Api::handle(Request& request) {
    request.id = request_id(request.headers.find("X-Request-Id").value_or(""));
    take_prefix(request);
    Reply reply;
    try {
        reply = answer(request);
    } catch (...) {
        reply = failure_reply(std::current_exception(), request);
        const RouteMatch match = find_route(request.method, request.path);
        if (match.same_path != nullptr) share(*match.same_path, request, reply);
    }
    reply.headers.set("X-Request-Id", request.id);
    return reply;
}

/// What no route takes.
void refuse_bodies_of_other_kinds(const Request& request) {
    const auto coding = request.headers.find("Content-Encoding").value_or("identity");
    if (!equal_ignoring_case(coding, "identity"))
        throw HttpError(415, "Content-Encoding is not supported: send the bytes unpacked");
    const auto type = request.headers.find("Content-Type").value_or("");
    if (equal_ignoring_case(type.substr(0, 10), "multipart/"))
        throw HttpError(415,
                        "a multipart form is not supported: send the file itself as the body, as "
                        "`curl --data-binary @FILE` does");
}

/// A proxy may leave the prefix where it is or take it away.
void Api::take_prefix(Request& request) const {
    const std::string& prefix = resources_.service.links().prefix();
    if (prefix.empty()) return;
    request.path_prefix = prefix;
    if (request.path.starts_with(prefix + '/')) request.path.erase(0, prefix.size());
}

Reply Api::answer(Request& request) {
    // What the page names lies below its address, which must end with a slash.
    if (!request.path_prefix.empty() && request.path == request.path_prefix) {
        Reply reply;
        reply.status = 308;
        reply.headers.set("Location", request.path_prefix + "/" + request.query_text);
        return reply;
    }
    RouteMatch match = find_route(request.method, request.path);
    if (match.same_path == nullptr) throw HttpError(404, "no such path: /docs lists all paths");
    request.route = match.same_path->path;
    if (request.method == "OPTIONS") return preflight(match, request);
    if (match.route == nullptr) {
        Headers headers;
        headers.add("Allow", match.allow);
        throw HttpError(
            proto::problem_from_status(405, request.method + ": this path allows " + match.allow),
            std::move(headers));
    }
    refuse_bodies_of_other_kinds(request);
    refuse_foreign_names(request);
    authorize(*match.route, request);
    refuse_foreign_sites(*match.route, request);
    request.path_values = std::move(match.values);
    Reply reply = match.route->handle(resources_, request);
    share(*match.route, request, reply);
    return reply;
}

/// The owner of a domain can have it lead a browser here, to which the pages of that domain and
/// this server are one site then (DNS rebinding).
void Api::refuse_foreign_names(const Request& request) const {
    const std::string_view host = name_in(request.headers.find("Host").value_or(""));
    const auto is_host = [host](const std::string& name) {
        return equal_ignoring_case(name, host);
    };
    if (!options_.local || !is_domain(host) || std::ranges::any_of(options_.host_names, is_host))
        return;
    throw HttpError(421, "host " + std::string(host.substr(0, 100)) +
                             ": this server serves only its own machine: start it with --host-name "
                             "to allow this name");
}

void Api::authorize(const Route& route, Request& request) const {
    request.tenant = "default";
    if (!options_.keys || route.scope == Scope::Open) return;
    constexpr std::string_view kBearer = "Bearer ";
    const auto field = request.headers.find("Authorization").value_or("");
    if (!equal_ignoring_case(field.substr(0, kBearer.size()), kBearer)) {
        throw unauthorized("an API key is needed: Authorization: Bearer KEY");
    }
    const auto keys = options_.keys->keys();
    const auto grant = keys->find(trimmed(field.substr(kBearer.size())));
    if (!grant) throw unauthorized("this API key is unknown");
    if (!grant->allows(route.scope)) {
        throw HttpError(403, std::string("this API key may not ") +
                                 (route.scope == Scope::Read ? "read" : "submit"));
    }
    request.tenant = grant->tenant;
    request.tenants = keys->tenants();
}

/// A page of another site can make a browser send requests here, even to a server that listens on
/// this machine alone. What changes something is refused then; what only reads tells such a page
/// nothing.
void Api::refuse_foreign_sites(const Route& route, const Request& request) const {
    const auto origin = request.headers.find("Origin");
    if (route.scope != Scope::Submit || !origin || listed(*origin)) return;
    if (authority_of(*origin) != request.headers.find("Host").value_or("")) {
        throw HttpError(
            403, "requests from this site are refused: start the server with --cors-origin for it");
    }
}

void Api::share(const Route& route, const Request& request, Reply& reply) const {
    const auto origin = request.headers.find("Origin");
    if (route.sharing == Sharing::Everyone) {
        reply.headers.set("Access-Control-Allow-Origin", "*");
    } else {
        // Also where this one is not shared: a cache would give it to who may have it shared.
        if (!options_.cors_origins.empty()) reply.headers.add("Vary", "Origin");
        if (!origin || !listed(*origin)) return;
        reply.headers.set("Access-Control-Allow-Origin", std::string(*origin));
    }
    reply.headers.set("Access-Control-Expose-Headers", kExposed);
    reply.headers.set("Timing-Allow-Origin",
                      std::string(*reply.headers.find("Access-Control-Allow-Origin")));
}

Reply Api::preflight(const RouteMatch& match, const Request& request) const {
    Reply reply;
    reply.headers.set("Allow", match.allow);
    share(*match.same_path, request, reply);
    if (reply.headers.find("Access-Control-Allow-Origin")) {
        reply.headers.set("Access-Control-Allow-Methods", match.allow);
        reply.headers.set("Access-Control-Allow-Headers",
                          "Authorization, Content-Type, Idempotency-Key, If-None-Match, "
                          "If-Range, Last-Event-ID, Range, X-Request-Id");
        reply.headers.set("Access-Control-Max-Age", "86400");
    }
    return reply;
}

bool Api::listed(std::string_view origin) const noexcept {
    return std::ranges::any_of(options_.cors_origins, [origin](const std::string& known) {
        return known == "*" || known == origin;
    });
}

void Api::answered(const Request& request, int status) {
    metrics_.request_answered(request.method, request.route, status);
}

void Api::served(const Request& request, const Served& outcome) {
    metrics_.request_served(request.route, outcome);
    const std::string_view route = request.route.empty() ? "none" : request.route;
    const bool is_broken = !outcome.failure.empty();
    if (is_broken)
        spdlog::error("reply.broken id={} route={} reason={}", request.id, route,
                      log_text(outcome.failure));
    // The template, not the path: what others chose stays out of the log.
    spdlog::info(
        "http.served id={} address={} tenant={} method={} route={} status={} bytes={} ms={:.1f}{}",
        request.id, request.remote_address, log_name(request.tenant), request.method, route,
        outcome.status, outcome.bytes, 1000 * outcome.seconds.count(),
        is_broken          ? " reply=broken"
        : outcome.complete ? ""
                           : " client=gone");
}

void Api::refused(std::string_view id, std::string_view address, int status,
                  std::string_view detail) {
    metrics_.request_refused(std::to_string(status));
    spdlog::info("http.refused id={} address={} status={} reason={}", id, address, status,
                 log_text(detail));
}

}  // namespace stipple::server::http
