#include "http/conditional.hpp"

#include <algorithm>
#include <charconv>

namespace stipple::server::http {

namespace {

std::optional<std::uint64_t> parse_number(std::string_view text) {
    std::uint64_t number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (text.empty() || error != std::errc() || end != text.data() + text.size())
        return std::nullopt;
    return number;
}

[[noreturn]] void refuse_range(std::uint64_t size) {
    Headers headers;
    headers.add("Content-Range", "bytes */" + std::to_string(size));
    throw HttpError(proto::problem_from_status(416, "the range begins after the last of " +
                                                        std::to_string(size) + " bytes"),
                    std::move(headers));
}

Reply not_modified(Reply reply) {
    reply.status = 304;
    reply.content = std::string();
    return reply;
}

}  // namespace

std::optional<ByteRange> parse_range(std::string_view field, std::uint64_t size) {
    constexpr std::string_view kUnit = "bytes=";
    if (!equal_ignoring_case(field.substr(0, kUnit.size()), kUnit)) return std::nullopt;
    const std::string_view range = trimmed(field.substr(kUnit.size()));
    const auto dash = range.find('-');
    if (dash == range.npos) return std::nullopt;
    const auto first = parse_number(range.substr(0, dash));
    const auto last = parse_number(range.substr(dash + 1));

    if (dash == 0) {  // the last so many bytes
        if (!last) return std::nullopt;
        if (*last == 0 || size == 0) refuse_range(size);
        const std::uint64_t length = std::min(*last, size);
        return ByteRange{size - length, length};
    }
    const bool open_end = dash + 1 == range.size();
    if (!first || (!last && !open_end) || (last && *last < *first)) return std::nullopt;
    if (*first >= size) refuse_range(size);
    const std::uint64_t end = last ? std::min(*last, size - 1) + 1 : size;
    return ByteRange{*first, end - *first};
}

bool none_match_names(std::string_view field, std::string_view etag) {
    while (!field.empty()) {
        const auto comma = field.find(',');
        std::string_view tag = trimmed(field.substr(0, comma));
        if (tag.starts_with("W/")) tag.remove_prefix(2);
        if (tag == etag || tag == "*") return true;
        field = comma == field.npos ? std::string_view() : field.substr(comma + 1);
    }
    return false;
}

Reply tagged_reply(const Request& request, std::string etag, std::string cache, Reply reply) {
    const std::string quoted = '"' + etag + '"';
    reply.headers.set("ETag", quoted);
    reply.headers.set("Cache-Control", std::move(cache));
    const auto condition = request.headers.find("If-None-Match");
    return condition && none_match_names(*condition, quoted) ? not_modified(std::move(reply))
                                                             : reply;
}

Reply blob_reply(const Request& request, std::shared_ptr<const BlobReader> blob,
                 const std::string& sha256, std::string_view media_type, bool only_for_tenant) {
    const std::uint64_t size = blob->size();
    Reply reply;
    reply.media_type = media_type;
    reply.headers.set("Accept-Ranges", "bytes");
    reply.headers.set("X-Content-Type-Options", "nosniff");
    reply.content = BlobRange{blob, 0, size};
    // One year is what caches take for ever.
    const std::string cache =
        std::string(only_for_tenant ? "private" : "public") + ", max-age=31536000, immutable";
    reply = tagged_reply(request, sha256, cache, std::move(reply));
    if (reply.status == 304) return reply;

    const auto field = request.headers.find("Range");
    const auto only_if = request.headers.find("If-Range");
    if (!field || (only_if && *only_if != '"' + sha256 + '"')) return reply;
    if (const auto range = parse_range(*field, size)) {
        reply.status = 206;
        reply.headers.set("Content-Range", "bytes " + std::to_string(range->offset) + "-" +
                                               std::to_string(range->offset + range->length - 1) +
                                               "/" + std::to_string(size));
        reply.content = BlobRange{std::move(blob), range->offset, range->length};
    }
    return reply;
}

}  // namespace stipple::server::http
