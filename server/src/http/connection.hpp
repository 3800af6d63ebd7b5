#pragma once

#include "http/client_socket.hpp"

#include <chrono>
#include <cstdint>
#include <functional>
#include <string_view>

namespace stipple::server::http {

/// The status under which a request is counted whose client left, or was too slow, before there was
/// a reply: as nginx has it. Never sent.
inline constexpr int kClientLeft = 499;

/// What was answered.
struct Served {
    int status = 0;           ///< kClientLeft: the client left before there was a reply
    std::uint64_t bytes = 0;  ///< of the reply, head included
    std::chrono::duration<double> seconds{};
    bool complete = true;        ///< false: the client left before its end, unless
    std::string_view failure{};  ///< says why the server broke it off
};

/// What a connection serves. Called by many threads at a time.
class Application {
public:
    virtual ~Application() = default;
    /// @throws Disconnected; every other failure is made a reply.
    virtual Reply handle(Request& request) = 0;
    /// The reply is known, and none of it is sent: who has it finds it counted. Also kClientLeft.
    virtual void answered(const Request& request, int status) = 0;
    /// The reply was sent, as far as the client took it.
    virtual void served(const Request& request, const Served& outcome) = 0;
    /// A request refused before it was one: too slow, too large, malformed.
    /// @param id       by which the reply names it, as `Request::id`
    /// @param address  as `Request::remote_address`
    virtual void refused(std::string_view id, std::string_view address, int status,
                         std::string_view detail) = 0;
};

/// Serves the requests of one connection, one after the other, until either side closes it.
void serve_connection(ClientSocket& socket, Application& application, const StopEvent& drain,
                      std::stop_token stop);

/// A whole HTTP message that refuses with this problem, under the caller's id where it can be taken
/// (`request_id`), and ends the connection. The application is told.
std::string refusal(Application& application, const proto::Problem& problem,
                    std::string_view address, std::string_view id_given = {});

}  // namespace stipple::server::http
