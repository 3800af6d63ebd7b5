#pragma once

#include "support/support.hpp"

#include <sys/types.h>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace stipple::test {

/// The processes that a process started and has not reaped.
std::vector<pid_t> children_of(pid_t pid);

/// A real `stippled` on free ports of 127.0.0.1 and a data folder of its own; killed at the end.
class StippledProcess {
public:
    /// Starts it and waits until it is ready. @param arguments  further ones of `stippled serve`,
    /// or others for `--listen`, `--admin` and `--data`.
    explicit StippledProcess(std::vector<std::string> arguments = {});
    ~StippledProcess();
    StippledProcess(const StippledProcess&) = delete;
    StippledProcess& operator=(const StippledProcess&) = delete;

    std::string url() const { return "http://" + address_; }
    std::uint16_t port() const;  ///< of the API; 0 for a worker alone
    std::uint16_t admin_port() const noexcept { return admin_port_; }
    pid_t pid() const noexcept { return pid_; }
    const std::filesystem::path& data() const noexcept { return folder_.path(); }

    /// SIGKILL: as if the machine had lost its power.
    void kill();
    /// SIGTERM, or another signal; the exit status, or nothing when it had to be killed after
    /// `patience`.
    std::optional<int> stop(std::chrono::seconds patience = std::chrono::seconds(60),
                            int signal = SIGTERM);
    /// Starts it again on the same data, on new ports.
    void restart();

    /// Resident memory now, and at most so far.
    std::uint64_t memory_bytes() const;
    std::uint64_t peak_memory_bytes() const;

private:
    void start();
    std::uint64_t status_bytes(const std::string& field) const;

    const std::vector<std::string> arguments_;
    TemporaryFolder folder_;
    pid_t pid_ = -1;
    std::string address_;
    std::uint16_t admin_port_ = 0;
    std::jthread drain_;  ///< of its log; ends with it
};

/// One reply, as it came.
struct HttpReply {
    int status = 0;  ///< 0: none came
    std::string head, body;
    /// The value of a field of the head; empty when there is none.
    std::string field(const std::string& name) const;
};

/// A connection that sends exactly the bytes it is told to.
class RawConnection {
public:
    /// @param from  one of this machine's own addresses, `127.0.0.2`.
    explicit RawConnection(std::uint16_t port, const char* from = nullptr);
    ~RawConnection();
    RawConnection(const RawConnection&) = delete;
    RawConnection& operator=(const RawConnection&) = delete;

    /// False once the other side has closed.
    bool send(std::string_view bytes);
    /// The next reply; with status 0 when the connection ended, or nothing came for `patience`.
    HttpReply receive(std::chrono::seconds patience = std::chrono::seconds(60),
                      bool has_body = true);
    /// Whether the other side has closed, at the latest after `patience`.
    bool closed_within(std::chrono::seconds patience);
    void close();

private:
    bool read_more(std::chrono::steady_clock::time_point deadline);
    int fd_ = -1;
    std::string received_;
};

/// One request on a connection of its own. `fields` are whole lines without their ends.
HttpReply request(std::uint16_t port, const std::string& method, const std::string& target,
                  const std::string& body = {}, const std::vector<std::string>& fields = {});

}  // namespace stipple::test
