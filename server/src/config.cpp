#include "config.hpp"

#include "stipple/error.hpp"
#include "stipple/proto/byte_size.hpp"

#include <arpa/inet.h>
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdlib>
#include <iostream>
#include <map>
#include <type_traits>

namespace stipple::server {

namespace {

constexpr std::uint64_t kDay = 24 * 3600;
constexpr std::uint64_t kYear = 366 * kDay;
constexpr std::uint64_t kMostBytes = 1000ULL * 1000'000'000'000;
constexpr std::uint64_t kMostCount = 1ULL << 32U;  // of points, and of what there is one a job of
/// With less the job process cannot even read the smallest cloud.
constexpr std::uint64_t kLeastMemory = 100'000'000;

/// The flags as they are written, before they mean something.
struct Flags {
    std::string listen = "127.0.0.1:8080";
    std::string admin = "127.0.0.1:8081";
    std::string data;
    std::optional<std::string> api_keys;
    Role role = Role::All;
    std::uint64_t retention_seconds = 7 * kDay;
    std::uint64_t cloud_retention_seconds = 30 * kDay;
    std::uint64_t max_wait_seconds = 60;
    std::uint64_t drain_seconds = 30;
};

const std::map<std::string, Role> kRoles = {
    {"all", Role::All}, {"api", Role::Api}, {"worker", Role::Worker}};

/// `--max-upload` is also STIPPLE_MAX_UPLOAD.
std::string environment_name(std::string flag) {
    std::ranges::replace(flag, '-', '_');
    std::ranges::transform(flag, flag.begin(), [](unsigned char c) { return std::toupper(c); });
    return "STIPPLE" + flag.substr(1);
}

template <typename T>
CLI::Option* add(CLI::App& app, const std::string& flag, T& value, const std::string& help) {
    CLI::Option* const option =
        app.add_option(flag, value, help)->envname(environment_name(flag))->capture_default_str();
    return std::is_integral_v<T> ? option->type_name("N") : option;
}

/// A check that says what is expected of a value that it refuses. Help says it in words of its own:
/// what CLI11 makes of validators takes too long lines.
template <typename IsGood>
CLI::Validator expecting(const std::string& expected, IsGood is_good) {
    return CLI::Validator(
        [expected, is_good](const std::string& text) {
            return is_good(text) ? std::string() : text + ": expected " + expected;
        },
        "");
}

std::optional<std::uint64_t> number_in(const std::string& text) {
    std::uint64_t number = 0;
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, number);
    if (error != std::errc() || stop != end) return std::nullopt;
    return number;
}

CLI::Validator within(std::uint64_t least, std::uint64_t most) {
    return expecting(std::to_string(least) + ".." + std::to_string(most),
                     [least, most](const std::string& text) {
                         const auto number = number_in(text);
                         return number && least <= *number && *number <= most;
                     });
}

/// Turns sizes into numbers, which are then within a range.
void make_size(CLI::Option* option, std::uint64_t least, const std::string& least_text) {
    option->type_name("SIZE")->transform(CLI::Validator(
        [least, least_text](std::string& text) -> std::string {
            const auto bytes = proto::bytes_of_size(text, std::chars_format::fixed);
            if (!bytes || *bytes < least || *bytes > kMostBytes)
                return text + ": expected " + least_text + "..1000TB, as in 1.5GB or 512MiB";
            text = std::to_string(*bytes);
            return {};
        },
        ""));
}

constexpr std::string_view kOfDomains =
    "abcdefghijklmnopqrstuvwxyz0123456789.-_ABCDEFGHIJKLMNOPQRSTUVWXYZ";

bool has_only(std::string_view text, std::string_view characters) {
    return !text.empty() && text.find_first_not_of(characters) == text.npos;
}

/// Whether a browser can send it as `Origin`: one that it never sends would let nobody in.
bool is_origin(const std::string& text) {
    if (text == "*") return true;
    constexpr std::string_view kOfSchemes = "abcdefghijklmnopqrstuvwxyz0123456789+.-";
    constexpr std::string_view kOfHosts = "abcdefghijklmnopqrstuvwxyz0123456789.-_[:]";
    const auto end = text.find("://");
    if (end == text.npos) return false;
    const std::string scheme = text.substr(0, end);
    const std::string host = text.substr(end + 3);
    if (scheme == "https" && host.ends_with(":443")) return false;
    if (scheme == "http" && host.ends_with(":80")) return false;
    return has_only(scheme, kOfSchemes) && has_only(host, kOfHosts);
}

/// Whether every segment of it is one in an address as it stands.
bool is_path_prefix(const std::string& text) {
    if (!text.starts_with('/')) return text.empty();
    for (std::string_view rest = text; !rest.empty();) {
        rest.remove_prefix(1);
        const std::string_view segment = rest.substr(0, rest.find('/'));
        if (!has_only(segment, kOfDomains) || segment == "." || segment == "..") return false;
        rest.remove_prefix(segment.size());
    }
    return true;
}

void add_addresses(CLI::App& serve, Flags& flags) {
    add(serve, "--listen", flags.listen, "address of the API, HOST:PORT; port 0: any free");
    add(serve, "--admin", flags.admin, "address of /livez, /readyz and /metrics");
}

void add_work(CLI::App& serve, Flags& flags, ServerConfig& config) {
    add(serve, "--data", flags.data, "folder of the store; created if missing")->required();
    add(serve, "--role", flags.role, "all, api or worker")
        ->type_name("ROLE")
        ->default_str("all")
        ->transform(CLI::Validator(
            [](std::string& text) -> std::string {
                std::string name = text;
                for (char& c : name)
                    c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
                const auto role = kRoles.find(name);
                if (role == kRoles.end()) return text + ": expected all, api or worker";
                text = std::to_string(static_cast<int>(role->second));
                return {};
            },
            ""));
    add(serve, "--workers", config.workers, "concurrent jobs, 1..256")->check(within(1, 256));
    add(serve, "--threads", config.threads, "threads per job, 0..1024; 0: one per processor")
        ->check(within(0, 1024));
    add(serve, "--drain-timeout", flags.drain_seconds, "seconds to finish when stopping, 0..86400")
        ->check(within(0, kDay));
}

void add_limits(CLI::App& serve, Flags& flags, Limits& limits) {
    make_size(add(serve, "--max-upload", limits.max_upload_bytes, "largest upload, such as 2GB"), 0,
              "0");
    add(serve, "--max-points", limits.decode.max_points, "points per cloud, at least 1")
        ->check(within(1, kMostCount));
    add(serve, "--max-attributes", limits.decode.max_attributes, "attributes per cloud")
        ->check(within(0, kMostCount));
    make_size(add(serve, "--max-memory", limits.max_job_memory_bytes,
                  "memory per job, at least 100MB and the stacks\nof its threads, 4 MiB each"),
              kLeastMemory, "100MB");
    add(serve, "--max-cpu-seconds", limits.max_job_cpu_seconds,
        "processor seconds per job, at least 1")
        ->check(within(1, kYear));
    make_size(
        add(serve, "--max-output", limits.max_job_output_bytes, "output per job, at least 1kB"),
        1000, "1kB");
    add(serve, "--max-queued", limits.queue.max_queued, "waiting jobs per tenant")
        ->check(within(0, kMostCount));
    add(serve, "--max-running", limits.queue.max_running, "running jobs per tenant, at least 1")
        ->check(within(1, kMostCount));
    add(serve, "--retention-seconds", flags.retention_seconds,
        "how long a finished job is kept, up to a\nhundred years")
        ->check(within(0, 100 * kYear));
    add(serve, "--cloud-retention-seconds", flags.cloud_retention_seconds,
        "how long a cloud that is neither asked for nor\nnamed by a new job is kept; as long as "
        "finished\n"
        "jobs at least")
        ->check(within(0, 100 * kYear));
    add(serve, "--max-wait", flags.max_wait_seconds, "longest long poll, up to 3600 seconds")
        ->check(within(0, 3600));
}

void add_guards(CLI::App& serve, Flags& flags, ServerConfig& config) {
    add(serve, "--max-connections", config.max_connections, "connections in total, 8..20000")
        ->check(within(8, 20'000));
    add(serve, "--max-connections-per-address", config.max_connections_per_address,
        "connections per address; raise it behind a proxy")
        ->check(within(1, 20'000));
    add(serve, "--min-rate", config.min_bytes_per_second, "bytes per second of the slowest client")
        ->check(within(1, 1 << 30));
    add(serve, "--api-keys", flags.api_keys, "JSON file: a list of {tenant, key_sha256, scopes}")
        ->check(expecting("the name of a file: without one, whoever asks would be served",
                          [](const std::string& text) { return !text.empty(); }));
    serve.add_flag("--insecure-no-auth", config.insecure_no_auth,
                   "serve other machines without API keys");
    add(serve, "--cors-origin", config.cors_origins,
        "site whose scripts may use the API, such as\nhttps://example.org; may be repeated")
        ->check(expecting("an origin such as https://example.org, as browsers send it: without "
                          "path, capitals or default port; one per flag",
                          is_origin));
    add(serve, "--host-name", config.host_names,
        "domain that points to a server for this machine\nonly, as behind a proxy; may be repeated")
        ->check(expecting("a domain such as clouds.example.org, without scheme or port; one per "
                          "flag",
                          [](const std::string& text) { return has_only(text, kOfDomains); }));
    add(serve, "--path-prefix", config.path_prefix,
        "path under which a proxy offers the service,\nsuch as /stipple; requests may leave it out")
        ->check(expecting("a slash and letters, digits, '-', '_' or '.', as /stipple or "
                          "/scans/lab; no slash at the end",
                          is_path_prefix));
    add(serve, "--log-level", config.log_level, "debug, info, warn or error")
        ->check(CLI::IsMember({"debug", "info", "warn", "error"}).description(""));
}

/// CLI11 alone reads -1 as 2^64 - 1.
void refuse_signs(CLI::App& serve) {
    for (CLI::Option* const option : serve.get_options())
        option->transform(CLI::Validator(
            [](const std::string& text) {
                return text.starts_with('-') ? text + ": expected no sign" : std::string();
            },
            ""));
}

void finish(const Flags& flags, ServerConfig& config) {
    config.listen = parse_address(flags.listen);
    config.admin = parse_address(flags.admin);
    config.data = flags.data;
    config.role = flags.role;
    config.drain_timeout = std::chrono::seconds(flags.drain_seconds);
    config.limits.retention = std::chrono::seconds(flags.retention_seconds);
    config.limits.cloud_retention =
        std::max(std::chrono::seconds(flags.cloud_retention_seconds), config.limits.retention);
    config.limits.max_wait = std::chrono::seconds(flags.max_wait_seconds);
    if (flags.api_keys) config.api_keys = *flags.api_keys;
    // CLI11 takes an empty variable for none; it may be that of a secret that was forgotten.
    const char* const keys = std::getenv("STIPPLE_API_KEYS");
    if (!config.api_keys && keys != nullptr && *keys == '\0')
        throw Error(ErrorCode::InvalidArgument,
                    "STIPPLE_API_KEYS is empty: expected the name of a file, or no such variable");
    const std::uint64_t stacks = Limits::stacks_of(config.threads);
    if (config.limits.max_job_memory_bytes < stacks + kLeastMemory) {
        throw Error(ErrorCode::InvalidArgument,
                    "--threads " + std::to_string(config.threads) +
                        (config.threads == 0 ? " (one per processor)" : "") +
                        ": their stacks take " + std::to_string(stacks) +
                        " bytes of the job's memory: expected fewer, or "
                        "--max-memory of at least " +
                        std::to_string(stacks + kLeastMemory));
    }
    if (!config.api_keys && !config.insecure_no_auth && !is_loopback(config.listen)) {
        throw Error(ErrorCode::InvalidArgument,
                    "--listen " + flags.listen +
                        " can be reached from other machines: give --api-keys FILE, or "
                        "--insecure-no-auth if that is intended");
    }
}

/// A word that nobody knows, before what is missing for it.
[[noreturn]] void refuse_unknown(const std::string& word, const CLI::App* command) {
    const std::string help =
        "; see stippled " + (command ? command->get_name() + " " : std::string()) + "--help";
    throw Error(ErrorCode::InvalidArgument,
                word +
                    (command || word.starts_with('-')
                         ? ": no such flag"
                         : ": no such command: expected serve, healthcheck or scrub") +
                    help);
}

}  // namespace

ListenAddress parse_address(const std::string& text) {
    const auto colon = text.rfind(':');
    ListenAddress address;
    const char* const end = text.data() + text.size();
    const char* const port = colon == text.npos ? end : text.data() + colon + 1;
    const auto [stop, error] = std::from_chars(port, end, address.port);
    if (colon == 0 || error != std::errc() || stop != end) {
        throw Error(ErrorCode::InvalidArgument,
                    "address \"" + text + "\": expected HOST:PORT, as in 127.0.0.1:8080");
    }
    address.host = text.substr(0, colon);
    if (address.host.starts_with('[') && address.host.ends_with(']')) {
        address.host = address.host.substr(1, address.host.size() - 2);
    }
    return address;
}

bool is_loopback(const ListenAddress& address) {
    in_addr number{};
    const bool is_number = ::inet_pton(AF_INET, address.host.c_str(), &number) == 1;
    return address.host == "localhost" || address.host == "::1" ||
           (is_number && address.host.starts_with("127."));
}

std::vector<std::string> parts_of(Role role) {
    switch (role) {
        case Role::Api:
            return {"api"};
        case Role::Worker:
            return {"worker"};
        case Role::All:
            break;
    }
    return {"api", "worker"};
}

std::optional<Command> parse_command_line(int argc, const char* const* argv) {
    Command command;
    Flags flags;
    CLI::App app{
        "stippled: smaller point clouds that still describe the same surface,\n"
        "served level by level"};
    app.set_version_flag("--version", "stippled " STIPPLE_VERSION);
    app.require_subcommand(1);
    app.set_config("--config", "",
                   "file with the flags, such as `[serve]` and\n`listen=\"127.0.0.1:8080\"`");
    app.allow_config_extras(CLI::config_extras_mode::error);
    app.fallthrough();

    CLI::App& serve = *app.add_subcommand("serve", "Run the service");
    add_addresses(serve, flags);
    add_work(serve, flags, command.config);
    add_limits(serve, flags, command.config.limits);
    add_guards(serve, flags, command.config);
    refuse_signs(serve);
    CLI::App& healthcheck =
        *app.add_subcommand("healthcheck", "Check whether a service is ready (exit status)");
    add(healthcheck, "--admin", flags.admin, "address of its admin listener");
    CLI::App& scrub = *app.add_subcommand("scrub", "Compare every stored file with its hash");
    add(scrub, "--data", flags.data, "folder of the store")->required();

    try {
        app.parse(argc, argv);
    } catch (const CLI::Success& help) {
        app.exit(help);
        return std::nullopt;
    } catch (const CLI::ConfigError& error) {
        constexpr std::string_view kUnknown = "INI was not able to parse ";
        std::string what = error.what();
        if (what.starts_with(kUnknown)) what = what.substr(kUnknown.size()) + ": no such flag";
        throw Error(ErrorCode::InvalidArgument, "--config: " + what);
    } catch (const CLI::ParseError& error) {
        const bool has_command = !app.get_subcommands().empty();
        const std::vector<std::string> unknown = app.remaining(true);
        if (!unknown.empty())
            refuse_unknown(unknown.front(), has_command ? app.get_subcommands().front() : nullptr);
        throw Error(ErrorCode::InvalidArgument,
                    error.what() + std::string(has_command ? "" : "; see stippled --help"));
    }
    command.kind = healthcheck.parsed() ? Command::Kind::Healthcheck
                   : scrub.parsed()     ? Command::Kind::Scrub
                                        : Command::Kind::Serve;
    if (command.kind == Command::Kind::Serve) {
        finish(flags, command.config);
    } else {
        command.config.admin = parse_address(flags.admin);
        command.config.data = flags.data;
    }
    return command;
}

}  // namespace stipple::server
