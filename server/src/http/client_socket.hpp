#pragma once

#include "http/message.hpp"
#include "stop_event.hpp"
#include "store/posix_file.hpp"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace stipple::server::http {

/// How long we wait for the other side. A head has a deadline. A body may keep us waiting for
/// `silence` at first, a reply for `grace`, and each of their bytes adds what it takes at the
/// slowest rate; no more than `silence` of a sender, or `pause` of a reader, is saved up, whatever
/// came before.
struct Patience {
    std::chrono::milliseconds head{5'000};         ///< for a whole head, from its first byte on
    std::chrono::milliseconds keep_alive{10'000};  ///< between two requests
    std::chrono::milliseconds grace{10'000};
    std::chrono::milliseconds silence{20'000};
    /// The longer since we hear of what was read in lumps only, of 200 kB or so.
    std::chrono::milliseconds pause{60'000};
    std::uint64_t min_bytes_per_second = 4096;
};

/// A connection to a client that may be slow, silent or hostile.
class ClientSocket {
public:
    /// @param drain  ends the wait for a next request;  @param abort  ends every wait.
    ClientSocket(FileDescriptor fd, std::string address, const Patience& patience,
                 const StopEvent& drain, const StopEvent& abort);

    const std::string& address() const noexcept { return address_; }

    /// Begins a request: the rates are counted anew.
    void begin_exchange() noexcept;

    /// Up to and without the empty line; nothing when the client left or stayed silent, or the
    /// server drains, before its first byte.
    /// @throws HttpError (408, 414, 431), Disconnected.
    std::optional<std::string> read_head();

    /// Some bytes of the body, at least one. @throws HttpError(408) below the slowest rate,
    /// Disconnected.
    std::size_t read_some(std::span<std::byte> out);

    /// @throws Disconnected also when the client takes the bytes too slowly. Those that wait in
    /// the kernel are not taken.
    void write_all(std::string_view bytes);

    /// Whether the client has closed the connection, as far as is known without waiting, or `abort`
    /// has cut it.
    bool peer_gone() const noexcept;

    /// Ends our side and takes what still comes, until the client ends its own, is silent for two
    /// seconds, or half a minute has passed: a client that sends a whole body before it reads would
    /// lose our last words to a reset.
    /// @param to_come  of the body, as announced; without, 16 MiB are taken at most.
    void close_gently(std::uint64_t to_come = 0) noexcept;

    /// Has the connection end by a reset, so that the client takes nothing for whole.
    void end_by_reset() noexcept;

private:
    using Clock = std::chrono::steady_clock;
    enum class Waited { Ready, TimedOut, Stopped };
    Waited wait_for(short events, Clock::time_point deadline, bool between_requests) const;
    /// 0 at the end of the stream; between requests also when nothing came in time.
    std::size_t receive(std::span<char> out, Clock::time_point deadline,
                        bool between_requests) const;
    void wait_until_writable();
    /// For so many bytes that moved the client may keep us waiting longer.
    void earn(Clock::duration& time, std::uint64_t bytes, Clock::duration most) const noexcept;

    FileDescriptor fd_;
    const std::string address_;
    const Patience& patience_;
    const StopEvent& drain_;
    const StopEvent& abort_;
    std::string received_;                        ///< read from the socket, not yet used
    Clock::duration body_time_{}, reply_time_{};  ///< that we still wait
    std::uint64_t handed_over_ = 0;               ///< bytes of replies, to the kernel
    std::uint64_t taken_in_ = 0;                  ///< of these by the client
};

}  // namespace stipple::server::http
