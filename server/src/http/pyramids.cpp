#include "http/conditional.hpp"
#include "http/routes.hpp"
#include "http/waiting.hpp"

#include "stipple/proto/digest.hpp"
#include "stipple/proto/tiles.hpp"

#include <algorithm>
#include <span>
#include <variant>

namespace stipple::server::http {

namespace {

constexpr std::uint64_t kMostInlined = 64 * 1024;  // bytes

proto::Results pyramid(Resources& resources, const Request& request) {
    proto::Results results = resources.service.results(request.tenant, request.path_value("id"));
    if (!std::holds_alternative<proto::PyramidJob>(results.request.job)) {
        throw HttpError(404, "no such pyramid: this job simplifies; see its results");
    }
    return results;
}

std::string base64(std::span<const std::byte> bytes) {
    constexpr std::string_view kDigits =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    text.reserve((bytes.size() + 2) / 3 * 4);
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        unsigned group = 0;
        for (std::size_t k = 0; k < 3; ++k)
            group =
                group << 8 | (i + k < bytes.size() ? std::to_integer<unsigned>(bytes[i + k]) : 0U);
        for (std::size_t k = 0; k < 4; ++k)
            text += i + k > bytes.size() ? '=' : kDigits[group >> (18 - 6 * k) & 63];
    }
    return text;
}

/// Where `inline` asks for it: the coarsest level stands in the document that names it, so that the
/// first picture costs one request.
void inline_coarsest(Resources& resources, const Request& request, CloudFormat format,
                     proto::Results& results) {
    const auto wanted = request.query_value("inline");
    if (!wanted || results.levels.empty()) return;
    if (*wanted != to_string(format)) {
        throw HttpError(400, "inline \"" + wanted->substr(0, 60) + "\": expected " +
                                 std::string(to_string(format)));
    }
    auto& files = results.levels.front().files;
    const auto file = std::ranges::find(files, format, &proto::OutputFile::format);
    if (file == files.end() || file->bytes > kMostInlined) return;
    const auto blob =
        resources.service.output(request.tenant, request.path_value("id"), file->sha256);
    std::vector<std::byte> bytes(blob->size());
    blob->read(0, bytes);
    file->href = "data:" + std::string(media_type(format)) + ";base64," + base64(bytes);
}

Reply json_that_may_change(const Request& request, const std::string& json) {
    const std::string etag = proto::sha256_hex(std::as_bytes(std::span(json)));
    return tagged_reply(request, etag, "no-cache", json_reply(200, json));
}

/// `tileset.json`, or one of the files that it names: of the levels that are there.
Reply tileset_reply(Resources& resources, const Request& request, const std::string& name) {
    proto::Results results = pyramid(resources, request);
    inline_coarsest(resources, request, CloudFormat::Glb, results);
    for (const proto::TilesetFile& file : proto::tileset_files(results))
        if (file.name == name) return json_that_may_change(request, file.json);
    throw HttpError(404, "no such tileset: this pyramid has no tiles, or none yet");
}

}  // namespace

Reply get_manifest(Resources& resources, Request& request) {
    proto::Results results = pyramid(resources, request);
    inline_coarsest(resources, request, CloudFormat::Draco, results);
    return json_that_may_change(request, proto::to_json(results));
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
