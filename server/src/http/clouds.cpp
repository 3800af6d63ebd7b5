#include "http/conditional.hpp"
#include "http/query.hpp"
#include "http/routes.hpp"
#include "http/upload.hpp"

#include <algorithm>
#include <cstdint>
#include <limits>

namespace stipple::server::http {

namespace {

constexpr std::size_t kPieceBytes = 256 * 1024;
constexpr std::uint64_t kAnyLength = std::numeric_limits<std::uint64_t>::max();

/// What the request says of the length of its body, if that is not above the limit.
std::optional<std::uint64_t> checked_length(const Request& request, const Limits& limits) {
    if (!request.body->announced()) {
        throw HttpError(411,
                        "no body was announced: send the file with Content-Length, or chunked");
    }
    const auto length = request.body->length();
    if (length && *length > limits.max_upload_bytes) {
        throw HttpError(413, "the body has " + std::to_string(*length) + " bytes: at most " +
                                 std::to_string(limits.max_upload_bytes) +
                                 " are accepted (GET /v1/limits)");
    }
    return length;
}

/// Pieces of a body until there is enough to be worth a write: a chunk may have a single byte.
std::size_t fill(RequestBody& body, std::span<std::byte> out) {
    constexpr std::size_t kEnough = 64 << 10;
    std::size_t filled = 0;
    while (filled < std::min(kEnough, out.size())) {
        const std::size_t n = body.read(out.subspan(filled));
        if (n == 0) break;
        filled += n;
    }
    return filled;
}

/// Of one tenant, so that no cache on the way gives it to another.
Reply cloud_reply(int status, const proto::CloudDocument& cloud) {
    Reply reply = json_reply(status, proto::to_json(cloud));
    reply.headers.set("Cache-Control", "no-store");
    return reply;
}

}  // namespace

Submission<proto::CloudDocument> receive_cloud(Resources& resources, Request& request,
                                               const std::optional<std::string>& name) {
    const Limits& limits = resources.service.limits();
    const auto length = checked_length(request, limits);
    const auto permit = resources.uploads.take(request);
    const auto upload = resources.service.begin_upload();
    std::vector<std::byte> piece(kPieceBytes);
    std::vector<std::byte> head;
    while (const std::size_t n = fill(*request.body, piece)) {
        const auto bytes = std::span(piece).first(n);
        if (head.size() < kUploadHeadBytes) {
            const auto wanted = bytes.first(std::min(n, kUploadHeadBytes - head.size()));
            head.insert(head.end(), wanted.begin(), wanted.end());
            // What is no cloud, too large or cut short is refused before the rest of it is sent.
            if (head.size() == kUploadHeadBytes)
                (void)check_head(head, length.value_or(kAnyLength), limits.decode);
        }
        upload->write(bytes);
    }
    return resources.service.finish_upload(request.tenant, *upload, head, name);
}

Reply upload_cloud(Resources& resources, Request& request) {
    allow_query(request, {"name"});
    const auto name = query_label(request, "name");
    const auto [cloud, existed] = receive_cloud(resources, request, name);
    Reply reply = cloud_reply(existed ? 200 : 201, cloud);
    reply.headers.set("Location", resources.service.links().cloud(cloud.id));
    return reply;
}

Reply list_clouds(Resources& resources, Request& request) {
    allow_query(request, {"limit", "cursor"});
    const PageQuery page = query_page(request);
    return page_reply(request, resources.service.clouds(request.tenant, page.limit, page.cursor));
}

Reply get_cloud(Resources& resources, Request& request) {
    allow_query(request, {});
    return cloud_reply(200, resources.service.cloud(request.tenant, request.path_value("id")));
}

Reply remove_cloud(Resources& resources, Request& request) {
    allow_query(request, {});
    const proto::CloudDocument cloud =
        resources.service.cloud(request.tenant, request.path_value("id"));
    resources.service.remove_cloud(request.tenant, cloud.id);
    return cloud_reply(200, cloud);
}

Reply get_cloud_content(Resources& resources, Request& request) {
    const proto::CloudDocument cloud =
        resources.service.cloud(request.tenant, request.path_value("id"));
    auto permit = resources.downloads.take(request);
    auto blob = resources.service.cloud_content(request.tenant, cloud.id);
    Reply reply = file_reply(request, {std::move(blob), cloud.id}, media_type(cloud.format),
                             immutable(resources.with_keys));
    reply.permit = std::move(permit);
    return reply;
}

}  // namespace stipple::server::http
