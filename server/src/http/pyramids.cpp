#include "http/conditional.hpp"
#include "http/routes.hpp"
#include "http/waiting.hpp"

#include "stipple/proto/digest.hpp"
#include "stipple/proto/tiles.hpp"

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

Reply json_that_may_change(const Request& request, const std::string& json) {
    const std::string etag = proto::sha256_hex(std::as_bytes(std::span(json)));
    return tagged_reply(request, etag, "no-cache", json_reply(200, json));
}

/// `tileset.json`, or one of the files that it names: of the levels that are there.
Reply tileset_reply(Resources& resources, const Request& request, const std::string& name) {
    for (const proto::TilesetFile& file : proto::tileset_files(pyramid(resources, request)))
        if (file.name == name) return json_that_may_change(request, file.json);
    throw HttpError(404, "no such tileset: this pyramid has no tiles, or none yet");
}

}  // namespace

Reply get_manifest(Resources& resources, Request& request) {
    return json_that_may_change(request, proto::to_json(pyramid(resources, request)));
}

Reply get_tileset(Resources& resources, Request& request) {
    return tileset_reply(resources, request, "tileset.json");
}

Reply get_stream(Resources& resources, Request& request) {
    for (const proto::OutputCloud& level : pyramid(resources, request).levels)
        for (const proto::OutputFile& file : level.files)
            if (file.format == CloudFormat::Progressive)
                return output_reply(resources, request, request.path_value("id"),
                                    file.sha256 + ".stpc");
    throw HttpError(
        404,
        "no such stream: stpc is not among the formats of this pyramid, or it is not there yet");
}

Reply get_pyramid_file(Resources& resources, Request& request) {
    const std::string file = request.path_value("file");
    if (file.starts_with("tileset-")) return tileset_reply(resources, request, file);
    return output_reply(resources, request, request.path_value("id"), file);
}

}  // namespace stipple::server::http
