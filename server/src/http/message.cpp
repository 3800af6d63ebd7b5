#include "http/message.hpp"

#include "stipple/proto/digest.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace stipple::server::http {

namespace {

char lower(char c) noexcept {
    return c >= 'A' && c <= 'Z' ? static_cast<char>(c + ('a' - 'A')) : c;
}

}  // namespace

bool equal_ignoring_case(std::string_view a, std::string_view b) noexcept {
    return std::ranges::equal(a, b, {}, lower, lower);
}

std::string_view trimmed(std::string_view text) noexcept {
    const auto first = text.find_first_not_of(" \t");
    if (first == text.npos) return {};
    return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

void Headers::add(std::string name, std::string value) {
    fields_.emplace_back(std::move(name), std::move(value));
}

void Headers::set(std::string_view name, std::string value) {
    remove(name);
    add(std::string(name), std::move(value));
}

void Headers::remove(std::string_view name) {
    std::erase_if(fields_,
                  [&](const auto& field) { return equal_ignoring_case(field.first, name); });
}

std::optional<std::string_view> Headers::find(std::string_view name) const noexcept {
    for (const auto& [field, value] : fields_)
        if (equal_ignoring_case(field, name)) return value;
    return std::nullopt;
}

std::optional<std::string> Headers::joined(std::string_view name) const {
    std::optional<std::string> list;
    for (const auto& [field, value] : fields_)
        if (equal_ignoring_case(field, name)) list = list ? *list + ", " + value : value;
    return list;
}

std::size_t Headers::count(std::string_view name) const noexcept {
    return static_cast<std::size_t>(std::ranges::count_if(
        fields_, [&](const auto& field) { return equal_ignoring_case(field.first, name); }));
}

std::string read_all(RequestBody& body, std::size_t max_bytes) {
    std::string text;
    std::array<std::byte, 16 * 1024> piece;
    while (const std::size_t n = body.read(piece)) {
        if (text.size() + n > max_bytes) {
            throw HttpError(413, "the body is longer than " + std::to_string(max_bytes) + " bytes");
        }
        text.append(reinterpret_cast<const char*>(piece.data()), n);
    }
    return text;
}

std::optional<std::string> Request::query_value(std::string_view name) const {
    const auto found = query.find(name);
    return found == query.end() ? std::nullopt : std::optional(found->second);
}

std::string request_id(std::string_view given) {
    const bool plain = std::ranges::all_of(given, [](char c) {
        return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
               c == '.' || c == '_' || c == '-';
    });
    return !given.empty() && given.size() <= 64 && plain ? std::string(given)
                                                         : proto::random_hex(8);
}

Reply json_reply(int status, std::string json) {
    return {.status = status,
            .headers = {},
            .media_type = "application/json",
            .content = std::move(json),
            .permit = {}};
}

Reply problem_reply(const HttpError& error) {
    Reply reply = json_reply(error.problem.status, proto::to_json(error.problem));
    reply.media_type = "application/problem+json";
    reply.headers = error.headers;
    reply.headers.set("Cache-Control", "no-store");
    if (error.problem.retry_after) {
        const double seconds = std::ceil(std::max(1.0, *error.problem.retry_after));
        reply.headers.set("Retry-After", std::to_string(static_cast<long>(seconds)));
    }
    return reply;
}

}  // namespace stipple::server::http
