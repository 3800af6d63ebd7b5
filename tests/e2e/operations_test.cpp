// The real stippled as those see it who run it: in two processes, on another address, on a full
// disk, killed at any moment.
#include "stipple/client.hpp"

#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "support/stippled_process.hpp"

#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <random>
#include <thread>

namespace stipple {
namespace {

using namespace std::chrono_literals;
using test::StippledProcess;
using test::TemporaryFolder;
namespace fs = std::filesystem;

/// A cloud as a file of its own.
fs::path write_sphere(const TemporaryFolder& folder, std::size_t points, const std::string& name) {
    const fs::path file = folder / name;
    write_cloud(test::sphere(points, 0.01), file);
    return file;
}

proto::JobRequest simplify_to(const std::string& cloud, std::uint64_t points) {
    proto::SimplifyJob job;
    job.options.points = points;
    return {cloud, job};
}

void expect_done(Client& client, const std::string& job) {
    const auto document = client.wait(job);
    EXPECT_EQ(document.status, proto::JobStatus::Successful)
        << (document.problem ? document.problem->detail : "");
    const TemporaryFolder folder;
    const proto::Results results = client.results(job);
    ASSERT_FALSE(results.levels.empty());
    client.download(results.levels[0].files[0], folder / "result");  // compares the hash
    EXPECT_EQ(read_cloud(folder / "result").size(), results.levels[0].points);
}

std::vector<std::string> as(const char* role, const TemporaryFolder& data) {
    return {"--role", role, "--data", data.path().string()};
}

TEST(Roles, AnApiAndAWorkerShareTheWorkOnOneFolder) {
    const TemporaryFolder data, scans;
    const StippledProcess api(as("api", data));
    Client client(api.url());
    const auto cloud = client.upload(write_sphere(scans, 20'000, "scan.ply"));
    const std::string waiting = client.submit(simplify_to(cloud.id, 500)).id;
    EXPECT_EQ(client.job(waiting).status, proto::JobStatus::Accepted) << "nobody works yet";

    const StippledProcess worker(as("worker", data));
    EXPECT_EQ(worker.port(), 0);
    EXPECT_EQ(test::request(worker.admin_port(), "GET", "/readyz").status, 200);
    expect_done(client, waiting);
    expect_done(client, client.submit(simplify_to(cloud.id, 400)).id);
}

TEST(Roles, AKilledWorkerAndAKilledApiLoseNothing) {
    const TemporaryFolder data, scans;
    StippledProcess api(as("api", data));
    StippledProcess worker(as("worker", data));
    std::string first, second;
    {
        Client client(api.url());
        const auto cloud = client.upload(write_sphere(scans, 200'000, "scan.ply"));
        first = client.submit(simplify_to(cloud.id, 500)).id;
        second = client.submit(simplify_to(cloud.id, 400)).id;
    }
    std::this_thread::sleep_for(150ms);  // somewhere within the first job
    worker.restart();
    api.restart();
    Client client(api.url());
    expect_done(client, first);
    expect_done(client, second);
}

TEST(Roles, ADismissalReachesTheOtherProcess) {
    const TemporaryFolder data, scans;
    const StippledProcess api(as("api", data));
    const StippledProcess worker(as("worker", data));
    Client client(api.url());
    const auto cloud = client.upload(write_sphere(scans, 400'000, "scan.ply"));
    const std::string running = client.submit(simplify_to(cloud.id, 100'000)).id;
    while (client.job(running).status == proto::JobStatus::Accepted)
        std::this_thread::sleep_for(5ms);
    client.dismiss(running);
    for (int i = 0; i < 1000 && !fs::is_empty(data / "scratch"); ++i)
        std::this_thread::sleep_for(10ms);
    EXPECT_TRUE(fs::is_empty(data / "scratch")) << "the job goes on";
}

TEST(Roles, ASecondOfTheSameKindIsRefused) {
    const TemporaryFolder data;
    const StippledProcess api(as("api", data));
    EXPECT_THROW(StippledProcess(as("api", data)), std::runtime_error);
    EXPECT_THROW(StippledProcess({"--data", data.path().string()}), std::runtime_error);
    EXPECT_NO_THROW(StippledProcess(as("worker", data)));
}

TEST(Stippled, DoesNotStartWithoutTheProgramThatDoesItsJobs) {
    const TemporaryFolder folder;
    fs::copy_file(test::program("stippled"), folder / "stippled");
    const std::string at = folder.path().string();
    const std::string command = "timeout 60 " + at + "/stippled serve --listen 127.0.0.1:0 " +
                                "--admin 127.0.0.1:0 --data " + at + "/data 2> " + at + "/log";
    EXPECT_EQ(WEXITSTATUS(std::system(command.c_str())), 1);
    std::ifstream log(folder / "log");
    const std::string said{std::istreambuf_iterator<char>(log), {}};
    EXPECT_NE(said.find(at + "/stipple-job: "), std::string::npos) << said;
    EXPECT_NE(said.find("--role api"), std::string::npos) << said;
}

TEST(Stippled, ListensOnAnAddressOfVersion6) {
    const int probe = ::socket(AF_INET6, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (probe < 0) GTEST_SKIP() << "this machine has no IPv6";
    ::close(probe);
    const TemporaryFolder scans;
    const StippledProcess server({"--listen", "[::1]:0"});
    EXPECT_TRUE(server.url().starts_with("http://[::1]:")) << server.url();
    Client client(server.url());
    const auto cloud = client.upload(write_sphere(scans, 1000, "scan.ply"));
    expect_done(client, client.submit(simplify_to(cloud.id, 100)).id);
}

TEST(Stippled, LosesNothingThatItAcknowledgedWheneverItIsKilled) {
    const TemporaryFolder scans;
    StippledProcess server;
    std::mt19937 random(1);
    std::string cloud;
    std::vector<std::string> jobs;
    for (int round = 0; round < 5; ++round) {
        Client client(server.url());
        if (cloud.empty()) cloud = client.upload(write_sphere(scans, 100'000, "scan.ply")).id;
        for (std::uint64_t i = 0; i < 2; ++i)
            jobs.push_back(client.submit(simplify_to(cloud, 100 + 2 * jobs.size() + i)).id);
        std::this_thread::sleep_for(std::chrono::milliseconds(random() % 400));
        server.restart();
    }
    Client client(server.url());
    for (const std::string& job : jobs) expect_done(client, job);
}

/// What `stippled` says, with its exit status at the end, as one line each.
std::string said_by_stippled(const std::string& arguments) {
    const TemporaryFolder folder;
    const std::string log = (folder / "log").string();
    const std::string command = "timeout 60 " + test::program("stippled").string() + " " +
                                arguments + " > " + log + " 2>&1; echo status $? >> " + log;
    if (std::system(command.c_str()) != 0) throw std::runtime_error("cannot run " + command);
    std::ifstream in(log);
    return {std::istreambuf_iterator<char>(in), {}};
}

std::string serving(const fs::path& data) {
    return "serve --listen 127.0.0.1:0 --admin 127.0.0.1:0 --data " + data.string();
}

TEST(Stippled, LeavesAFolderAloneThatIsNoStore) {
    const TemporaryFolder home;
    const fs::path thesis = home / "scratch/results/thesis.txt";
    fs::create_directories(thesis.parent_path());
    std::ofstream(thesis) << "work";
    const std::string said = said_by_stippled(serving(home.path()));
    EXPECT_NE(said.find("it has scratch/results/thesis.txt, but no stipple.sqlite"), said.npos)
        << said;
    EXPECT_NE(said.find("status 1"), said.npos) << said;
    const std::string scrubbed = said_by_stippled("scrub --data " + home.path().string());
    EXPECT_NE(scrubbed.find("no store there"), scrubbed.npos) << scrubbed;
    EXPECT_TRUE(fs::exists(thesis));
    const fs::directory_iterator entries(home.path());
    EXPECT_EQ(std::distance(begin(entries), end(entries)), 1) << "something was made there";
}

TEST(Stippled, KeepsItsDatabaseFromOthers) {
    const TemporaryFolder folder;
    const fs::path data = folder / "data";
    const StippledProcess server({"--data", data.string()});
    EXPECT_EQ(fs::status(data).permissions() & fs::perms::others_all, fs::perms::none);
    for (const auto& entry : fs::recursive_directory_iterator(data)) {
        EXPECT_EQ(entry.status().permissions() & fs::perms::others_all, fs::perms::none)
            << entry.path();
    }
}

TEST(Stippled, ScrubTellsOfFilesThatAreMissingAndChangesNothing) {
    const TemporaryFolder scans;
    StippledProcess server;
    std::string cloud;
    {
        Client client(server.url());
        cloud = client.upload(write_sphere(scans, 1000, "scan.ply")).id;
    }
    EXPECT_EQ(server.stop(), 0);
    const std::string scrub = "scrub --data " + server.data().string();
    EXPECT_NE(said_by_stippled(scrub).find("1 files intact"), std::string::npos);
    const fs::path file = server.data() / "blobs" / cloud.substr(0, 2) / cloud.substr(2, 2) / cloud;
    ASSERT_TRUE(fs::remove(file));
    fs::remove(server.data() / "api.lock");
    const std::string said = said_by_stippled(scrub);
    EXPECT_NE(said.find(cloud + "  is missing"), said.npos) << said;
    EXPECT_NE(said.find("status 1"), said.npos) << said;
    EXPECT_FALSE(fs::exists(server.data() / "api.lock"));
}

TEST(Stippled, ScrubTellsOfADamagedDatabase) {
    StippledProcess server;
    EXPECT_EQ(server.stop(), 0);
    const std::string scrub = "scrub --data " + server.data().string();
    EXPECT_NE(said_by_stippled(scrub).find("database intact"), std::string::npos);
    std::fstream file(server.data() / "stipple.sqlite",
                      std::ios::binary | std::ios::in | std::ios::out);
    constexpr std::streamoff kPage = 4096;
    file.seekp(kPage);  // behind the header, which tells what the file is
    for (std::streamoff i = 0; i < kPage; ++i) file.put('\xA5');
    file.close();
    const std::string said = said_by_stippled(scrub);
    EXPECT_NE(said.find("database"), said.npos) << said;
    EXPECT_EQ(said.find("database intact"), said.npos) << said;
    EXPECT_EQ(said.find("status 0"), said.npos) << said;
}

TEST(Stippled, JobsWaitWhileTheirFilesAreAway) {
    const TemporaryFolder scans;
    const StippledProcess server;
    Client client(server.url());
    const std::string cloud = client.upload(write_sphere(scans, 1000, "scan.ply")).id;
    fs::rename(server.data() / "blobs", server.data() / "away");  // as a disk that is not mounted
    fs::create_directory(server.data() / "blobs");
    const auto job = client.submit({cloud, proto::SimplifyJob{{.points = 100}, {}}});
    using std::chrono::steady_clock;
    for (const auto end = steady_clock::now() + 20s; steady_clock::now() < end;) {
        if (client.job(job.id).message.starts_with("the service could not")) break;
        std::this_thread::sleep_for(20ms);
    }
    EXPECT_EQ(client.job(job.id).status, proto::JobStatus::Accepted);
    EXPECT_NE(test::request(server.admin_port(), "GET", "/metrics")
                  .body.find("stipple_job_attempts_total{outcome=\"put_off\"} 1\n"),
              std::string::npos);
    client.dismiss(job.id);
}

TEST(Stippled, MayOpenTheFilesThatItsConnectionsNeed) {
    rlimit before{};
    ASSERT_EQ(::getrlimit(RLIMIT_NOFILE, &before), 0);
    if (before.rlim_max < 2000) GTEST_SKIP() << "this machine allows fewer open files";
    const rlimit few{200, before.rlim_max};
    ASSERT_EQ(::setrlimit(RLIMIT_NOFILE, &few), 0);
    const StippledProcess server({"--max-connections", "800"});
    ::setrlimit(RLIMIT_NOFILE, &before);
    rlimit raised{};
    ASSERT_EQ(::prlimit(server.pid(), RLIMIT_NOFILE, nullptr, &raised), 0);
    EXPECT_GE(raised.rlim_cur, 1600U);
}

TEST(Stippled, FinishesItsJobWhenAllItsProcessesAreTold) {
    const TemporaryFolder scans;
    StippledProcess server({"--threads", "1"});
    std::string job;
    {
        Client client(server.url());
        const auto cloud = client.upload(write_sphere(scans, 400'000, "scan.ply"));
        job = client.submit(simplify_to(cloud.id, 100'000)).id;
    }
    while (test::children_of(server.pid()).empty()) std::this_thread::sleep_for(1ms);
    for (const pid_t child : test::children_of(server.pid())) ::kill(child, SIGTERM);
    ::kill(server.pid(), SIGTERM);  // and once more, as `timeout` does it
    EXPECT_EQ(server.stop(), 0);
    server.restart();
    Client client(server.url());
    EXPECT_EQ(client.job(job).status, proto::JobStatus::Successful) << "within its last seconds";
}

TEST(Stippled, SaysByItsStatusWhatWasWrong) {
    const auto status_of = [](const std::string& arguments) {
        const std::string command =
            test::program("stippled").string() + " " + arguments + " 2> /dev/null";
        const int status = std::system(command.c_str());
        return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    };
    const TemporaryFolder data;
    const StippledProcess server;
    const std::string taken = "127.0.0.1:" + std::to_string(server.port());
    EXPECT_EQ(status_of("serve --nonsense"), 2);
    EXPECT_EQ(status_of("serve --threads 5000"), 2);
    EXPECT_EQ(status_of("serve --admin 127.0.0.1:0 --listen " + taken + " --data " +
                        data.path().string()),
              1);
}

TEST(Stippled, EndsInOrderWhenItsTerminalIsClosed) {
    StippledProcess server;
    ::kill(server.pid(), SIGHUP);  // by the shell and by the kernel
    EXPECT_EQ(server.stop(60s, SIGHUP), 0);
}

TEST(Roles, StartTogetherOnANewFolder) {
    for (int round = 0; round < 5; ++round) {
        const TemporaryFolder data;
        std::jthread api([&] { EXPECT_NO_THROW(StippledProcess(as("api", data))); });
        std::jthread worker([&] { EXPECT_NO_THROW(StippledProcess(as("worker", data))); });
    }
}

/// A disk of some megabytes, where the tests may mount one.
class SmallDisk {
public:
    SmallDisk() : mounted_(::mount("tmpfs", path().c_str(), "tmpfs", 0, "size=16m") == 0) {}
    ~SmallDisk() {
        if (mounted_) ::umount2(path().c_str(), MNT_DETACH);
    }
    SmallDisk(const SmallDisk&) = delete;
    SmallDisk& operator=(const SmallDisk&) = delete;
    bool mounted() const { return mounted_; }
    const fs::path& path() const { return folder_.path(); }

    void fill() const {
        std::ofstream ballast(path() / "ballast", std::ios::binary);
        const std::string page(4096, 'x');
        while (ballast.write(page.data(), 4096).flush()) {
        }
    }
    void make_room() const { fs::remove(path() / "ballast"); }

private:
    TemporaryFolder folder_;
    bool mounted_;
};

TEST(Stippled, SaysThatItsDiskIsFullAndGoesOnWhenThereIsRoomAgain) {
    const SmallDisk disk;
    if (!disk.mounted()) GTEST_SKIP() << "mounting a small disk needs root";
    const TemporaryFolder scans;
    const StippledProcess server({"--data", (disk.path() / "data").string()});
    Client client(server.url());
    const auto cloud = client.upload(write_sphere(scans, 20'000, "kept.ply"));
    const std::string before = client.submit(simplify_to(cloud.id, 500)).id;
    expect_done(client, before);

    disk.fill();
    const fs::path other = write_sphere(scans, 30'000, "other.ply");
    const std::string body = (std::stringstream() << std::ifstream(other).rdbuf()).str();
    const auto refused = test::request(server.port(), "POST", "/v1/clouds", body);
    EXPECT_EQ(refused.status, 507) << refused.body;
    EXPECT_NE(refused.body.find("storage-full"), std::string::npos) << refused.body;
    EXPECT_EQ(test::request(server.admin_port(), "GET", "/readyz").status, 503);
    EXPECT_EQ(test::request(server.admin_port(), "GET", "/livez").status, 200);
    expect_done(client, before);
    const auto kept = test::request(server.port(), "DELETE", "/v1/jobs/" + before);
    EXPECT_EQ(kept.status, 507) << kept.body;

    disk.make_room();
    EXPECT_EQ(test::request(server.admin_port(), "GET", "/readyz").status, 200);
    expect_done(client, client.submit(simplify_to(client.upload(other).id, 400)).id);
}

}  // namespace
}  // namespace stipple
