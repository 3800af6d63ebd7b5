#include "http/guarded_server.hpp"

#include "log_text.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <system_error>

namespace stipple::server::http {

namespace {

using namespace std::chrono_literals;

constexpr std::size_t kMaxFarewells = 64;
constexpr auto kFarewell = 500ms;

struct AddressList {
    addrinfo* first = nullptr;
    AddressList() = default;
    AddressList(const AddressList&) = delete;
    AddressList& operator=(const AddressList&) = delete;
    ~AddressList() {
        if (first != nullptr) ::freeaddrinfo(first);
    }
};

[[noreturn]] void cannot_listen(const GuardedServerOptions& options, const char* why) {
    throw Error(ErrorCode::InvalidArgument, "cannot listen on " + options.host + ":" +
                                                std::to_string(options.port) + ": " + why);
}

FileDescriptor listen_on(const GuardedServerOptions& options) {
    addrinfo hints{};
    hints.ai_socktype = SOCK_STREAM;
    hints.ai_flags = AI_PASSIVE | AI_NUMERICSERV;
    AddressList found;
    const int failed = ::getaddrinfo(options.host.c_str(), std::to_string(options.port).c_str(),
                                     &hints, &found.first);
    if (failed != 0) cannot_listen(options, ::gai_strerror(failed));

    FileDescriptor fd(
        ::socket(found.first->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    const int on = 1;
    if (!fd || ::setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0 ||
        ::bind(fd.get(), found.first->ai_addr, found.first->ai_addrlen) != 0 ||
        ::listen(fd.get(), 512) != 0) {
        cannot_listen(options, std::strerror(errno));
    }
    return fd;
}

std::uint16_t port_of(const FileDescriptor& fd) {
    sockaddr_storage address{};
    socklen_t size = sizeof address;
    ::getsockname(fd.get(), reinterpret_cast<sockaddr*>(&address), &size);
    return ntohs(address.ss_family == AF_INET6
                     ? reinterpret_cast<const sockaddr_in6&>(address).sin6_port
                     : reinterpret_cast<const sockaddr_in&>(address).sin_port);
}

/// Sends small replies at once, and finds out about a client that dropped off the network: while
/// nothing is sent (a long poll) as well as while it owes us an acknowledgement. One that pauses is
/// left to ClientSocket.
void prepare(const FileDescriptor& connection, const Patience& patience) {
    const auto timeout = patience.pause + 10s;
    const auto set = [&connection](int level, int option, int value) {
        ::setsockopt(connection.get(), level, option, &value, sizeof value);
    };
    set(IPPROTO_TCP, TCP_NODELAY, 1);
    set(SOL_SOCKET, SO_KEEPALIVE, 1);
    set(IPPROTO_TCP, TCP_KEEPIDLE, 15);
    set(IPPROTO_TCP, TCP_KEEPINTVL, 5);
    set(IPPROTO_TCP, TCP_KEEPCNT, 3);
    set(IPPROTO_TCP, TCP_USER_TIMEOUT,
        static_cast<int>(std::chrono::milliseconds(timeout).count()));
}

}  // namespace

std::string sender_of(const sockaddr_storage& address) {
    std::array<char, INET6_ADDRSTRLEN> text{};
    if (address.ss_family != AF_INET6) {
        const auto& v4 = reinterpret_cast<const sockaddr_in&>(address);
        ::inet_ntop(AF_INET, &v4.sin_addr, text.data(), text.size());
        return text.data();
    }
    in6_addr v6 = reinterpret_cast<const sockaddr_in6&>(address).sin6_addr;
    if (IN6_IS_ADDR_V4MAPPED(&v6)) {
        ::inet_ntop(AF_INET, v6.s6_addr + 12, text.data(), text.size());
        return text.data();
    }
    std::fill(v6.s6_addr + 8, v6.s6_addr + 16, std::uint8_t{0});
    ::inet_ntop(AF_INET6, &v6, text.data(), text.size());
    return std::string(text.data()) + "/64";
}

GuardedServer::GuardedServer(const GuardedServerOptions& options, Application& application)
    : options_(options),
      application_(application),
      listener_(listen_on(options)),
      port_(port_of(listener_)) {
    const bool v6 = options.host.find(':') != std::string::npos;
    address_ = (v6 ? "[" + options.host + "]" : options.host) + ":" + std::to_string(port_);
    ensure_thread();  // one at least, where others have taken all that there are
    acceptor_ = std::jthread([this] { accept_loop(); });
}

GuardedServer::~GuardedServer() {
    drain_.raise();
    stop_.request_stop();
    abort_.raise();
    acceptor_.join();
    {
        const std::lock_guard lock(mutex_);
        ended_ = true;
    }
    arrived_.notify_all();
    threads_.clear();
}

bool GuardedServer::drain(std::chrono::milliseconds time) {
    drain_.raise();
    stop_.request_stop();
    std::unique_lock lock(mutex_);
    return left_.wait_for(lock, time, [this] { return by_address_.empty(); });
}

void GuardedServer::accept_loop() {
    std::vector<pollfd> polled;
    while (true) {
        polled = {{drain_.fd(), POLLIN, 0}, {listener_.get(), POLLIN, 0}};
        for (const Farewell& farewell : farewells_)
            polled.push_back({farewell.fd.get(), POLLIN, 0});
        ::poll(polled.data(), polled.size(), farewells_.empty() ? -1 : 100);
        if (polled[0].revents != 0) break;
        if (polled[1].revents != 0) {
            try {
                accept_one();
            } catch (const std::exception& error) {
                spdlog::error("http.not_accepted error={}", log_text(error.what()));
            }
        }

        const auto now = std::chrono::steady_clock::now();
        std::erase_if(farewells_, [now](const Farewell& farewell) {
            std::array<char, 4096> discarded;
            const ssize_t n =
                ::recv(farewell.fd.get(), discarded.data(), discarded.size(), MSG_DONTWAIT);
            return n == 0 || now >= farewell.until;
        });
    }
    listener_ = FileDescriptor();
    farewells_.clear();
}

void GuardedServer::accept_one() {
    sockaddr_storage address{};
    socklen_t size = sizeof address;
    FileDescriptor fd(::accept4(listener_.get(), reinterpret_cast<sockaddr*>(&address), &size,
                                SOCK_CLOEXEC | SOCK_NONBLOCK));
    if (!fd) {
        // Out of descriptors: the connection stays in the backlog; without a pause this would be a
        // busy loop.
        if (errno == EMFILE || errno == ENFILE || errno == ENOMEM) ::poll(nullptr, 0, 50);
        return;
    }
    prepare(fd, options_.patience);

    const std::string sender = sender_of(address);
    if (!leaves_descriptors(fd, false)) return turn_away(std::move(fd), sender);
    Accepted accepted{admit(sender), std::move(fd)};
    if (!accepted.place || !ensure_thread()) return turn_away(std::move(accepted.fd), sender);
    const std::lock_guard lock(mutex_);
    waiting_.push_back(std::move(accepted));
    arrived_.notify_one();
}

/// Whether there is an idle thread for one connection more; starts one where there is none, as far
/// as the system lets it.
bool GuardedServer::ensure_thread() {
    const std::lock_guard lock(mutex_);
    if (idle_ > waiting_.size()) return true;
    try {
        threads_.emplace_back([this] { serve_loop(); });
    } catch (const std::system_error&) {
        return false;
    }
    return true;
}

/// Whether enough descriptors stay free beside this one: the system gives the lowest free number,
/// so that the number tells how many are taken. Files that connections open and the health check
/// need some: half as many as there may be connections, or a part of a low limit; farewells may
/// take a quarter of those.
bool GuardedServer::leaves_descriptors(const FileDescriptor& newest, bool farewell) const noexcept {
    rlimit limit{};
    ::getrlimit(RLIMIT_NOFILE, &limit);
    const rlim_t spare =
        std::min<rlim_t>(options_.max_connections / 2, limit.rlim_cur / options_.free_of_few);
    const rlim_t kept = farewell ? spare - spare / 4 : spare;
    return static_cast<rlim_t>(newest.get()) < limit.rlim_cur - kept;
}

/// None where a cap is reached.
GuardedServer::Place GuardedServer::admit(std::string address) {
    const std::lock_guard lock(mutex_);
    if (open_ >= options_.max_connections) return {};
    unsigned& here = by_address_[address];
    if (here >= options_.max_connections_per_address) return {};
    ++here;
    ++open_;
    return {*this, std::move(address)};
}

void GuardedServer::turn_away(FileDescriptor fd, std::string_view address) {
    proto::Problem problem =
        proto::problem_from_status(503, "too many connections: try again in a second");
    problem.retry_after = 1;
    const std::string words = refusal(application_, problem, address);
    // A new connection's buffer takes so little at once; one that does not is not worth waiting
    // for.
    if (::send(fd.get(), words.data(), words.size(), MSG_NOSIGNAL | MSG_DONTWAIT) < 0) return;
    ::shutdown(fd.get(), SHUT_WR);
    if (!leaves_descriptors(fd, true)) return;
    if (farewells_.size() == kMaxFarewells) farewells_.erase(farewells_.begin());
    farewells_.push_back({std::move(fd), std::chrono::steady_clock::now() + kFarewell});
}

void GuardedServer::serve_loop() {
    while (true) {
        Accepted accepted;
        {
            std::unique_lock lock(mutex_);
            ++idle_;
            arrived_.wait(lock, [this] { return ended_ || !waiting_.empty(); });
            --idle_;
            if (waiting_.empty()) return;
            accepted = std::move(waiting_.front());
            waiting_.pop_front();
        }
        serve(std::move(accepted));
    }
}

/// A failure that nothing foresaw, as when memory runs out, ends this connection alone.
void GuardedServer::serve(Accepted accepted) noexcept try {
    ClientSocket socket(std::move(accepted.fd), accepted.place.address(), options_.patience, drain_,
                        abort_);
    serve_connection(socket, application_, drain_, stop_.get_token());
} catch (const std::exception& error) {
    spdlog::error("http.connection_failed error={}", log_text(error.what()));
}

void GuardedServer::leave(const std::string& address) noexcept {
    const std::lock_guard lock(mutex_);
    const auto here = by_address_.find(address);
    if (--here->second == 0) by_address_.erase(here);
    --open_;
    if (by_address_.empty()) left_.notify_all();
}

}  // namespace stipple::server::http
