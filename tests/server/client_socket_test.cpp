#include "http/client_socket.hpp"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <array>
#include <stdexcept>
#include <string>
#include <thread>

namespace stipple::server::http {
namespace {

using namespace std::chrono_literals;

/// Both ends of a connection over TCP.
struct Connection {
    FileDescriptor client, server;

    Connection() {
        const FileDescriptor listener(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t size = sizeof address;
        auto* const name = reinterpret_cast<sockaddr*>(&address);
        client = FileDescriptor(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
        if (::bind(listener.get(), name, size) != 0 || ::listen(listener.get(), 1) != 0 ||
            ::getsockname(listener.get(), name, &size) != 0 ||
            ::connect(client.get(), name, size) != 0) {
            throw std::runtime_error("no connection over TCP");
        }
        server = FileDescriptor(
            ::accept4(listener.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
    }
};

/// A server that lets its client be silent for a moment only, but takes a byte a second: at that
/// rate the bytes below would buy days.
struct Waiting {
    Connection connection;
    const Patience patience{
        .grace = 50ms, .silence = 50ms, .pause = 50ms, .min_bytes_per_second = 1};
    const StopEvent drain, abort;
    ClientSocket socket{std::move(connection.server), "127.0.0.1", patience, drain, abort};

    Waiting() { socket.begin_exchange(); }
};

TEST(ClientSocket, TakesNoSilenceForWhatWasSentBefore) {
    Waiting waiting;
    const std::string bytes(1 << 16, ' ');
    ASSERT_EQ(::send(waiting.connection.client.get(), bytes.data(), bytes.size(), 0),
              static_cast<ssize_t>(bytes.size()));
    std::size_t received = 0;
    std::array<std::byte, 4096> piece;
    try {
        while (received <= bytes.size()) received += waiting.socket.read_some(piece);
        FAIL() << "more was received than sent";
    } catch (const HttpError& error) {
        EXPECT_EQ(error.problem.status, 408);
        EXPECT_NE(error.problem.detail.find("without a pause of"), std::string::npos);
    }
    EXPECT_EQ(received, bytes.size());
}

TEST(ClientSocket, ForgivesOneEmptyLineAndWaitsNoLongerForMore) {
    const auto send = [](const Connection& connection, std::string_view bytes) {
        ASSERT_EQ(::send(connection.client.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL),
                  static_cast<ssize_t>(bytes.size()));
    };
    Waiting forgiving;
    send(forgiving.connection, "\r\nGET / HTTP/1.1\r\nHost: h\r\n\r\n");
    EXPECT_EQ(forgiving.socket.read_head(), "GET / HTTP/1.1\r\nHost: h");

    Connection connection;
    const Patience patience{.head = 300ms, .keep_alive = 300ms};
    const StopEvent drain, abort;
    ClientSocket socket(std::move(connection.server), "127.0.0.1", patience, drain, abort);
    const std::jthread lines([&](const std::stop_token& stop) {
        while (!stop.stop_requested()) {
            if (::send(connection.client.get(), "\r\n", 2, MSG_NOSIGNAL) != 2) return;
            std::this_thread::sleep_for(20ms);
        }
    });
    EXPECT_EQ(socket.read_head(), "") << "no request: it is answered as such";
}

TEST(ClientSocket, SeesTheEndOfAClientBehindWhatNobodyHasRead) {
    Waiting waiting;
    EXPECT_FALSE(waiting.socket.peer_gone());
    ASSERT_EQ(::send(waiting.connection.client.get(), "\r\n", 2, MSG_NOSIGNAL), 2);
    EXPECT_FALSE(waiting.socket.peer_gone());
    waiting.connection.client = FileDescriptor();
    const auto end = std::chrono::steady_clock::now() + 10s;
    while (!waiting.socket.peer_gone() && std::chrono::steady_clock::now() < end)
        std::this_thread::sleep_for(1ms);
    EXPECT_TRUE(waiting.socket.peer_gone());
}

TEST(ClientSocket, LeavesAReaderThatTakesNoMore) {
    Waiting waiting;
    const std::jthread reader([&client = waiting.connection.client] {
        std::array<char, 1 << 16> piece;
        for (std::size_t received = 0; received < 1 << 20;) {
            const ssize_t n = ::recv(client.get(), piece.data(), piece.size(), 0);
            if (n <= 0) return;
            received += static_cast<std::size_t>(n);
        }
    });
    const std::string bytes(64 << 20, ' ');
    EXPECT_THROW(waiting.socket.write_all(bytes), Disconnected);
}

}  // namespace
}  // namespace stipple::server::http
