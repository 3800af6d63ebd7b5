// What was acknowledged is there after `kill -9`, whenever it comes.

#include "store_fixtures.hpp"

#include <sys/wait.h>
#include <unistd.h>
#include <algorithm>
#include <csignal>
#include <limits>
#include <random>
#include <sstream>
#include <thread>

namespace stipple::server {
namespace {

using namespace stipple::test;
using namespace std::chrono_literals;
namespace fs = std::filesystem;

constexpr int kRounds = 30;

/// One line per acknowledgement; a line that short is written at once or not at all.
void acknowledge(int pipe, const std::string& what) {
    const std::string line = what + '\n';
    if (::write(pipe, line.data(), line.size()) != static_cast<ssize_t>(line.size())) ::_exit(3);
}

/// The service in small: uploads, submits, claims and publishes, until it is killed.
[[noreturn]] void serve_until_killed(const fs::path& data, int pipe, int round) try {
    const auto blobs = open_file_blob_store(data / "blobs");
    const auto jobs = open_sqlite_job_store(data / "jobs.sqlite");
    jobs->recover();
    Service service({}, *jobs, *blobs);
    for (int i = 0;; ++i) {
        const std::string name = std::to_string(round) + "." + std::to_string(i);
        const std::string text = kOnePoint + name + std::string(20'000, '.');
        const auto upload = service.begin_upload();
        upload->write(bytes_of(text));
        const auto cloud =
            service.finish_upload("ada", *upload, bytes_of(text), std::nullopt).document;
        acknowledge(pipe, "cloud " + cloud.id);

        const auto job = service.submit("ada", simplify_request(cloud.id), name).document;
        acknowledge(pipe, "job " + job.id);

        const Lease lease = jobs->claim({.max_queued = 0, .max_running = 1}, 60s).value();
        const std::string level = put_blob(*blobs, "level of " + name);
        jobs->publish_level(lease, level_with(0, level));
        acknowledge(pipe, "level " + lease.job_id);
        jobs->succeed(lease, {});
        acknowledge(pipe, "success " + lease.job_id);
    }
} catch (...) {
    ::_exit(2);
}

struct Acknowledged {
    std::vector<std::string> clouds, jobs, levels, successes;

    void add(const std::string& text) {
        std::istringstream lines(text);
        for (std::string kind, id; lines >> kind >> id;) {
            auto& list = kind == "cloud"   ? clouds
                         : kind == "job"   ? jobs
                         : kind == "level" ? levels
                                           : successes;
            list.push_back(id);
        }
    }
};

/// Adds to `text` what comes until it has so many lines, or the pipe ends.
void read_lines(int pipe, std::ptrdiff_t lines, std::string& text) {
    char buffer[4096];
    while (std::ranges::count(text, '\n') < lines) {
        const ssize_t n = ::read(pipe, buffer, sizeof buffer);
        if (n <= 0) return;
        text.append(buffer, static_cast<std::size_t>(n));
    }
}

/// Kills it some time after so many acknowledgements; returns all there were.
std::string run_until_killed(const fs::path& data, int round, std::ptrdiff_t lines,
                             std::chrono::microseconds more) {
    int ends[2];
    if (::pipe(ends) != 0) throw std::runtime_error("no pipe");
    const pid_t child = ::fork();
    if (child == 0) {
        ::close(ends[0]);
        serve_until_killed(data, ends[1], round);
    }
    ::close(ends[1]);
    std::string told;
    read_lines(ends[0], lines, told);
    std::this_thread::sleep_for(more);
    ::kill(child, SIGKILL);
    read_lines(ends[0], std::numeric_limits<std::ptrdiff_t>::max(), told);
    ::close(ends[0]);
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_TRUE(WIFSIGNALED(status)) << "round " << round << " ended by itself: status " << status;
    return told;
}

TEST(Durability, KeepsWhatWasAcknowledgedWhenTheServiceIsKilledAtAnyMoment) {
    const TemporaryFolder data;
    Acknowledged acknowledged;
    std::mt19937 random(1);
    std::uniform_int_distribution lines(0, 12);
    std::uniform_int_distribution more_us(0, 20'000);
    for (int round = 0; round < kRounds; ++round) {
        const std::chrono::microseconds more(more_us(random));
        acknowledged.add(run_until_killed(data.path(), round, lines(random), more));
    }
    ASSERT_FALSE(acknowledged.successes.empty())
        << "no round came to a success: nothing was tested";

    const auto blobs = open_file_blob_store(data / "blobs");
    const auto jobs = open_sqlite_job_store(data / "jobs.sqlite");
    jobs->recover();
    Service service({}, *jobs, *blobs);
    for (const std::string& id : acknowledged.clouds) {
        EXPECT_TRUE(text_of(*service.cloud_content("ada", id)).starts_with(kOnePoint)) << id;
    }
    for (const std::string& id : acknowledged.jobs) {
        const auto status = service.job("ada", id).status;
        EXPECT_TRUE(status == proto::JobStatus::Accepted || status == proto::JobStatus::Successful);
    }
    for (const std::string& id : acknowledged.levels) {
        const std::string file = service.results("ada", id)->levels.at(0).files.at(0).sha256;
        EXPECT_TRUE(service.outputs().file("ada", id, file + ".ply", {}).size() > 0) << id;
    }
    for (const std::string& id : acknowledged.successes) {
        EXPECT_EQ(service.job("ada", id).status, proto::JobStatus::Successful) << id;
    }
    EXPECT_TRUE(fs::is_empty(data / "blobs/tmp"));
    RecordProperty("acknowledged", static_cast<int>(acknowledged.jobs.size()));
}

}  // namespace
}  // namespace stipple::server
