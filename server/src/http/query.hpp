#pragma once

#include "http/message.hpp"
#include "service/service.hpp"

#include <chrono>
#include <initializer_list>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace stipple::server::http {

/// @throws HttpError(400) naming a query parameter, its value and what is expected.
[[noreturn]] void refuse(std::string_view name, std::string_view value,
                         const std::string& expected);

/// @throws HttpError(400) naming a query parameter that is none of these or came twice, so that a
/// slip of the pen is noticed.
void allow_query(const Request& request, std::span<const std::string_view> names);
inline void allow_query(const Request& request, std::initializer_list<std::string_view> names) {
    allow_query(request, std::span(names.begin(), names.size()));
}

/// A whole number. @throws HttpError(400) naming the parameter, its value and the range.
std::optional<std::uint64_t> query_count(const Request& request, std::string_view name,
                                         std::uint64_t least, std::uint64_t most);
/// A finite number.
std::optional<double> query_number(const Request& request, std::string_view name);

/// `true` or `false`.
std::optional<bool> query_truth(const Request& request, std::string_view name);

/// A few words for people: 1..1000 bytes without control characters.
std::optional<std::string> query_label(const Request& request, std::string_view name);

/// `wait` in seconds, capped by the limits.
std::chrono::milliseconds query_wait(const Request& request, const Limits& limits,
                                     std::chrono::milliseconds otherwise);

/// `limit` and `cursor` of a list.
struct PageQuery {
    unsigned limit = 100;
    std::optional<std::string> cursor;
};
PageQuery query_page(const Request& request);
Reply page_reply(const Request& request, const std::vector<std::string>& items,
                 const std::optional<std::string>& next);
/// A page of documents, with a `Link` to the next one.
template <typename Document>
Reply page_reply(const Request& request, const Page<Document>& page) {
    std::vector<std::string> items;
    for (const Document& document : page.items) items.push_back(proto::to_json(document));
    return page_reply(request, items, page.next);
}

}  // namespace stipple::server::http
