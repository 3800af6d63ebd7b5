#include "http/conditional.hpp"
#include "http/routes.hpp"
#include "http/waiting.hpp"

#include "stipple/proto/digest.hpp"

#include <variant>

namespace stipple::server::http {

namespace {

proto::Results pyramid(Resources& resources, const Request& request) {
    proto::Results results = resources.service.results(request.tenant, request.path_value("id"));
    if (!std::holds_alternative<proto::PyramidJob>(results.request.job)) {
        throw HttpError(404, "no such pyramid: this job simplifies; see its results");
    }
    return results;
}

}  // namespace

Reply get_manifest(Resources& resources, Request& request) {
    const std::string manifest = proto::to_json(pyramid(resources, request));
    const std::string etag = proto::sha256_hex(std::as_bytes(std::span(manifest)));
    return tagged_reply(request, etag, "no-cache", json_reply(200, manifest));
}

Reply get_pyramid_file(Resources& resources, Request& request) {
    return output_reply(resources, request, request.path_value("id"), request.path_value("file"));
}

}  // namespace stipple::server::http
