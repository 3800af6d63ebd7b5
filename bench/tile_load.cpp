// How many tiles a second a server sends: every tile of a pyramid in turn, over connections that
// are kept open, as fast as the replies come.
//
//     stipple-tile-load ADDRESS:PORT JOB [--connections N] [--seconds S] [--accept br] [--pid PID]
//
// With the process id of the server, also the processor time that it took for each request: what it
// can do on two cores does not depend on what else this machine does, or on this program.

#include "program.hpp"

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>
#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iostream>
#include <memory>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;

struct Options {
    sockaddr_in server{};
    std::string job, accept = "br";
    int connections = 16;
    double seconds = 5;
    std::string pid;
};

[[noreturn]] void fail(const std::string& what) {
    throw std::runtime_error(what);
}

/// @param text  the number of an address and its port.
sockaddr_in address_of(const std::string& text) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    const auto colon = std::min(text.find(':'), text.size());
    const std::string port = text.substr(std::min(colon + 1, text.size()));
    std::uint16_t number = 0;
    const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), number);
    if (error != std::errc() || end != port.data() + port.size() ||
        ::inet_pton(AF_INET, text.substr(0, colon).c_str(), &address.sin_addr) != 1)
        fail(text + ": expected the number of an address and a port, as 127.0.0.1:8080");
    address.sin_port = htons(number);
    return address;
}

/// A connection with at most one request under way.
class Connection {
public:
    explicit Connection(const sockaddr_in& server) : server_(server) { open(); }
    ~Connection() { ::close(fd_); }
    Connection(const Connection&) = delete;
    Connection& operator=(const Connection&) = delete;

    int fd() const noexcept { return fd_; }

    void send(const std::string& request) {
        received_.clear();
        whole_.reset();
        if (::send(fd_, request.data(), request.size(), MSG_NOSIGNAL) !=
            static_cast<ssize_t>(request.size()))
            fail("a request could not be sent");
    }

    /// Whether the reply is whole now.
    bool receive() {
        std::array<char, 64 * 1024> piece;
        const ssize_t n = ::recv(fd_, piece.data(), piece.size(), 0);
        if (n <= 0) fail("the server closed a connection before its reply was whole");
        received_.append(piece.data(), static_cast<std::size_t>(n));
        if (!whole_) {
            const auto end = received_.find("\r\n\r\n");
            if (end == received_.npos) return false;
            whole_ = end + 4 + length(std::string_view(received_).substr(0, end));
        }
        return received_.size() >= *whole_;
    }

