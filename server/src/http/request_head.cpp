#include "http/request_head.hpp"

#include <algorithm>
#include <array>
#include <charconv>

namespace stipple::server::http {

namespace {

constexpr std::array<std::string_view, 9> kMethods = {
    "GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "CONNECT", "TRACE", "PATCH"};

bool is_token_char(char c) noexcept {
    constexpr std::string_view kPunctuation = "!#$%&'*+-.^_`|~";
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
           kPunctuation.find(c) != std::string_view::npos;
}

bool is_token(std::string_view text) noexcept {
    return !text.empty() && std::ranges::all_of(text, is_token_char);
}

bool is_control(char c) noexcept {
    const auto byte = static_cast<unsigned char>(c);
    return byte < 0x20 || byte == 0x7F;
}

/// Splits off what stands before the next line end; a line feed or carriage return alone is no line
/// end.
std::string_view take_line(std::string_view& text) {
    const auto end = text.find("\r\n");
    const std::string_view line = text.substr(0, end);
    text = end == text.npos ? std::string_view() : text.substr(end + 2);
    return line;
}

/// What was sent, as a refusal repeats it, also in the log: never of a line that is no request line
/// or field, which may be one with a key.
std::string shown(std::string_view text) {
    constexpr std::size_t kLongest = 40;
    const bool is_long = text.size() > kLongest;
    return "`" + std::string(text.substr(0, kLongest)) + (is_long ? "...`" : "`");
}

void read_version(std::string_view version, RequestHead& head) {
    if (version == "HTTP/1.1") return;
    if (version == "HTTP/1.0") {
        head.http_1_0 = true;
    } else if (version.starts_with("HTTP/")) {
        throw HttpError(505, shown(version) + ": expected HTTP/1.0 or HTTP/1.1");
    } else {
        throw HttpError(400, "the request line does not end with an HTTP version");
    }
}

/// `http://host/path` means `/path`: a client that takes us for a proxy.
std::string_view without_authority(std::string_view target) {
    for (const std::string_view scheme : {"http://", "https://"}) {
        if (!target.starts_with(scheme)) continue;
        const auto path = target.find('/', scheme.size());
        return path == target.npos ? "/" : target.substr(path);
    }
    return target;
}

void read_request_line(std::string_view line, RequestHead& head) {
    const auto first = line.find(' ');
    const auto last = line.rfind(' ');
    if (first == line.npos || first == last) {
        throw HttpError(400, "the request line is not `METHOD target HTTP/1.1`");
    }
    const std::string_view method = line.substr(0, first);
    const std::string_view target = line.substr(first + 1, last - first - 1);
    if (target.size() > kMaxTargetBytes) {
        throw HttpError(414, "the target has " + std::to_string(target.size()) +
                                 " bytes: at most " + std::to_string(kMaxTargetBytes));
    }
    if (!is_token(method)) throw HttpError(400, "the method " + shown(method) + " is not a word");
    read_version(line.substr(last + 1), head);
    if (std::ranges::find(kMethods, method) == kMethods.end()) {
        throw HttpError(501, "the method " + shown(method) + " is unknown");
    }
    const std::string_view path = without_authority(target);
    const bool printable = std::ranges::all_of(path, [](char c) { return c > ' ' && c < 0x7F; });
    if (!path.starts_with('/') || !printable) {
        throw HttpError(
            400, "the target " + shown(path) + " is not a path of printable ASCII characters");
    }
    head.method = method;
    head.target = path;
}

void read_field(std::string_view line, RequestHead& head) {
    const auto colon = line.find(':');
    const std::string_view name = line.substr(0, colon);
    if (colon == line.npos || !is_token(name)) {
        throw HttpError(400, "a header line is not `Name: value`");
    }
    const std::string_view value = trimmed(line.substr(colon + 1));
    const bool clean =
        std::ranges::none_of(value, [](char c) { return is_control(c) && c != '\t'; });
    if (!clean) {
        throw HttpError(400,
                        "the header field " + std::string(name) + " holds a control character");
    }
    if (head.headers.size() == kMaxHeaderFields) {
        throw HttpError(431, "more than " + std::to_string(kMaxHeaderFields) + " header fields");
    }
    head.headers.add(std::string(name), std::string(value));
}

std::uint64_t parse_length(std::string_view text) {
    std::uint64_t length = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), length);
    // A length that only an unsigned number holds is no length of anything.
    if (error != std::errc() || end != text.data() + text.size() || length > INT64_MAX) {
        throw HttpError(400, "Content-Length is " + shown(text) + ": expected a number of bytes");
    }
    return length;
}

/// RFC 9112 §6: how long the body is, by exactly one rule.
void read_framing(RequestHead& head) {
    const Headers& headers = head.headers;
    if (headers.count("Content-Length") > 1) throw HttpError(400, "Content-Length is given twice");
    const auto length = headers.find("Content-Length");
    const auto coding = headers.find("Transfer-Encoding");
    if (length && coding) {
        throw HttpError(
            400, "Content-Length and Transfer-Encoding exclude each other: give one of the two");
    }
    if (length) head.content_length = parse_length(*length);
    if (!coding) return;
    if (headers.count("Transfer-Encoding") > 1 || !equal_ignoring_case(*coding, "chunked") ||
        head.http_1_0) {
        throw HttpError(501, "Transfer-Encoding is " + shown(*coding) +
                                 ": expected chunked alone, in HTTP/1.1");
    }
    head.chunked = true;
}

/// What no route of ours takes.
void refuse_bodies_of_other_methods(const RequestHead& head) {
    if (head.has_body() && head.method != "POST") {
        throw HttpError(400, "a " + head.method + " request must not have a body");
    }
}

void read_connection(RequestHead& head) {
    if (const auto expect = head.headers.find("Expect")) {
        if (!equal_ignoring_case(*expect, "100-continue")) {
            throw HttpError(417, "Expect is " + shown(*expect) + ": expected 100-continue");
        }
        head.expects_continue = !head.http_1_0;
    }
    const auto connection = head.headers.find("Connection").value_or("");
    const auto says = [connection](std::string_view option) {
        for (std::string_view rest = connection; !rest.empty();) {
            const auto comma = rest.find(',');
            if (equal_ignoring_case(trimmed(rest.substr(0, comma)), option)) return true;
            rest = comma == rest.npos ? std::string_view() : rest.substr(comma + 1);
        }
        return false;
    };
    head.wants_close = head.http_1_0 || says("close");
}

}  // namespace

