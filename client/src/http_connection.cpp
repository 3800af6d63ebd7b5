#include "http_connection.hpp"

#include <httplib.h>
#include <poll.h>
#include <sys/socket.h>
#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>

namespace stipple {
namespace {

httplib::Headers with(const HttpHeaders& common, const HttpHeaders& more) {
    httplib::Headers headers(common.begin(), common.end());
    headers.insert(more.begin(), more.end());
    return headers;
}

/// Retry-After in seconds. Its other form, a date, is not worth a parser: the usual pause does.
std::optional<double> retry_after(const httplib::Response& response) {
    const std::string text = response.get_header_value("Retry-After");
    double seconds = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seconds);
    if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
    return seconds;
}

HttpReply reply_of(const httplib::Response& response) {
    return {response.status,
            response.get_header_value("Content-Type"),
            response.body,
            retry_after(response),
            {response.headers.begin(), response.headers.end()}};
}

bool is_of_tls(httplib::Error error) {
    return error == httplib::Error::SSLConnection || error == httplib::Error::SSLLoadingCerts ||
           error == httplib::Error::SSLServerVerification;
}

std::string what_happened(httplib::Error error, std::chrono::seconds waited) {
    if (is_of_tls(error)) return "no trusted TLS connection";
    switch (error) {
        case httplib::Error::Connection:
            return "cannot connect";
        case httplib::Error::ConnectionTimeout:
            return "cannot connect in time";
        case httplib::Error::Read:
            return "no answer, or an incomplete one (waited up to " +
                   std::to_string(waited.count()) + " s)";
        case httplib::Error::Write:
            return "the connection closed while the request was being sent";
        case httplib::Error::Canceled:
            return "the file became shorter while it was being sent";
        default:
            return httplib::to_string(error);
    }
}

std::string remedy(httplib::Error error) {
    if (is_of_tls(error))
        return "stippled itself speaks http://; https:// needs a proxy with a trusted certificate";
    if (error == httplib::Error::Canceled) return "send it again once it is complete";
    if (error == httplib::Error::Write)
        return "it may refuse requests of this size (GET /v1/limits)";
    return "is stippled running there? (stippled serve)";
}

/// Waits until the socket takes more, or a reply comes. @returns whether one has begun that no
/// other follows; those of 1xx only go before it.
bool replies_early(int socket, std::chrono::milliseconds patience) {
    constexpr std::size_t kClassOfStatus = 9;  // `HTTP/1.1 413`
    pollfd waited{socket, POLLIN | POLLOUT, 0};
    ::poll(&waited, 1, static_cast<int>(patience.count()));
    std::array<char, kClassOfStatus + 1> head{};
    const ssize_t got = ::recv(socket, head.data(), head.size(), MSG_PEEK | MSG_DONTWAIT);
    return got == static_cast<ssize_t>(head.size()) && head[kClassOfStatus] != '1';
}

}  // namespace

std::optional<std::string> HttpReply::field(std::string_view name) const {
    const auto same = [](unsigned char a, unsigned char b) {
        return std::tolower(a) == std::tolower(b);
    };
    for (const auto& [field, value] : headers)
        if (std::ranges::equal(field, name, same)) return value;
    return std::nullopt;
}

HttpConnection::HttpConnection(BaseUrl url, const std::string& api_key,
                               std::chrono::seconds timeout, std::stop_token stop)
    : url_(std::move(url)), timeout_(timeout), stop_(std::move(stop)) {
    common_headers_.emplace_back("Accept", "application/json, application/problem+json, */*;q=0.1");
    common_headers_.emplace_back("Accept-Encoding", "identity");
    // What a header cannot hold would be the next one.
    const auto is_visible = [](unsigned char c) { return c > 0x20 && c < 0x7f; };
    if (!std::ranges::all_of(api_key, is_visible))
        throw Error(ErrorCode::InvalidArgument,
                    "api_key: expected ASCII letters, digits and symbols only, no spaces or line "
                    "breaks");
    if (!api_key.empty()) common_headers_.emplace_back("Authorization", "Bearer " + api_key);
}

