#include "http/event_stream.hpp"
#include "http/output_reply.hpp"
#include "http/query.hpp"
#include "http/routes.hpp"
#include "http/waiting.hpp"

#include "stipple/proto/digest.hpp"

#include <algorithm>
#include <charconv>
#include <variant>

namespace stipple::server::http {

namespace {

using namespace std::chrono_literals;

constexpr auto kLookAtClient = 1000ms;

/// Only a request that says it is JSON: a form of another site cannot say so.
std::string read_json(const Request& request) {
    const auto type = request.headers.find("Content-Type").value_or("");
    if (!equal_ignoring_case(trimmed(type.substr(0, type.find(';'))), "application/json")) {
        throw HttpError(415, "Content-Type is not application/json: send JSON with that type");
    }
    return read_all(*request.body, proto::kMaxRequestBytes);
}

Reply job_reply(int status, const proto::JobDocument& job) {
    Reply reply = json_reply(status, proto::to_json(job));
    reply.headers.set("Cache-Control", "no-store");
    return reply;
}

/// `Last-Event-ID` says where a browser's stream was cut; it stands before the query, which says
/// where it began.
std::uint64_t first_wanted(const Request& request) {
    const auto resumed = request.headers.find("Last-Event-ID");
    if (!resumed) return query_count(request, "after", 0, INT64_MAX).value_or(0);
    std::int64_t id = 0;
    const auto [end, error] =
        std::from_chars(resumed->data(), resumed->data() + resumed->size(), id);
    if (error != std::errc() || end != resumed->data() + resumed->size() || id < 0)
        refuse("Last-Event-ID", *resumed, "the id of an event");
    return static_cast<std::uint64_t>(id);
}

std::optional<std::string> idempotency_key(const Request& request) {
    const auto field = request.headers.find("Idempotency-Key");
    return field ? std::optional<std::string>(*field) : std::nullopt;
}

}  // namespace

std::shared_ptr<void> place_to_wait(Resources& resources, const Request& request,
                                    std::chrono::milliseconds wait) {
    return wait == 0ms ? nullptr : resources.waits.take(request);
}

proto::JobDocument wait_for_job(Resources& resources, const Request& request, const std::string& id,
                                std::chrono::milliseconds wait) {
    if (wait == 0ms) return resources.service.job(request.tenant, id);
    const auto deadline = std::chrono::steady_clock::now() + wait;
    while (true) {
        const auto left = std::chrono::ceil<std::chrono::milliseconds>(
            deadline - std::chrono::steady_clock::now());
        const auto slice = std::clamp<std::chrono::milliseconds>(left, 0ms, kLookAtClient);
        proto::JobDocument job =
            resources.service.wait_for_job(request.tenant, id, slice, request.stop);
        if (proto::is_final(job.status) || left <= slice || request.stop.stop_requested())
            return job;
        if (request.client_gone()) throw Disconnected();
    }
}

proto::JobDocument wait_for_own_job(Resources& resources, const Request& request,
                                    const std::string& id, std::chrono::milliseconds wait) {
    try {
        return wait_for_job(resources, request, id, wait);
    } catch (const Disconnected&) {
        try {
            resources.service.cancel(request.tenant, id);
        } catch (const Error&) {  // it has ended meanwhile
        }
        throw;
    }
}

Reply submit_job(Resources& resources, Request& request) {
    allow_query(request, {});
    const proto::JobRequest wanted = proto::job_request_from_json(read_json(request));
    const auto key = idempotency_key(request);
    const auto [job, existed] = resources.service.submit(request.tenant, wanted, key);
    Reply reply = job_reply(existed ? 200 : 201, job);
    reply.headers.set("Location", resources.service.links().job(job.id));
    return reply;
}

Reply evaluate(Resources& resources, Request& request) {
    allow_query(request, {"wait"});
    const auto wait = query_wait(request, resources.service.limits(), kDefaultWait);
    const proto::JobRequest wanted = proto::evaluation_from_json(read_json(request));
    const auto key = idempotency_key(request);
    const auto place = place_to_wait(resources, request, wait);
    const proto::JobDocument queued =
        resources.service.submit(request.tenant, wanted, key).document;
    // Who gave it a key means to ask for it again.
    const proto::JobDocument job = key ? wait_for_job(resources, request, queued.id, wait)
                                       : wait_for_own_job(resources, request, queued.id, wait);
    if (const auto problem = why_incomplete(job)) throw HttpError(*problem);
    if (job.status != proto::JobStatus::Successful) {
        Reply reply = job_reply(201, job);
        reply.headers.set("Location", resources.service.links().job(job.id));
        return reply;
    }
    Reply reply =
        json_reply(200, proto::evaluation_json(*resources.service.results(request.tenant, job.id)));
    reply.headers.set("Cache-Control", "no-store");
    reply.headers.set("Link", "<" + resources.service.links().job(job.id) + ">; rel=\"via\"");
    return reply;
}

Reply list_jobs(Resources& resources, Request& request) {
    allow_query(request, {"limit", "cursor", "type", "status", "input"});
    const PageQuery page = query_page(request);
    const JobStore::JobFilter filter{.type = request.query_value("type"),
                                     .status = request.query_value("status"),
                                     .input = request.query_value("input")};
    if (filter.type &&
        std::ranges::find(proto::kJobTypes, *filter.type) == proto::kJobTypes.end()) {
        refuse("type", *filter.type, proto::kAnyJobType);
    }
    if (filter.input && !proto::is_sha256(*filter.input))
        refuse("input", *filter.input, "the id of a cloud, 64 hexadecimal digits");
    try {
        if (filter.status) (void)proto::job_status_from_name(*filter.status);
    } catch (const Error& error) {
        throw HttpError(400, std::string("status ") + error.what());
    }
    return page_reply(request,
                      resources.service.jobs(request.tenant, filter, page.limit, page.cursor));
}

Reply get_job(Resources& resources, Request& request) {
    allow_query(request, {"wait"});
    const auto wait = query_wait(request, resources.service.limits(), 0ms);
    const auto place = place_to_wait(resources, request, wait);
    return job_reply(200, wait_for_job(resources, request, request.path_value("id"), wait));
}

Reply dismiss_job(Resources& resources, Request& request) {
    allow_query(request, {"only"});
    const std::string& id = request.path_value("id");
    const auto only = request.query_value("only");
    if (only && *only != "unfinished") refuse("only", *only, "unfinished");
    return job_reply(200, only ? resources.service.cancel(request.tenant, id)
                               : resources.service.dismiss(request.tenant, id));
}

Reply follow_job(Resources& resources, Request& request) {
    allow_query(request, {"after"});
    const std::uint64_t after = first_wanted(request);
    const proto::JobDocument job = resources.service.job(request.tenant, request.path_value("id"));
    if (proto::is_final(job.status) &&
        !resources.service.has_events(request.tenant, job.id, after)) {
        Reply nothing_more;
        nothing_more.status = 204;  // after any other an EventSource asks again
        return nothing_more;
    }
    Reply reply{.status = 200,
                .headers = {},
                .media_type = "text/event-stream",
                .content = event_stream(resources.service, request, job.id, after),
                .permit = resources.streams.take(request)};
    reply.headers.set("Cache-Control", "no-store");
    reply.headers.set("X-Accel-Buffering", "no");  // nginx would keep the events back
    return reply;
}

Reply get_results(Resources& resources, Request& request) {
    allow_query(request, {});
    const proto::JobDocument job = resources.service.job(request.tenant, request.path_value("id"));
    if (const auto problem = why_incomplete(job)) throw HttpError(*problem);
    const auto results = resources.service.results(request.tenant, job.id);
    // Of many tiles: made in a turn, and once.
    if (std::holds_alternative<proto::PyramidJob>(results->request.job))
        return document_reply(resources, request, "manifest.json");
    Reply reply = json_reply(200, proto::to_json(*results));
    reply.headers.set("Cache-Control", "no-store");
    return reply;
}

Reply get_result_file(Resources& resources, Request& request) {
    return output_reply(resources, request, request.path_value("id"), request.path_value("file"));
}

}  // namespace stipple::server::http
