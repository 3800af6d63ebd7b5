#pragma once

#include "service/service.hpp"

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace stipple::server {

/// Where a listener is bound.
struct ListenAddress {
    std::string host = "127.0.0.1";
    std::uint16_t port = 0;  ///< 0: any that is free
};
/// Of `HOST:PORT` or `[V6]:PORT`. @throws Error(InvalidArgument).
ListenAddress parse_address(const std::string& text);
bool is_loopback(const ListenAddress& address);

enum class Role { All, Api, Worker };
/// What of the service a process of this role is: `api`, `worker` or both.
std::vector<std::string> parts_of(Role role);

/// What `stippled serve` runs with: from flags, a file (`--config`) and the environment
/// (`STIPPLE_LISTEN` for `--listen`), in this order. Checked once, here.
struct ServerConfig {
    ListenAddress listen{"127.0.0.1", 8080};
    ListenAddress admin{"127.0.0.1", 8081};
    std::filesystem::path data;
    Role role = Role::All;

    unsigned workers = 1;  ///< jobs at a time
    unsigned threads = 0;  ///< of a job; 0: all processors
    Limits limits;

    unsigned max_connections = 512;
    unsigned max_connections_per_address = 128;
    std::uint64_t min_bytes_per_second = 4096;  ///< of a client that sends or takes
    std::chrono::seconds drain_timeout{30};

    std::optional<std::filesystem::path> api_keys;
    bool insecure_no_auth = false;
    std::vector<std::string> cors_origins;
    std::string path_prefix;              ///< of all paths, under which a proxy offers the service
    std::vector<std::string> host_names;  ///< by which a server for this machine alone is reached
    std::string log_level = "info";
};

/// What the command line asks for.
struct Command {
    enum class Kind { Serve, Healthcheck, Scrub } kind = Kind::Serve;
    ServerConfig config;  ///< of Healthcheck only `admin`, of Scrub only `data`
};

/// @throws Error(InvalidArgument) saying what is wrong and how to mend it. A call for help or the
/// version prints it and returns nothing.
std::optional<Command> parse_command_line(int argc, const char* const* argv);

}  // namespace stipple::server
