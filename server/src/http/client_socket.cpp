#include "http/client_socket.hpp"

#include "http/request_head.hpp"

#include <linux/sockios.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace stipple::server::http {

namespace {

using namespace std::chrono_literals;

constexpr std::size_t kReceiveBytes = 16 * 1024;
constexpr auto kLookAtClient = 1000ms;

/// Bytes handed to the kernel that the client has not acknowledged.
std::uint64_t unacknowledged(const FileDescriptor& socket) noexcept {
    int bytes = 0;
    return ::ioctl(socket.get(), SIOCOUTQ, &bytes) == 0 ? static_cast<std::uint64_t>(bytes) : 0;
}

}  // namespace

ClientSocket::ClientSocket(FileDescriptor fd, std::string address, const Patience& patience,
                           const StopEvent& drain, const StopEvent& abort)
    : fd_(std::move(fd)),
      address_(std::move(address)),
      patience_(patience),
      drain_(drain),
      abort_(abort) {}

void ClientSocket::begin_exchange() noexcept {
    body_time_ = patience_.silence;
    reply_time_ = patience_.grace;
}

std::optional<std::string> ClientSocket::read_head() {
    auto deadline = Clock::now() + patience_.keep_alive;
    bool has_begun = false, is_forgiven = false;
    std::size_t searched = 0;
    std::array<char, kReceiveBytes> piece;
    while (true) {
        // One empty line before the request line is forgiven (RFC 9112 §2.2).
        if (!is_forgiven && received_.starts_with("\r\n")) {
            received_.erase(0, 2);
            is_forgiven = true;
        }
        if (!has_begun && !received_.empty()) {
            has_begun = true;
            deadline = Clock::now() + patience_.head;
        }
        const auto end = received_.find("\r\n\r\n", searched);
        check_head_size(std::string_view(received_).substr(0, end));
        if (end != received_.npos) {
            std::string head = received_.substr(0, end);
            received_.erase(0, end + 4);
            return head;
        }
        searched = received_.size() < 3 ? 0 : received_.size() - 3;

        const std::size_t n = receive(piece, deadline, !has_begun);
        if (n == 0 && !has_begun) return std::nullopt;
        if (n == 0) throw Disconnected();
        received_.append(piece.data(), n);
    }
}

std::size_t ClientSocket::read_some(std::span<std::byte> out) {
    const auto take = [this](std::span<char> to) {
        const auto begin = Clock::now();
        const std::size_t came = receive(to, begin + body_time_, false);
        body_time_ -= Clock::now() - begin;
        if (came == 0) throw Disconnected();
        return came;
    };
    // Byte by byte, as lines are read, each would cost two calls of the system.
    constexpr std::size_t kFew = 512, kAhead = 4096;
    if (received_.empty() && out.size() <= kFew) {
        std::array<char, kAhead> ahead;
        received_.assign(ahead.data(), take(ahead));
    }
    std::size_t n = std::min(out.size(), received_.size());
    if (n > 0) {
        std::memcpy(out.data(), received_.data(), n);
        received_.erase(0, n);
    } else {
        n = take({reinterpret_cast<char*>(out.data()), out.size()});
    }
    earn(body_time_, n, patience_.silence);
    return n;
}

void ClientSocket::write_all(std::string_view bytes) {
    while (!bytes.empty()) {
        const ssize_t sent =
            ::send(fd_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent > 0) {
            bytes.remove_prefix(static_cast<std::size_t>(sent));
            handed_over_ += static_cast<std::uint64_t>(sent);
            continue;
        }
        if (errno == EINTR) continue;
        if (errno != EAGAIN && errno != EWOULDBLOCK) throw Disconnected();
        wait_until_writable();
    }
}

/// The kernel lets us write again only when a good part of its buffer is free: a client that reads
/// on meanwhile is seen by what it acknowledges. From here on that alone decides: the kernel's own
/// timeout takes the pauses of a reader with a small buffer for a single one.
void ClientSocket::wait_until_writable() {
    const unsigned none = 0;
    ::setsockopt(fd_.get(), IPPROTO_TCP, TCP_USER_TIMEOUT, &none, sizeof none);
    while (true) {
        const auto begin = Clock::now();
        const Waited waited =
            wait_for(POLLOUT, begin + std::min<Clock::duration>(reply_time_, kLookAtClient), false);
        reply_time_ -= Clock::now() - begin;
        const std::uint64_t left = unacknowledged(fd_);
        if (handed_over_ > taken_in_ + left) {
            earn(reply_time_, handed_over_ - left - taken_in_, patience_.pause);
            taken_in_ = handed_over_ - left;
        }
        if (waited == Waited::Ready) return;
        if (waited == Waited::Stopped || reply_time_ <= 0ms) throw Disconnected();
    }
}

