#include "healthcheck.hpp"

#include "store/posix_file.hpp"

#include <netdb.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <array>
#include <iostream>
#include <memory>
#include <string_view>

namespace stipple::server {

namespace {

/// A listener on all addresses is asked on this machine's own.
std::string reachable(const std::string& host) {
    if (host == "0.0.0.0") return "127.0.0.1";
    if (host == "::") return "::1";
    return host;
}

FileDescriptor connect_to(const ListenAddress& address) {
    addrinfo hints{};
    hints.ai_socktype = SOCK_STREAM;
    addrinfo* first = nullptr;
    if (::getaddrinfo(reachable(address.host).c_str(), std::to_string(address.port).c_str(), &hints,
                      &first) != 0) {
        return {};
    }
    const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> found(first, ::freeaddrinfo);
    FileDescriptor fd(::socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC, 0));
    const timeval patience{.tv_sec = 5, .tv_usec = 0};
    ::setsockopt(fd.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    ::setsockopt(fd.get(), SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
    if (::connect(fd.get(), found->ai_addr, found->ai_addrlen) != 0) return {};
    return fd;
}

// One request of which one line matters: no reason to let httplib out of http/.
std::string status_line(const FileDescriptor& fd) {
    constexpr std::string_view kRequest =
        "GET /readyz HTTP/1.1\r\nHost: admin\r\nConnection: close\r\n\r\n";
    ::send(fd.get(), kRequest.data(), kRequest.size(), MSG_NOSIGNAL);
    std::string reply;
    std::array<char, 512> piece;
    while (reply.find("\r\n") == reply.npos) {
        const ssize_t n = ::recv(fd.get(), piece.data(), piece.size(), 0);
        if (n <= 0) break;
        reply.append(piece.data(), static_cast<std::size_t>(n));
    }
    return reply.substr(0, reply.find("\r\n"));
}

}  // namespace

int healthcheck(const ServerConfig& config) {
    const FileDescriptor fd = connect_to(config.admin);
    const std::string status = fd ? status_line(fd) : std::string();
    const bool ready = status.starts_with("HTTP/1.1 200");
    const std::string where = config.admin.host + ":" + std::to_string(config.admin.port);
    std::cout << (ready            ? "ready"
                  : status.empty() ? "no answer from --admin " + where
                                   : status)
              << '\n';
    return ready ? 0 : 1;
}

}  // namespace stipple::server