template <typename Call>
HttpReply HttpConnection::perform(const std::string& server_path, std::chrono::seconds extra_time,
                                  bool ended_by_caller_is_fine, Call&& call) const {
    constexpr std::chrono::seconds kConnectTime{5};
    const std::string path = url_.on_host(server_path);
    httplib::Client client(url_.origin());
    client.set_connection_timeout(std::min(kConnectTime, timeout_));
    client.set_read_timeout(timeout_ + extra_time);
    client.set_write_timeout(timeout_);
    client.set_follow_location(false);  // the API key is for this address alone
    client.set_tcp_nodelay(true);

    const std::stop_callback shut_down(stop_, [&] { client.stop(); });
    if (stop_.stop_requested()) throw Cancelled();
    const httplib::Result result = call(client, path);
    if (stop_.stop_requested()) throw Cancelled();
    if (!result) {
        if (ended_by_caller_is_fine && result.error() == httplib::Error::Canceled)
            return HttpReply{200, {}, {}, {}, {}};
        const std::string message = url_.origin() + path + ": " +
                                    what_happened(result.error(), timeout_ + extra_time) + ": " +
                                    remedy(result.error());
        if (is_of_tls(result.error())) throw Error(ErrorCode::InvalidArgument, message);
        throw Unreachable(message);
    }
    return reply_of(*result);
}

HttpReply HttpConnection::get(const std::string& path, std::chrono::seconds extra_time) const {
    return perform(path, extra_time, false,
                   [&](httplib::Client& client, const std::string& target) {
                       return client.Get(target, with(common_headers_, {}));
                   });
}

HttpReply HttpConnection::get(const std::string& path, const HttpHeaders& headers,
                              const Receiver& receiver) const {
    // The content of a bad reply is a problem document, and not for the receiver.
    bool good = false;
    std::string problem;
    HttpReply reply =
        perform(path, {}, true, [&](httplib::Client& client, const std::string& target) {
            return client.Get(
                target, with(common_headers_, headers),
                [&](const httplib::Response& head) {
                    good = head.status >= 200 && head.status < 300;
                    return true;
                },
                [&](const char* data, std::size_t size) {
                    if (good) return receiver({data, size});
                    problem.append(data, size);
                    return problem.size() < 65536;
                });
        });
    if (!reply.ok()) reply.body = std::move(problem);
    return reply;
}

HttpReply HttpConnection::post(const std::string& path, const HttpHeaders& headers,
                               const std::string& body) const {
    return perform(path, {}, false, [&](httplib::Client& client, const std::string& target) {
        return client.Post(target, with(common_headers_, headers), body, "application/json");
    });
}

HttpReply HttpConnection::post(const std::string& path, std::uint64_t bytes,
                               const Source& source) const {
    // What a writable socket takes without a wait, in which a reply would be missed.
    std::vector<char> buffer(std::size_t{1} << 14);
    const bool plain = url_.scheme == "http";  // over TLS what can be read may be no reply
    const auto send = [&](httplib::DataSink& sink, int socket) {
        for (std::uint64_t sent = 0; sent < bytes;) {
            const std::size_t room = std::min<std::uint64_t>(bytes - sent, buffer.size());
            const std::size_t size = stop_.stop_requested() ? 0 : source(sent, buffer.data(), room);
            if (size == 0) return false;
            if (!sink.write(buffer.data(), size)) return true;  // the library knows why
            sent += size;
            // A server that refuses the file need not read it, and may close in a moment.
            if (plain && sent < bytes && replies_early(socket, timeout_)) return true;
        }
        return true;
    };
    // The library reads no reply before all the content that it knows of is sent: it knows of the
    // first byte.
    const std::size_t known_bytes = std::min<std::uint64_t>(bytes, 1);
    HttpHeaders length;
    if (bytes > 0) length.emplace_back("Content-Length", std::to_string(bytes));
    // The server answers once all is hashed and durable: give the disk the time that the wire had.
    constexpr std::chrono::seconds kTimeToStore{120};
    return perform(path, kTimeToStore, false,
                   [&](httplib::Client& client, const std::string& target) {
                       const auto provide = [&](std::size_t, std::size_t, httplib::DataSink& sink) {
                           return send(sink, client.socket());
                       };
                       return client.Post(target, with(common_headers_, length), known_bytes,
                                          provide, "application/octet-stream");
                   });
}

HttpReply HttpConnection::remove(const std::string& path) const {
    return perform(path, {}, false, [&](httplib::Client& client, const std::string& target) {
        return client.Delete(target, with(common_headers_, {}));
    });
}

}  // namespace stipple
