#include "http/conditional.hpp"

#include <algorithm>
#include <charconv>
#include <functional>

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
    headers.add("Accept-Ranges", "bytes");
    headers.add("Content-Range", "bytes */" + std::to_string(size));
    throw HttpError(proto::problem_from_status(416, "the range begins after the last of " +
                                                        std::to_string(size) + " bytes"),
                    std::move(headers));
}

/// What identity is worth beside codings that are named.
constexpr double kLeastQuality = 0.0005;

/// The quality of a name in a list; nothing when the list does not have it.
std::optional<double> quality_of(std::string_view list, std::string_view name) {
    while (!list.empty()) {
        const auto comma = list.find(',');
        const ListItem item = list_item(list.substr(0, comma));
        if (equal_ignoring_case(item.name, name)) return item.quality;
        list = comma == list.npos ? std::string_view() : list.substr(comma + 1);
    }
    return std::nullopt;
}

/// Of a HEAD a range says nothing.
bool wants_range(const Request& request) {
    return request.method == "GET" && request.headers.find("Range");
}

Reply not_modified(Reply reply) {
    reply.status = 304;
    reply.content = std::string();
    reply.headers.remove("Content-Encoding");  // it has no content
    return reply;
}

}  // namespace

ListItem list_item(std::string_view text) {
    const auto take_part = [&text] {
        const auto semicolon = std::min(text.find(';'), text.size());
        const std::string_view part = trimmed(text.substr(0, semicolon));
        text.remove_prefix(std::min(semicolon + 1, text.size()));
        return part;
    };
    ListItem item{take_part(), 1};
    while (!text.empty()) {
        std::string_view weight = take_part();
        if (!equal_ignoring_case(weight.substr(0, 2), "q=")) continue;
        weight.remove_prefix(2);
        double quality = 0;
        const auto [end, error] =
            std::from_chars(weight.data(), weight.data() + weight.size(), quality);
        item.quality = error == std::errc() && quality >= 0 && quality <= 1 ? quality : 0;
    }
    return item;
}

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
    const auto condition = request.headers.joined("If-None-Match");
    return condition && none_match_names(*condition, quoted) ? not_modified(std::move(reply))
                                                             : reply;
}

std::vector<Coding> accepted_codings(const Request& request) {
    const std::string field = request.headers.joined("Accept-Encoding").value_or("");
    struct Choice {
        Coding coding;
        double quality;
    };
    std::vector<Choice> choices;
    for (const Coding coding : {Coding::Brotli, Coding::Gzip, Coding::Identity}) {
        const auto named = quality_of(field, to_string(coding));
        const auto any = quality_of(field, "*");
        const bool plain = coding == Coding::Identity;
        // Plain bytes are taken unless refused, but not wanted before what is named.
        const double quality =
            named.value_or(plain ? (any == 0.0 ? 0 : kLeastQuality) : any.value_or(0));
        if (quality > 0) choices.push_back({coding, quality});
    }
    std::ranges::stable_sort(choices, std::greater(), &Choice::quality);
    std::vector<Coding> codings;
    for (const Choice& choice : choices) codings.push_back(choice.coding);
    return codings;
}

std::vector<Coding> accepted_file_codings(const Request& request) {
    if (wants_range(request)) return {Coding::Identity};
    return accepted_codings(request);
}

std::string immutable(bool only_for_tenant) {
    return std::string(only_for_tenant ? "private" : "public") + ", max-age=31536000, immutable";
}

Reply file_reply(const Request& request, StoredFile file, std::string_view media_type,
                 std::string cache) {
    const std::uint64_t size = file.size();
    Reply reply;
    reply.media_type = media_type;
    reply.headers.set("X-Content-Type-Options", "nosniff");
    if (file.negotiated) reply.headers.add("Vary", "Accept-Encoding");
    if (file.coding == Coding::Identity) {
        reply.headers.set("Accept-Ranges", "bytes");
    } else {
        reply.headers.set("Content-Encoding", std::string(to_string(file.coding)));
    }
    reply.content = StoredRange{file.content, 0, size};
    reply = tagged_reply(request, file.tag, std::move(cache), std::move(reply));
    if (reply.status == 304 || file.coding != Coding::Identity) return reply;

    const auto field = request.headers.find("Range");
    const auto only_if = request.headers.find("If-Range");
    if (!wants_range(request) || (only_if && *only_if != '"' + file.tag + '"')) return reply;
    if (const auto range = parse_range(*field, size)) {
        reply.status = 206;
        reply.headers.set("Content-Range", "bytes " + std::to_string(range->offset) + "-" +
                                               std::to_string(range->offset + range->length - 1) +
                                               "/" + std::to_string(size));
        reply.content = StoredRange{std::move(file.content), range->offset, range->length};
    }
    return reply;
}

}  // namespace stipple::server::http
