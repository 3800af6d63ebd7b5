#include "support/stippled_process.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#include <algorithm>
#include <array>
#include <csignal>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>
#include <utility>

extern char** environ;

namespace stipple::test {

namespace {

using namespace std::chrono_literals;
using std::chrono::steady_clock;

constexpr auto kStartPatience = 60s;

/// Waits for bytes, the end or an error. False at the deadline.
bool readable(int fd, steady_clock::time_point deadline) {
    pollfd polled{fd, POLLIN, 0};
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - steady_clock::now());
    return left > 0ms && ::poll(&polled, 1, static_cast<int>(left.count())) > 0;
}

/// `127.0.0.1:8080` of `api=http://127.0.0.1:8080`.
std::string address_after(const std::string& line, const std::string& key) {
    const auto begin = line.find(key) + key.size();
    return line.substr(begin, line.find_first_of(" \n", begin) - begin);
}

/// 0 where nothing listens.
std::uint16_t port_of(const std::string& address) {
    const auto colon = address.rfind(':');
    return colon == address.npos
               ? std::uint16_t{0}
               : static_cast<std::uint16_t>(std::stoul(address.substr(colon + 1)));
}

/// The chunks of a chunked body, joined; nothing when it is not whole yet.
std::optional<std::string> join_chunks(const std::string& bytes, std::size_t& used) {
    std::string body;
    for (used = 0;;) {
        const auto end = bytes.find("\r\n", used);
        if (end == bytes.npos) return std::nullopt;
        const std::size_t size = std::stoul(bytes.substr(used, end - used), nullptr, 16);
        if (bytes.size() < end + 2 + size + 2) return std::nullopt;
        body += bytes.substr(end + 2, size);
        used = end + 2 + size + 2;
        if (size == 0) return body;
    }
}

}  // namespace

std::vector<pid_t> children_of(pid_t pid) {
    std::vector<pid_t> children;
    const std::filesystem::path threads = "/proc/" + std::to_string(pid) + "/task";
    for (const auto& thread : std::filesystem::directory_iterator(threads)) {
        std::ifstream in(thread.path() / "children");
        for (pid_t child = 0; in >> child;) children.push_back(child);
    }
    return children;
}

StippledProcess::StippledProcess(std::vector<std::string> arguments)
    : arguments_(std::move(arguments)) {
    start();
}

StippledProcess::~StippledProcess() {
    kill();
}

void StippledProcess::start() {
    std::vector<std::string> words = {program("stippled").string(), "serve"};
    const auto unless_given = [&](const std::string& flag, const std::string& value) {
        if (std::ranges::find(arguments_, flag) == arguments_.end())
            words.insert(words.end(), {flag, value});
    };
    unless_given("--listen", "127.0.0.1:0");
    unless_given("--admin", "127.0.0.1:0");
    unless_given("--data", data().string());
    words.insert(words.end(), arguments_.begin(), arguments_.end());
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);

    std::array<int, 2> pipe{};
    if (::pipe2(pipe.data(), O_CLOEXEC) != 0) throw std::runtime_error("pipe2");
    posix_spawn_file_actions_t actions;
    ::posix_spawn_file_actions_init(&actions);
    ::posix_spawn_file_actions_adddup2(&actions, pipe[1], STDOUT_FILENO);
    const int failed = ::posix_spawn(&pid_, argv[0], &actions, nullptr, argv.data(), environ);
    ::posix_spawn_file_actions_destroy(&actions);
    ::close(pipe[1]);
    if (failed != 0) throw std::runtime_error("cannot start " + words[0]);

    std::string output;
    const auto deadline = steady_clock::now() + kStartPatience;
    std::size_t line = output.npos;
    while ((line = output.find("stippled is ready")) == output.npos ||
           output.find('\n', line) == output.npos) {
        std::array<char, 512> piece;
        const ssize_t n =
            readable(pipe[0], deadline) ? ::read(pipe[0], piece.data(), piece.size()) : 0;
        if (n <= 0) {
            ::close(pipe[0]);
            throw std::runtime_error("stippled did not become ready: " + output);
        }
        output.append(piece.data(), static_cast<std::size_t>(n));
    }
    address_ = address_after(output.substr(line), "api=http://");
    admin_port_ = port_of(address_after(output.substr(line), "admin=http://"));
    // Its log goes on into the pipe: drained in the background until it ends.
    drain_ = std::jthread([fd = pipe[0]] {
        std::array<char, 4096> piece;
        while (::read(fd, piece.data(), piece.size()) > 0) {
        }
        ::close(fd);
    });
}

std::uint16_t StippledProcess::port() const {
    return port_of(address_);
}

void StippledProcess::kill() {
    if (pid_ < 0) return;
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
    pid_ = -1;
}