bool ClientSocket::peer_gone() const noexcept {
    if (abort_.raised()) return true;
    // The end of what it sends is seen behind bytes that nobody has read, too.
    pollfd polled{fd_.get(), POLLRDHUP, 0};
    return ::poll(&polled, 1, 0) > 0 && polled.revents != 0;
}

void ClientSocket::close_gently(std::uint64_t to_come) noexcept {
    constexpr auto kLongest = 30s, kSilence = 2s;
    constexpr std::uint64_t kUnannounced = 16U << 20;
    ::shutdown(fd_.get(), SHUT_WR);
    const auto end = Clock::now() + kLongest;
    const std::uint64_t most = std::max(to_come, kUnannounced);
    std::array<char, 16 * 1024> discarded;
    for (std::uint64_t bytes = 0; bytes < most && Clock::now() < end && !abort_.raised();) {
        const ssize_t n = ::recv(fd_.get(), discarded.data(), discarded.size(), MSG_DONTWAIT);
        if (n > 0) {
            bytes += static_cast<std::uint64_t>(n);
            continue;
        }
        const bool later = n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR);
        if (!later || wait_for(POLLIN, Clock::now() + kSilence, false) != Waited::Ready) return;
    }
}

void ClientSocket::end_by_reset() noexcept {
    const linger at_once{.l_onoff = 1, .l_linger = 0};
    ::setsockopt(fd_.get(), SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
}

ClientSocket::Waited ClientSocket::wait_for(short events, Clock::time_point deadline,
                                            bool between_requests) const {
    std::array<pollfd, 3> polled = {pollfd{fd_.get(), events, 0}, pollfd{abort_.fd(), POLLIN, 0},
                                    pollfd{drain_.fd(), POLLIN, 0}};
    const nfds_t count = between_requests ? 3 : 2;
    while (true) {
        const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
        if (left <= 0ms) return Waited::TimedOut;
        const int ready =
            ::poll(polled.data(), count, static_cast<int>(std::min(left, 60'000ms).count()));
        if (ready < 0 && errno != EINTR) return Waited::Stopped;
        if (ready <= 0) continue;
        if (polled[1].revents != 0) return Waited::Stopped;
        // What the client has already sent is served, even when the server begins to drain.
        return polled[0].revents != 0 ? Waited::Ready : Waited::Stopped;
    }
}

std::size_t ClientSocket::receive(std::span<char> out, Clock::time_point deadline,
                                  bool between_requests) const {
    while (true) {
        const Waited waited = wait_for(POLLIN, deadline, between_requests);
        if (waited != Waited::Ready && between_requests) return 0;
        if (waited == Waited::Stopped) throw Disconnected();
        if (waited == Waited::TimedOut) {
            throw HttpError(408, "the request was too slow: a head may take " +
                                     std::to_string(patience_.head.count()) + " ms, a body needs " +
                                     std::to_string(patience_.min_bytes_per_second) +
                                     " bytes per second, without a pause of " +
                                     std::to_string(patience_.silence.count()) + " ms");
        }
        const ssize_t n = ::recv(fd_.get(), out.data(), out.size(), MSG_DONTWAIT);
        if (n >= 0) return static_cast<std::size_t>(n);
        if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR) throw Disconnected();
    }
}

void ClientSocket::earn(Clock::duration& time, std::uint64_t bytes,
                        Clock::duration most) const noexcept {
    const std::chrono::duration<double> earned(static_cast<double>(bytes) /
                                               static_cast<double>(patience_.min_bytes_per_second));
    const auto added = std::min<std::chrono::duration<double>>(earned, most);
    time = std::min(time + std::chrono::duration_cast<Clock::duration>(added), most);
}

}  // namespace stipple::server::http
