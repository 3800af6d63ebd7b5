#pragma once

#include "http/connection.hpp"

#include <sys/socket.h>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace stipple::server::http {

/// Who a connection counts for: an IPv4 address, or the network that one owner of IPv6 addresses
/// has, `2001:db8:1:2::/64`.
std::string sender_of(const sockaddr_storage& address);

struct GuardedServerOptions {
    std::string host = "127.0.0.1";
    std::uint16_t port = 0;  ///< 0: any that is free
    unsigned max_connections = 512;
    unsigned max_connections_per_address = 128;
    unsigned free_of_few = 2;  ///< where there are few file descriptors, one in so many stays free
    Patience patience;
};

/// Accepts connections and serves each on a thread of its own; there are never more connections
/// than threads, so none waits for another. Above a cap, or where the system gives no thread more
/// or few file descriptors are left, a connection is answered 503 by the accepting thread, before a
/// byte of it is read.
class GuardedServer {
public:
    /// Listens at once: @throws Error(InvalidArgument) naming the address when that fails.
    GuardedServer(const GuardedServerOptions& options, Application& application);
    /// Stops at once what `drain` did not end.
    ~GuardedServer();

    /// As chosen: `127.0.0.1:41234`.
    const std::string& address() const noexcept { return address_; }
    std::uint16_t port() const noexcept { return port_; }
    unsigned connections() const noexcept { return open_.load(std::memory_order_relaxed); }

    /// Takes no new connection, lets requests under way end, streams and long polls at once; true
    /// when all have within `time`.
    bool drain(std::chrono::milliseconds time);

private:
    /// What a connection takes of the caps; given back at its end, however that comes.
    class Place {
    public:
        Place() = default;
        Place(GuardedServer& server, std::string address)
            : server_(&server), address_(std::move(address)) {}
        Place(Place&& other) noexcept
            : server_(std::exchange(other.server_, nullptr)), address_(std::move(other.address_)) {}
        Place& operator=(Place&& other) noexcept {
            std::swap(server_, other.server_);
            std::swap(address_, other.address_);
            return *this;
        }
        ~Place() {
            if (server_ != nullptr) server_->leave(address_);
        }

        const std::string& address() const noexcept { return address_; }
        explicit operator bool() const noexcept { return server_ != nullptr; }

    private:
        GuardedServer* server_ = nullptr;
        std::string address_;
    };
    struct Accepted {
        Place place;  ///< first: given back after the connection is closed
        FileDescriptor fd;
    };
    struct Farewell {
        FileDescriptor fd;
        std::chrono::steady_clock::time_point until;
    };
    void accept_loop();
    void accept_one();
    Place admit(std::string address);
    bool leaves_descriptors(const FileDescriptor& newest, bool farewell) const noexcept;
    bool ensure_thread();
    void turn_away(FileDescriptor fd, std::string_view address);
    void serve_loop();
    void serve(Accepted accepted) noexcept;
    void leave(const std::string& address) noexcept;

    const GuardedServerOptions options_;
    Application& application_;
    StopEvent drain_, abort_;
    std::stop_source stop_;
    FileDescriptor listener_;
    std::string address_;
    std::uint16_t port_ = 0;
    std::vector<Farewell> farewells_;  ///< of the accepting thread only

    std::atomic<unsigned> open_ = 0;
    std::mutex mutex_;  ///< for all below
    std::condition_variable arrived_, left_;
    std::map<std::string, unsigned> by_address_;
    std::deque<Accepted> waiting_;
    unsigned idle_ = 0;
    bool ended_ = false;
    std::vector<std::jthread> threads_;
    std::jthread acceptor_;
};

}  // namespace stipple::server::http
