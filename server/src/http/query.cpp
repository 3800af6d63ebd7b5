#include "http/query.hpp"

#include "stipple/proto/job.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

namespace stipple::server::http {

namespace {

constexpr unsigned kMaxPage = 1000;

/// Everything but letters, digits and a few marks as `%XX`.
std::string percent_encoded(std::string_view text) {
    constexpr std::string_view kDigits = "0123456789ABCDEF";
    std::string encoded;
    for (const char c : text) {
        const auto byte = static_cast<unsigned char>(c);
        const bool plain = (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') ||
                           (c >= 'A' && c <= 'Z') || c == '-' || c == '_' || c == '.' || c == '~';
        if (plain) {
            encoded += c;
        } else {
            encoded += {'%', kDigits[byte >> 4U], kDigits[byte & 15U]};
        }
    }
    return encoded;
}

}  // namespace

void refuse(std::string_view name, std::string_view value, const std::string& expected) {
    throw HttpError(400, std::string(name) + " \"" + std::string(value.substr(0, 60)) +
                             "\": expected " + expected);
}

void allow_query(const Request& request, std::span<const std::string_view> names) {
    for (const auto& [name, value] : request.query) {
        if (std::ranges::find(names, name) != names.end()) continue;
        std::string offered;
        for (const std::string_view known : names)
            offered += (offered.empty() ? "" : ", ") + std::string(known);
        throw HttpError(400, "unknown query parameter \"" + name.substr(0, 60) + "\": expected " +
                                 (offered.empty() ? "none" : offered));
    }
    if (request.repeated_query) {
        throw HttpError(400, "query parameter \"" + request.repeated_query->substr(0, 60) +
                                 "\" is given twice: expected once");
    }
}

std::optional<std::uint64_t> query_count(const Request& request, std::string_view name,
                                         std::uint64_t least, std::uint64_t most) {
    const auto text = request.query_value(name);
    if (!text) return std::nullopt;
    std::uint64_t value = 0;
    const auto [end, error] = std::from_chars(text->data(), text->data() + text->size(), value);
    if (error != std::errc() || end != text->data() + text->size() || value < least ||
        value > most) {
        refuse(name, *text, std::to_string(least) + ".." + std::to_string(most));
    }
    return value;
}

std::optional<double> query_number(const Request& request, std::string_view name) {
    const auto text = request.query_value(name);
    if (!text) return std::nullopt;
    double value = 0;
    const auto [end, error] = std::from_chars(text->data(), text->data() + text->size(), value);
    if (error != std::errc() || end != text->data() + text->size() || !std::isfinite(value)) {
        refuse(name, *text, "a number");
    }
    return value;
}

std::optional<bool> query_truth(const Request& request, std::string_view name) {
    const auto text = request.query_value(name);
    if (!text) return std::nullopt;
    if (*text != "true" && *text != "false") refuse(name, *text, "true or false");
    return *text == "true";
}

std::optional<std::string> query_label(const Request& request, std::string_view name) {
    constexpr std::size_t kMaxBytes = 1000;
    auto text = request.query_value(name);
    if (!text) return std::nullopt;
    if (text->empty() || text->size() > kMaxBytes)
        refuse(name, *text, "1.." + std::to_string(kMaxBytes) + " bytes");
    const auto is_control = [](char c) {
        return static_cast<unsigned char>(c) < 0x20 || c == 0x7F;
    };
    if (std::ranges::any_of(*text, is_control)) refuse(name, "...", "no control characters");
    return text;
}

std::chrono::milliseconds query_wait(const Request& request, const Limits& limits,
                                     std::chrono::milliseconds otherwise) {
    const auto seconds = query_number(request, "wait");
    if (seconds && *seconds < 0) refuse("wait", *request.query_value("wait"), "seconds, 0 or more");
    const double most = static_cast<double>(limits.max_wait.count());
    const auto asked = seconds
                           ? std::chrono::milliseconds(std::lround(1000 * std::min(*seconds, most)))
                           : otherwise;
    return std::min<std::chrono::milliseconds>(asked, limits.max_wait);
}

PageQuery query_page(const Request& request) {
    return {static_cast<unsigned>(query_count(request, "limit", 1, kMaxPage).value_or(100)),
            request.query_value("cursor")};
}

Reply page_reply(const Request& request, const std::vector<std::string>& items,
                 const std::optional<std::string>& next) {
    Reply reply = json_reply(200, proto::page_json(items, next));
    reply.headers.set("Cache-Control", "no-store");  // of one tenant
    if (next) {
        std::string href = request.path_prefix + request.path + "?cursor=" + percent_encoded(*next);
        for (const auto& [name, value] : request.query)
            if (name != "cursor") href += "&" + name + "=" + percent_encoded(value);
        reply.headers.set("Link", "<" + href + ">; rel=\"next\"");
    }
    return reply;
}

}  // namespace stipple::server::http
