#pragma once

#include "base_url.hpp"
#include "stipple/client_errors.hpp"

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

namespace stipple {

using HttpHeaders = std::vector<std::pair<std::string, std::string>>;

struct HttpReply {
    int status = 0;
    std::string content_type;
    std::string body;                   ///< empty when the content went to a receiver
    std::optional<double> retry_after;  ///< seconds
    HttpHeaders headers{};

    /// The value of a field, whatever the case of its name; nothing when there is none.
    std::optional<std::string> field(std::string_view name) const;
    bool ok() const noexcept { return status >= 200 && status < 300; }
};

/// Sends requests to one server; a connection for each, so that calls of several threads do not
/// wait for each other.
///
/// The only source that includes httplib.h is behind this header. That header brings a macro `_res`
/// that breaks Eigen's.
class HttpConnection {
public:
    /// Gets bytes of a good reply as they come; false ends the transfer without an error.
    using Receiver = std::function<bool(std::string_view)>;
    /// Puts up to `room` bytes from `offset` on into `buffer`; the number of them.
    using Source = std::function<std::size_t(std::uint64_t offset, char* buffer, std::size_t room)>;

    HttpConnection(BaseUrl url, const std::string& api_key, std::chrono::seconds timeout,
                   std::stop_token stop);

    const BaseUrl& url() const noexcept { return url_; }
    const std::stop_token& stop_token() const noexcept { return stop_; }

    HttpReply get(const std::string& path, std::chrono::seconds extra_time = {}) const;
    HttpReply get(const std::string& path, const HttpHeaders& headers,
                  const Receiver& receiver) const;
    HttpReply post(const std::string& path, const HttpHeaders& headers,
                   const std::string& body) const;
    /// Ends early where the reply comes before all is sent.
    HttpReply post(const std::string& path, std::uint64_t bytes, const Source& source) const;
    HttpReply remove(const std::string& path) const;

private:
    template <typename Call>
    HttpReply perform(const std::string& server_path, std::chrono::seconds extra_time,
                      bool ended_by_caller_is_fine, Call&& call) const;

    BaseUrl url_;
    HttpHeaders common_headers_;
    std::chrono::seconds timeout_;
    std::stop_token stop_;
};

}  // namespace stipple
