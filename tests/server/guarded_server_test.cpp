#include "http/guarded_server.hpp"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <array>
#include <new>
#include <stdexcept>
#include <string>

namespace stipple::server::http {
namespace {

using namespace std::chrono_literals;

/// Answers everything, and fails where nobody expects it.
class Failing final : public Application {
public:
    Reply handle(Request&) override { return problem_reply(HttpError(404, "nothing is here")); }
    void answered(const Request&, int) override {}
    void served(const Request&, const Served&) override { throw std::runtime_error("served"); }
    void refused(std::string_view, int, std::string_view) override { throw std::bad_alloc(); }
};

/// All that the server says to a request, until it closes the connection.
std::string reply_to(const GuardedServer& server, std::string_view request) {
    const FileDescriptor fd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(server.port());
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (::connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
        ::send(fd.get(), request.data(), request.size(), MSG_NOSIGNAL) < 0)
        throw std::runtime_error("no connection over TCP");
    std::string reply;
    std::array<char, 4096> piece{};
    for (ssize_t n = 0; (n = ::recv(fd.get(), piece.data(), piece.size(), 0)) > 0;)
        reply.append(piece.data(), static_cast<std::size_t>(n));
    return reply;
}

TEST(GuardedServer, LosesTheConnectionThatFailsAndNoOther) {
    Failing application;
    GuardedServer server({}, application);
    for (int i = 0; i < 3; ++i) {
        EXPECT_EQ(reply_to(server, "GET / HTTP/1.1\r\nHost: h\r\n\r\n").find("HTTP/1.1 404"), 0U);
        EXPECT_EQ(reply_to(server, "no request\r\n\r\n"), "");
    }
    EXPECT_TRUE(server.drain(30s)) << server.connections() << " connections are still counted";
    EXPECT_EQ(server.connections(), 0U);
}

TEST(GuardedServer, GoesOnAfterAFailureToTurnAway) {
    Failing application;
    GuardedServerOptions options;
    options.max_connections = 0;
    GuardedServer server(options, application);
    for (int i = 0; i < 3; ++i) EXPECT_EQ(reply_to(server, "GET / HTTP/1.1\r\n\r\n"), "");
}

}  // namespace
}  // namespace stipple::server::http