RequestHead parse_head(std::string_view text) {
    RequestHead head;
    read_request_line(take_line(text), head);
    while (!text.empty()) read_field(take_line(text), head);
    if (!head.http_1_0 && head.headers.count("Host") != 1) {
        throw HttpError(
            400, std::to_string(head.headers.count("Host")) + " Host fields: expected exactly one");
    }
    read_framing(head);
    read_connection(head);
    refuse_bodies_of_other_methods(head);
    return head;
}

std::string_view given_id(std::string_view text) {
    while (!text.empty()) {
        const std::string_view line = take_line(text);
        const auto colon = line.find(':');
        if (colon != line.npos && equal_ignoring_case(line.substr(0, colon), "X-Request-Id"))
            return trimmed(line.substr(colon + 1));
    }
    return {};
}

void check_head_size(std::string_view so_far) {
    // The longest request line: the longest method and version, two spaces.
    constexpr std::size_t kMaxLine = kMaxTargetBytes + 32;
    const std::string_view line = so_far.substr(0, kMaxLine + 1);
    if (line.size() > kMaxLine && line.find('\n') == line.npos) {
        throw HttpError(414,
                        "the request line has more than " + std::to_string(kMaxLine) + " bytes");
    }
    if (so_far.size() > kMaxHeadBytes) {
        throw HttpError(431, "the head has more than " + std::to_string(kMaxHeadBytes) + " bytes");
    }
}

}  // namespace stipple::server::http
