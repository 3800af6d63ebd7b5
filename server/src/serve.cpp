#include "serve.hpp"

#include "http/admin.hpp"
#include "http/api.hpp"
#include "http/guarded_server.hpp"
#include "service/housekeeper.hpp"
#include "store/data_folder.hpp"
#include "worker/worker_pool.hpp"

#include <spdlog/spdlog.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <ctime>
#include <iostream>

namespace stipple::server {

namespace {

namespace fs = std::filesystem;

constexpr std::chrono::seconds kPatienceWithPacking{1};

/// Written to by the signal handler, which may do little else. A handler rather than a blocked
/// signal: what we spawn inherits no mask.
std::atomic<int> signal_event = -1;
std::atomic<std::int64_t> first_signal = 0;  // in milliseconds of a clock that is not 0
static_assert(std::atomic<std::int64_t>::is_always_lock_free);

extern "C" void on_signal(int number) {
    // Wrappers send the same signal twice, to the process and to its group: that is one wish. A
    // terminal that is closed may say so more than once: that is no hurry.
    constexpr std::int64_t kSameWish = 1000;
    timespec time{};
    ::clock_gettime(CLOCK_MONOTONIC, &time);
    const std::int64_t now = time.tv_sec * 1000 + time.tv_nsec / 1'000'000;
    std::int64_t first = 0;
    if (!first_signal.compare_exchange_strong(first, now)) {
        if (number != SIGHUP && now - first > kSameWish) ::_exit(128 + number);
        return;
    }
    const int saved = errno;
    ::eventfd_write(signal_event, 1);
    errno = saved;
}

/// From here on SIGTERM, SIGINT and SIGHUP are waited for; the last not under `nohup`.
class StopSignal {
public:
    StopSignal() : event_(::eventfd(0, EFD_CLOEXEC)) {
        signal_event = event_.get();
        struct sigaction action {};
        action.sa_handler = on_signal;
        action.sa_flags = SA_RESTART;
        ::sigaction(SIGTERM, &action, nullptr);
        ::sigaction(SIGINT, &action, nullptr);
        struct sigaction hangup {};
        ::sigaction(SIGHUP, nullptr, &hangup);
        if (hangup.sa_handler != SIG_IGN) ::sigaction(SIGHUP, &action, nullptr);
        ::signal(SIGPIPE, SIG_IGN);
    }
    void wait() {
        eventfd_t value = 0;
        while (::eventfd_read(event_.get(), &value) != 0 && errno == EINTR) {
        }
    }

private:
    FileDescriptor event_;
};

/// What is made from here on is closed to all but the owner and the group.
void close_to_others() {
    constexpr mode_t kOthers = 027;
    ::umask(::umask(kOthers) | kOthers);
}

/// The same for a database that was made before this was so.
void close_to_others(const fs::path& database) {
    for (const char* part : {"", "-wal", "-shm"}) {
        std::error_code not_there_or_not_ours;
        fs::permissions(database.string() + part, fs::perms::others_all, fs::perm_options::remove,
                        not_there_or_not_ours);
    }
}

/// Every connection needs a descriptor, and another for the file that it sends or brings: as many
/// as the system lets this process have.
void make_room_for(unsigned connections) {
    constexpr rlim_t kOthers = 256;  // the database, the locks, the admin listener, jobs
    const rlim_t wanted = 2 * rlim_t{connections} + kOthers;
    rlimit files{};
    ::getrlimit(RLIMIT_NOFILE, &files);
    files.rlim_cur = std::min(std::max(files.rlim_cur, wanted), files.rlim_max);
    ::setrlimit(RLIMIT_NOFILE, &files);
    if (files.rlim_cur >= wanted) return;
    spdlog::warn(
        "server.few_files open_files={} wanted={} remedy=\"--max-connections {} may need more: "
        "raise the limit (ulimit -Hn, LimitNOFILE=), or allow fewer connections\"",
        files.rlim_cur, wanted, connections);
}

std::unique_ptr<BlobStore> open_blobs(const ServerConfig& config) {
    std::vector<std::string> unfinished;
    for (const std::string& part : parts_of(config.role)) unfinished.push_back("tmp-" + part);
    return open_file_blob_store(blobs_in(config.data), unfinished);
}

std::unique_ptr<JobStore> open_jobs(const ServerConfig& config) {
    return open_sqlite_job_store(database_in(config.data), config.role == Role::All
                                                               ? Sharing::Alone
                                                               : Sharing::WithOtherProcesses);
}

http::GuardedServerOptions guard(const ServerConfig& config, const ListenAddress& address) {
    http::GuardedServerOptions options{
        .host = address.host,
        .port = address.port,
        .max_connections = config.max_connections,
        .max_connections_per_address = config.max_connections_per_address,
        .patience = {}};
    options.patience.min_bytes_per_second = config.min_bytes_per_second;
    return options;
}

http::GuardedServerOptions admin_guard(const ServerConfig& config) {
    http::GuardedServerOptions options = guard(config, config.admin);
    options.max_connections = 64;
    options.max_connections_per_address = 16;
    options.free_of_few = 8;  // it still answers where the other listener turns away
    return options;
}

WorkerPoolOptions worker_options(const ServerConfig& config, Service& service,
                                 http::Metrics& metrics) {
    return {.workers = config.workers,
            .threads_per_job = config.threads,
            .scratch = scratch_in(config.data),
            .lease = std::chrono::seconds(30),
            .drain = config.drain_timeout,
            .on_level =
                [&service](const proto::OutputCloud& level) { service.outputs().announce(level); },
            .on_end = [&metrics](std::string_view outcome) { metrics.attempt_ended(outcome); }};
}

/// A server, with the flag of its address in front of what is wrong with that.
template <typename Make>
auto listening_by(const char* flag, Make&& make) {
    try {
        return make();
    } catch (const Error& error) {
        throw Error(error.code(), std::string(flag) + ": " + error.what());
    }
}

/// The program that does each job, beside this one.
fs::path job_program() {
    const fs::path program = fs::read_symlink("/proc/self/exe").parent_path() / "stipple-job";
    if (::access(program.c_str(), X_OK) != 0) {
        throw Error(ErrorCode::NotFound, program.string() + ": " + std::strerror(errno) +
                                             ": it runs the jobs: expected beside stippled; "
                                             "without it only --role api works");
    }
    return program;
}

}  // namespace

int serve(const ServerConfig& config) {
    spdlog::set_level(spdlog::level::from_str(config.log_level));
    // RFC 3339: one time for all machines whose lines are read together.
    spdlog::set_pattern("%Y-%m-%dT%H:%M:%S.%eZ [%^%l%$] %v", spdlog::pattern_time_type::utc);
    StopSignal stop;
    std::unique_ptr<JobRunner> runner;
    if (config.role != Role::Api) runner = make_process_job_runner(job_program());
    close_to_others();
    if (config.role != Role::Worker) make_room_for(config.max_connections);
    make_data_folder(config.data);
    const auto locks = lock_parts(config.data, parts_of(config.role));
    const auto keys =
        config.api_keys ? std::make_shared<http::ApiKeyFile>(*config.api_keys) : nullptr;
    const auto jobs = open_jobs(config);  // before there are files, by which a folder is judged
    close_to_others(database_in(config.data));
    const auto blobs = open_blobs(config);
    if (config.role != Role::Api) jobs->recover();
    Service service(config.limits, *jobs, *blobs, Links(config.path_prefix));

    http::Metrics metrics;
    http::Api api({.keys = keys,
                   .cors_origins = config.cors_origins,
                   .local = !config.api_keys && is_loopback(config.listen),
                   .host_names = config.host_names,
                   .max_connections = config.max_connections,
                   .max_connections_per_address = config.max_connections_per_address},
                  service, metrics);
    std::unique_ptr<http::GuardedServer> api_server;
    http::Admin admin(service, metrics,
                      [&api_server] { return api_server ? api_server->connections() : 0U; });
    if (config.role != Role::Worker) {
        api_server = listening_by("--listen", [&] {
            return std::make_unique<http::GuardedServer>(guard(config, config.listen), api);
        });
    }
    http::GuardedServer admin_server =
        listening_by("--admin", [&] { return http::GuardedServer(admin_guard(config), admin); });

    std::optional<Housekeeper> housekeeper;
    if (config.role != Role::Worker)
        housekeeper.emplace(HousekeeperOptions{.retention = config.limits.retention,
                                               .cloud_retention = config.limits.cloud_retention},
                            *jobs, *blobs);
    std::optional<WorkerPool> workers;
    if (config.role != Role::Api) {
        metrics.expect_attempts(kAttemptOutcomes);
        workers.emplace(worker_options(config, service, metrics), config.limits, *jobs, *blobs,
                        *runner);
    }

    // One line for people and scripts: with port 0 the only way to learn the addresses.
    std::cout << "stippled is ready: api="
              << (api_server ? "http://" + api_server->address() : "none") << " admin=http://"
              << admin_server.address() << std::endl;
    spdlog::info("server.started api={} admin={} data={}",
                 api_server ? api_server->address() : "none", admin_server.address(),
                 config.data.string());

    stop.wait();
    spdlog::info("server.stopping");
    admin.begin_drain();
    if (workers) workers->begin_drain();
    const bool all_served = !api_server || api_server->drain(config.drain_timeout);
    workers.reset();
    const bool all_packed = service.outputs().end_packing(kPatienceWithPacking);
    spdlog::info("server.stopped requests_cut={}", !all_served);
    if (!all_packed) {  // what it makes can be made again, and all else is on the disk
        spdlog::shutdown();
        ::_exit(0);
    }
    return 0;
}

}  // namespace stipple::server
