#include "http/guarded_server.hpp"

#include "http/client_watch.hpp"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <array>
#include <atomic>
#include <future>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>

namespace stipple::server::http {
namespace {

using namespace std::chrono_literals;

/// Answers everything, and fails where nobody expects it.
class Failing final : public Application {
public:
    Reply handle(Request&) override { return problem_reply(HttpError(404, "nothing is here")); }
    void answered(const Request&, int) override {}
    void served(const Request&, const Served&) override { throw std::runtime_error("served"); }
    void refused(std::string_view, std::string_view, int, std::string_view) override { throw std::bad_alloc(); }
};

/// Computes for each request until it may end.
class Computing final : public Application {
public:
    Reply handle(Request& request) override {
        const ClientWatch watch(request, 60s);
        begun = true;
        while (!may_end && !watch.left().stop_requested()) std::this_thread::sleep_for(1ms);
        if (!may_end) throw Disconnected();
        return json_reply(200, "{}");
    }
    void answered(const Request&, int) override {}
    void served(const Request&, const Served&) override {}
    void refused(std::string_view, std::string_view, int, std::string_view) override {}

    std::atomic<bool> begun = false, may_end = false;
};

/// Begins a reply that it cannot end.
class BreakingOff final : public Application {
public:
    Reply handle(Request&) override {
        Reply reply;
        reply.content = Stream([](const StreamWriter& write) {
            write("the first bytes");
            throw std::runtime_error("a disk that is away");
        });
        return reply;
    }
    void answered(const Request&, int) override {}
    void served(const Request&, const Served& outcome) override {
        complete = outcome.complete;
        failure = outcome.failure;
    }
    void refused(std::string_view, std::string_view, int, std::string_view) override {}

    bool complete = true;
    std::string failure;
};

/// All that the server says to a request, until it closes the connection.
std::string reply_to(std::uint16_t port, std::string_view request) {
    const FileDescriptor fd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
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
        EXPECT_EQ(reply_to(server.port(), "GET / HTTP/1.1\r\nHost: h\r\n\r\n").find("HTTP/1.1 404"),
                  0U);
        EXPECT_EQ(reply_to(server.port(), "no request\r\n\r\n"), "");
    }
    EXPECT_TRUE(server.drain(30s)) << server.connections() << " connections are still counted";
    EXPECT_EQ(server.connections(), 0U);
}

TEST(GuardedServer, GoesOnAfterAFailureToTurnAway) {
    Failing application;
    GuardedServerOptions options;
    options.max_connections = 0;
    GuardedServer server(options, application);
    for (int i = 0; i < 3; ++i) EXPECT_EQ(reply_to(server.port(), "GET / HTTP/1.1\r\n\r\n"), "");
}

TEST(GuardedServer, TellsOfAReplyThatItBrokeOff) {
    BreakingOff application;
    {
        GuardedServer server({}, application);
        const std::string reply = reply_to(server.port(), "GET / HTTP/1.1\r\nHost: h\r\n\r\n");
        EXPECT_NE(reply.find("the first bytes"), reply.npos);
        EXPECT_TRUE(server.drain(30s));
    }
    EXPECT_FALSE(application.complete);
    EXPECT_EQ(application.failure, "a disk that is away");
}

TEST(GuardedServer, LetsWhatIsComputedEndWhenItDrainsAndStopsItWhenItEnds) {
    for (const bool in_time : {true, false}) {
        Computing application;
        std::optional<GuardedServer> server;
        server.emplace(GuardedServerOptions{}, application);
        auto reply = std::async(std::launch::async, [&, port = server->port()] {
            return reply_to(port, "GET / HTTP/1.1\r\nHost: h\r\n\r\n");
        });
        while (!application.begun) std::this_thread::sleep_for(1ms);
        EXPECT_FALSE(server->drain(200ms));
        application.may_end = in_time;
        EXPECT_EQ(server->drain(in_time ? 30s : 0s), in_time);
        server.reset();
        EXPECT_EQ(reply.get().starts_with("HTTP/1.1 200"), in_time);
    }
}

}  // namespace
}  // namespace stipple::server::http
