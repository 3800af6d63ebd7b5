#include "http/conditional.hpp"
#include "http/routes.hpp"

#include "openapi_files.hpp"
#include "viewer_files.hpp"

#include <algorithm>

namespace stipple::server::http {

namespace {

constexpr const char* kAskEachTime = "no-cache";
/// The docs need a style sheet and nothing else.
constexpr const char* kDocsPolicy =
    "default-src 'none'; style-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors "
    "'none'";

Reply bytes_reply(FixedBytes bytes, std::string_view media_type) {
    Reply reply;
    reply.media_type = media_type;
    reply.content = bytes;
    reply.headers.set("X-Content-Type-Options", "nosniff");
    reply.headers.set("Referrer-Policy", "no-referrer");
    return reply;
}

Reply embedded(const Request& request, const openapi::File& file) {
    return tagged_reply(request, std::string(file.etag), kAskEachTime,
                        bytes_reply(std::as_bytes(std::span(file.text)), file.media_type));
}

bool takes_brotli(const Request& request) {
    // Of those that there are: gzip is not among them.
    const auto codings = accepted_codings(request);
    const auto first = std::ranges::find_if(codings, [](Coding c) { return c != Coding::Gzip; });
    return first != codings.end() && *first == Coding::Brotli;
}

const viewer::File* find_file(std::string_view path) {
    const auto files = viewer::files();
    const auto found = std::ranges::find(files, path, &viewer::File::path);
    return found == files.end() ? nullptr : &*found;
}

Reply viewer_reply(const Request& request, const viewer::File& file, std::string cache) {
    const bool packed = !file.brotli.empty() && takes_brotli(request);
    Reply reply = bytes_reply(packed ? file.brotli : file.identity, file.media_type);
    reply.headers.set("Vary", "Accept-Encoding");
    if (packed) reply.headers.set("Content-Encoding", "br");
    // Other bytes need another tag: it is a strong one.
    return tagged_reply(request, std::string(file.etag) + (packed ? "-br" : ""), std::move(cache),
                        std::move(reply));
}

}  // namespace

Reply get_openapi(Resources&, Request& request) {
    return embedded(request, openapi::document());
}
Reply get_docs_style(Resources&, Request& request) {
    return embedded(request, openapi::style());
}

Reply get_docs(Resources&, Request& request) {
    Reply reply = embedded(request, openapi::page());
    reply.headers.set("Content-Security-Policy", kDocsPolicy);
    return reply;
}

Reply get_viewer(Resources&, Request& request) {
    const viewer::File* const page = find_file("/");
    if (page == nullptr) {
        throw HttpError(404,
                        "this server was built without its viewer; the API is described at /docs");
    }
    Reply reply = viewer_reply(request, *page, kAskEachTime);
    reply.headers.set("Content-Security-Policy", std::string(viewer::kContentSecurityPolicy));
    return reply;
}

Reply get_viewer_file(Resources&, Request& request) {
    const viewer::File* const file = find_file("/assets/" + request.path_value("file"));
    if (file == nullptr) throw HttpError(404, "no such file of the viewer");
    return viewer_reply(request, *file, immutable(false));
}

}  // namespace stipple::server::http
