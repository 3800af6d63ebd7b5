#include "http/admin.hpp"

#include "http/api.hpp"
#include "log_text.hpp"

#include <spdlog/spdlog.h>

namespace stipple::server::http {

namespace {

Reply text_reply(std::string text, const char* media_type = "text/plain; charset=utf-8") {
    Reply reply;
    reply.media_type = media_type;
    reply.content = std::move(text);
    reply.headers.set("Cache-Control", "no-store");
    return reply;
}

}  // namespace

Admin::Admin(Service& service, Metrics& metrics, std::function<unsigned()> connections)
    : service_(service), metrics_(metrics), connections_(std::move(connections)) {}

Reply Admin::handle(Request& request) {
    request.id = request_id(request.headers.find("X-Request-Id").value_or(""));
    Reply reply = answer(request);
    reply.headers.set("X-Request-Id", request.id);
    return reply;
}

Reply Admin::answer(Request& request) {
    try {
        if (request.method != "GET" && request.method != "HEAD") {
            Headers headers;
            headers.add("Allow", "GET, HEAD");
            throw HttpError(
                proto::problem_from_status(405, request.method + ": this path allows GET, HEAD"),
                std::move(headers));
        }
        const bool is_known =
            request.path == "/livez" || request.path == "/readyz" || request.path == "/metrics";
        if (!is_known) throw HttpError(404, "no such path: expected /livez, /readyz or /metrics");
        request.route = request.path;
        if (request.path == "/livez") return text_reply("alive\n");
        if (request.path == "/readyz") return ready();
        return text_reply(metrics_.text(service_.counts(), connections_()),
                          "text/plain; version=0.0.4; charset=utf-8");
    } catch (...) {
        return failure_reply(std::current_exception(), request);
    }
}

Reply Admin::ready() {
    if (draining_) throw HttpError(503, "the server is stopping");
    try {
        service_.check_ready();
    } catch (const Error& error) {
        spdlog::error("readyz.failed reason={}", log_text(error.what()));
        throw HttpError(503, "the store does not answer; the log says why");
    }
    return text_reply("ready\n");
}

}  // namespace stipple::server::http