    const std::string& reply() const noexcept { return received_; }
    bool ok() const { return received_.starts_with("HTTP/1.1 200"); }
    bool closes() const { return received_.find("Connection: close") < received_.find("\r\n\r\n"); }
    void reopen() {
        ::close(fd_);
        open();
    }

private:
    void open() {
        fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        const int on = 1;
        ::setsockopt(fd_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
        if (::connect(fd_, reinterpret_cast<const sockaddr*>(&server_), sizeof server_) != 0)
            fail(std::string("cannot connect: ") + std::strerror(errno));
    }
    static std::size_t length(std::string_view head) {
        constexpr std::string_view kField = "Content-Length: ";
        const auto at = head.find(kField);
        if (at == head.npos) fail("a reply has no Content-Length");
        std::size_t value = 0;
        std::from_chars(head.data() + at + kField.size(), head.data() + head.size(), value);
        return value;
    }

    const sockaddr_in server_;
    int fd_ = -1;
    std::string received_;
    std::optional<std::size_t> whole_;
};

std::string request_for(const std::string& path, const std::string& accept) {
    return "GET " + path + " HTTP/1.1\r\nHost: tiles\r\nAccept-Encoding: " + accept + "\r\n\r\n";
}

/// Every path of a tile in the manifest.
std::vector<std::string> tiles_of(const Options& options) {
    Connection connection(options.server);
    const std::string folder = "/v1/pyramids/" + options.job + "/";
    connection.send(request_for(folder + "manifest.json", "identity"));
    while (!connection.receive()) {
    }
    if (!connection.ok()) fail(connection.reply());
    std::vector<std::string> paths;
    const std::string& text = connection.reply();
    for (auto at = text.find(folder); at != text.npos; at = text.find(folder, at + 1)) {
        std::string path = text.substr(at, text.find('"', at) - at);
        if (path.ends_with(".glb")) paths.push_back(std::move(path));
    }
    if (paths.empty()) fail("this pyramid has no tiles");
    return paths;
}

/// Processor seconds that a process has taken so far, in user mode and in the system.
double processor_seconds(const std::string& pid) {
    std::ifstream file("/proc/" + pid + "/stat");
    std::string text{std::istreambuf_iterator<char>(file), {}};
    std::istringstream fields(text.substr(text.rfind(')') + 2));
    std::string skipped;
    for (int i = 0; i < 11; ++i) fields >> skipped;
    double user = 0, system = 0;
    fields >> user >> system;
    return (user + system) / static_cast<double>(::sysconf(_SC_CLK_TCK));
}

void run(const Options& options) {
    std::vector<std::string> requests;
    for (const std::string& path : tiles_of(options))
        requests.push_back(request_for(path, options.accept));

    const int epoll = ::epoll_create1(EPOLL_CLOEXEC);
    std::vector<std::unique_ptr<Connection>> connections;
    std::size_t next = 0;
    const auto begin = [&](std::size_t i, int operation) {
        epoll_event event{.events = EPOLLIN, .data = {.u64 = i}};
        if (operation != 0) ::epoll_ctl(epoll, operation, connections[i]->fd(), &event);
        connections[i]->send(requests[next++ % requests.size()]);
    };
    const double processor_before = options.pid.empty() ? 0 : processor_seconds(options.pid);
    const auto start = Clock::now();
    for (int i = 0; i < options.connections; ++i) {
        connections.push_back(std::make_unique<Connection>(options.server));
        begin(connections.size() - 1, EPOLL_CTL_ADD);
    }
    std::uint64_t replies = 0, bytes = 0;
    const auto end = start + std::chrono::duration<double>(options.seconds);
    std::array<epoll_event, 64> events;
    while (Clock::now() < end) {
        const int ready = ::epoll_wait(epoll, events.data(), events.size(), 1000);
        for (int e = 0; e < ready; ++e) {
            const std::size_t i = events[static_cast<std::size_t>(e)].data.u64;
            Connection& connection = *connections[i];
            if (!connection.receive()) continue;
            if (!connection.ok()) fail(connection.reply());
            ++replies;
            bytes += connection.reply().size();
            const bool closes = connection.closes();
            if (closes) connection.reopen();
            begin(i, closes ? EPOLL_CTL_ADD : 0);
        }
    }
    const double took = std::chrono::duration<double>(Clock::now() - start).count();
    const double n = static_cast<double>(replies);
    std::cout << requests.size() << " tiles, " << options.connections << " connections, "
              << options.accept << ": " << static_cast<std::uint64_t>(n / took) << " replies/s of "
              << static_cast<std::uint64_t>(static_cast<double>(bytes) / n) << " bytes\n";
    if (options.pid.empty()) return;
    const double each = (processor_seconds(options.pid) - processor_before) / n;
    std::cout << "the server took " << 1e6 * each
              << " us of processor time for each: " << static_cast<std::uint64_t>(2 / each)
              << " a second on two cores\n";
}

}  // namespace

int main(int argc, char** argv) {
    Options options;
    std::string server;
    CLI::App app("How many tiles a second a server sends.", "stipple-tile-load");
    app.add_option("SERVER", server, "its address and port, as 127.0.0.1:8080")->required();
    app.add_option("JOB", options.job, "that made a pyramid with tiles")->required();
    app.add_option("--connections", options.connections, "that are kept open")
        ->check(stipple::bench::at_least(1))
        ->capture_default_str();
    app.add_option("--seconds", options.seconds, "for how long")->capture_default_str();
    app.add_option("--accept", options.accept, "br, gzip or identity")->capture_default_str();
    app.add_option("--pid", options.pid, "of the server: tells its processor time, too");
    return stipple::bench::run_program(app, argc, argv, [&] {
        options.server = address_of(server);
        run(options);
        return 0;
    });
}
