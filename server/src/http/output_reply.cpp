#include "http/output_reply.hpp"

#include "http/conditional.hpp"

#include <nlohmann/json.hpp>

namespace stipple::server::http {

namespace {

std::string_view media_type_of(std::string_view file_name) {
    const std::string_view extension = file_name.substr(file_name.find('.') + 1);
    return extension == kPictureExtension ? "image/png"
                                          : media_type(cloud_format_from_name(extension));
}

}  // namespace

Reply output_reply(Resources& resources, const Request& request, const std::string& job_id,
                   const std::string& file_name) {
    auto permit = resources.downloads.take(request);
    StoredFile file = resources.service.outputs().file(request.tenant, job_id, file_name,
                                                       accepted_file_codings(request));
    Reply reply = file_reply(request, std::move(file), media_type_of(file_name),
                             immutable(resources.with_keys));
    reply.permit = std::move(permit);
    return reply;
}

std::shared_ptr<void> document_turn(Resources& resources, const Request& request) {
    auto place = resources.documents.take(request);
    if (request.client_gone()) throw Disconnected();
    return place;
}

Reply document_reply(Resources& resources, const Request& request, const std::string& name,
                     const DocumentOptions& options) {
    StoredFile file = resources.service.outputs().document(
        request.tenant, request.path_value("id"), name, accepted_file_codings(request), options,
        [&] { return document_turn(resources, request); });
    return file_reply(request, std::move(file), "application/json", "no-cache");
}

void tell_origin(Reply& reply, const Vec3d& origin) {
    if (origin.isZero(0)) return;
    const nlohmann::json place = {origin.x(), origin.y(), origin.z()};
    const std::string list = place.dump();
    reply.headers.set("Stipple-Origin", list.substr(1, list.size() - 2));
}

}  // namespace stipple::server::http