std::optional<int> StippledProcess::stop(std::chrono::seconds patience, int signal) {
    ::kill(pid_, signal);
    for (const auto deadline = steady_clock::now() + patience; steady_clock::now() < deadline;) {
        int status = 0;
        if (::waitpid(pid_, &status, WNOHANG) == pid_) {
            pid_ = -1;
            return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
        }
        std::this_thread::sleep_for(10ms);
    }
    kill();
    return std::nullopt;
}

void StippledProcess::restart() {
    kill();
    start();
}

std::uint64_t StippledProcess::memory_bytes() const {
    return status_bytes("VmRSS:");
}
std::uint64_t StippledProcess::peak_memory_bytes() const {
    return status_bytes("VmHWM:");
}

std::uint64_t StippledProcess::status_bytes(const std::string& field) const {
    std::ifstream status("/proc/" + std::to_string(pid_) + "/status");
    for (std::string line; std::getline(status, line);)
        if (line.starts_with(field)) return std::stoull(line.substr(field.size())) * 1024;
    throw std::runtime_error("no " + field + " of process " + std::to_string(pid_));
}

std::string HttpReply::field(const std::string& name) const {
    std::istringstream lines(head);
    for (std::string line; std::getline(lines, line);) {
        const auto colon = line.find(": ");
        if (colon == line.npos || colon != name.size()) continue;
        const bool same = std::equal(
            name.begin(), name.end(), line.begin(),
            [](unsigned char a, unsigned char b) { return std::tolower(a) == std::tolower(b); });
        if (same)
            return line.substr(colon + 2, line.size() - colon - 2 - (line.ends_with('\r') ? 1 : 0));
    }
    return {};
}

RawConnection::RawConnection(std::uint16_t port, const char* from)
    : fd_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    if (from != nullptr) {
        ::inet_pton(AF_INET, from, &address.sin_addr);
        if (::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
            throw std::runtime_error(std::string("cannot connect from ") + from);
    }
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
        throw std::runtime_error("cannot connect to port " + std::to_string(port));
    }
}

RawConnection::~RawConnection() {
    close();
}

void RawConnection::close() {
    if (fd_ >= 0) ::close(fd_);
    fd_ = -1;
}

bool RawConnection::send(std::string_view bytes) {
    while (!bytes.empty()) {
        const ssize_t n = ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
        if (n <= 0) return false;
        bytes.remove_prefix(static_cast<std::size_t>(n));
    }
    return true;
}

bool RawConnection::read_more(steady_clock::time_point deadline) {
    std::array<char, 64 * 1024> piece;
    const ssize_t n = readable(fd_, deadline) ? ::recv(fd_, piece.data(), piece.size(), 0) : -1;
    if (n > 0) received_.append(piece.data(), static_cast<std::size_t>(n));
    return n > 0;
}

HttpReply RawConnection::receive(std::chrono::seconds patience, bool has_body) {
    const auto deadline = steady_clock::now() + patience;
    std::size_t end = 0;
    while ((end = received_.find("\r\n\r\n")) == received_.npos)
        if (!read_more(deadline)) return {};
    HttpReply reply;
    reply.head = received_.substr(0, end + 2);
    reply.status = std::stoi(reply.head.substr(9, 3));
    received_.erase(0, end + 4);
    if (!has_body || reply.status == 100 || reply.status == 304) return reply;

    if (reply.field("Transfer-Encoding") == "chunked") {
        std::size_t used = 0;
        auto body = join_chunks(received_, used);
        while (!body) {
            if (!read_more(deadline)) return {};
            body = join_chunks(received_, used);
        }
        reply.body = *body;
        received_.erase(0, used);
        return reply;
    }
    const std::string length = reply.field("Content-Length");
    if (length.empty() && reply.status == 200) {  // it ends with the connection
        while (read_more(deadline)) {
        }
        reply.body = std::exchange(received_, {});
        return reply;
    }
    const std::size_t size = length.empty() ? 0 : std::stoul(length);
    while (received_.size() < size)
        if (!read_more(deadline)) return {};
    reply.body = received_.substr(0, size);
    received_.erase(0, size);
    return reply;
}

bool RawConnection::closed_within(std::chrono::seconds patience) {
    const auto deadline = steady_clock::now() + patience;
    std::array<char, 4096> piece;
    while (readable(fd_, deadline))
        if (::recv(fd_, piece.data(), piece.size(), 0) <= 0) return true;
    return false;
}

HttpReply request(std::uint16_t port, const std::string& method, const std::string& target,
                  const std::string& body, const std::vector<std::string>& fields) {
    std::string head = method + " " + target +
                       " HTTP/1.1\r\nHost: 127.0.0.1:" + std::to_string(port) +
                       "\r\nConnection: close\r\n";
    for (const std::string& field : fields) head += field + "\r\n";
    if (method == "POST") head += "Content-Length: " + std::to_string(body.size()) + "\r\n";
    RawConnection connection(port);
    connection.send(head + "\r\n");
    connection.send(body);
    return connection.receive(120s, method != "HEAD");
}

}  // namespace stipple::test
