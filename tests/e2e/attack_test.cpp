// The real stippled under attack: memory stays bounded, health checks are answered, and others are
// served meanwhile.
#include "support/ply_text.hpp"
#include "support/stippled_process.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>
#include <fstream>
#include <list>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

namespace stipple::test {
namespace {

using namespace std::chrono_literals;
using std::chrono::steady_clock;

constexpr std::uint64_t kMebibyte = 1 << 20;
constexpr auto kGenerous = 20s;  ///< for what takes milliseconds on an idle machine

/// What no attack may change.
void expect_well(const StippledProcess& server) {
    const auto begin = steady_clock::now();
    EXPECT_EQ(request(server.admin_port(), "GET", "/livez").status, 200);
    EXPECT_EQ(request(server.port(), "GET", "/v1/limits").status, 200);
    EXPECT_LT(steady_clock::now() - begin, kGenerous);
    EXPECT_LT(server.peak_memory_bytes(), 128 * kMebibyte);
}

/// Sends until the other side closes, `most` bytes at most; how many went out.
std::size_t pour(RawConnection& connection, const std::string& piece, std::size_t most) {
    std::size_t sent = 0;
    while (sent < most && connection.send(piece)) sent += piece.size();
    return sent;
}

/// The status of the reply to these bytes; 0 when the connection was closed without one.
int status_for(const StippledProcess& server, const std::string& bytes) {
    RawConnection connection(server.port());
    connection.send(bytes);
    return connection.receive(kGenerous).status;
}

const std::string kPost = "POST /v1/clouds HTTP/1.1\r\nHost: h\r\n";

TEST(Attack, AnEndlessRequestLineIsCutOff) {
    const StippledProcess server;
    RawConnection connection(server.port());
    EXPECT_LT(pour(connection, std::string(kMebibyte, 'a'), 256 * kMebibyte), 64 * kMebibyte);
    expect_well(server);
}

TEST(Attack, AnEndlessHeaderIsCutOff) {
    const StippledProcess server;
    RawConnection connection(server.port());
    connection.send("GET / HTTP/1.1\r\nHost: h\r\nX: ");
    EXPECT_LT(pour(connection, std::string(kMebibyte, 'a'), 256 * kMebibyte), 64 * kMebibyte);
    expect_well(server);
}

TEST(Attack, TooManyHeadersAreRefused) {
    const StippledProcess server;
    std::string fields;
    for (int i = 0; i < 200; ++i) fields += "A: b\r\n";
    EXPECT_EQ(status_for(server, "GET / HTTP/1.1\r\nHost: h\r\n" + fields + "\r\n"), 431);
    EXPECT_EQ(status_for(server, "GET /" + std::string(5000, 'a') + " HTTP/1.1\r\nHost: h\r\n\r\n"),
              414);
    expect_well(server);
}

TEST(Attack, WhatIsRefusedBeforeItIsARequestHasAnIdAsEveryReply) {
    const StippledProcess server;
    std::set<std::string> ids;
    for (const char* bytes : {"GET / HTTP/1.1\r\n\r\n", "GET / HTTP/9\r\nHost: h\r\n\r\n",
                              "POST / HTTP/1.1\r\nHost: h\r\nContent-Length: -3\r\n\r\n"}) {
        RawConnection connection(server.port());
        connection.send(bytes);
        const HttpReply reply = connection.receive(kGenerous);
        EXPECT_GE(reply.status, 400) << bytes;
        ids.insert(reply.field("X-Request-Id"));
    }
    EXPECT_EQ(ids.size(), 3U);
    EXPECT_FALSE(ids.contains(""));
}

TEST(Attack, AnEndlessChunkedBodyIsCutOffAtTheLimit) {
    const StippledProcess server({"--max-upload", "8388608"});
    RawConnection connection(server.port());
    connection.send(kPost + "Transfer-Encoding: chunked\r\n\r\n3\r\nply\r\n");
    const std::string chunk = "100000\r\n" + std::string(kMebibyte, ' ') + "\r\n";
    EXPECT_LT(pour(connection, chunk, 200 * kMebibyte), 64 * kMebibyte);
    expect_well(server);
}

TEST(Attack, WhoSendsAllOfARefusedBodyBeforeReadingLearnsWhy) {
    const StippledProcess server({"--max-upload", "8388608"});
    RawConnection connection(server.port());
    connection.send(kPost + "Content-Length: " + std::to_string(48 * kMebibyte) + "\r\n\r\nply\n");
    EXPECT_EQ(pour(connection, std::string(kMebibyte, ' '), 47 * kMebibyte), 47 * kMebibyte);
    connection.send(std::string(kMebibyte - 4, ' '));
    EXPECT_EQ(connection.receive(kGenerous).status, 413);
    expect_well(server);
}

TEST(Attack, FramesThatCanBeReadInTwoWaysAreRefused) {
    const StippledProcess server;
    EXPECT_EQ(status_for(server, kPost + "Content-Length: 3\r\nContent-Length: 3\r\n\r\nply"), 400);
    EXPECT_EQ(
        status_for(server, kPost + "Content-Length: 3\r\nTransfer-Encoding: chunked\r\n\r\nply"),
        400);
    EXPECT_EQ(status_for(server, kPost + "Content-Length: -3\r\n\r\nply"), 400);
    EXPECT_EQ(status_for(server, kPost + "Transfer-Encoding: chunked\r\n\r\n-3\r\nply\r\n"), 400);
    EXPECT_EQ(
        status_for(server, kPost + "Transfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\nply\r\n"),
        400);
    EXPECT_EQ(status_for(server, kPost + "Content-Encoding: gzip\r\nContent-Length: 3\r\n\r\nply"),
              415);
    EXPECT_EQ(
        status_for(
            server,
            kPost +
                "Content-Type: multipart/form-data; boundary=x\r\nContent-Length: 3\r\n\r\nply"),
        415);
    expect_well(server);
}

TEST(Attack, AThousandRangesAreNoneAtAll) {
    const StippledProcess server;
    std::string ranges = "Range: bytes=0-";
    for (int i = 0; i < 1000; ++i) ranges += ",0-";
    const HttpReply reply = request(server.port(), "GET", "/openapi.yaml", {}, {ranges});
    EXPECT_EQ(reply.status, 200);
    expect_well(server);
}

TEST(Attack, ABodyThatIsTooLargeIsRefusedBeforeItIsSent) {
    const StippledProcess server({"--max-upload", "1000"});
    RawConnection connection(server.port());
    connection.send(kPost + "Content-Length: 5000000000\r\nExpect: 100-continue\r\n\r\n");
    EXPECT_EQ(connection.receive(kGenerous).status, 413);
}

TEST(Attack, ADeleteWithoutABodyLeavesItsConnectionUsable) {
    const StippledProcess server;
    RawConnection connection(server.port());
    const auto begin = steady_clock::now();
    connection.send("DELETE /v1/jobs/0 HTTP/1.1\r\nHost: h\r\n\r\n");
    EXPECT_EQ(connection.receive(kGenerous).status, 404);
    connection.send("GET /v1/limits HTTP/1.1\r\nHost: h\r\n\r\n");
    EXPECT_EQ(connection.receive(kGenerous).status, 200);
    EXPECT_LT(steady_clock::now() - begin, kGenerous);
}

TEST(Attack, TwoRequestsSentAtOnceAreAnsweredInTurn) {
    const StippledProcess server;
    RawConnection connection(server.port());
    connection.send(
        "GET /v1/limits HTTP/1.1\r\nHost: h\r\n\r\nGET /v1/nothing HTTP/1.1\r\nHost: h\r\n\r\n");
    EXPECT_EQ(connection.receive(kGenerous).status, 200);
    EXPECT_EQ(connection.receive(kGenerous).status, 404);
}

TEST(Attack, SlowSendersNeitherStarveOthersNorStay) {
    const StippledProcess server;
    std::list<RawConnection> heads, bodies;
    for (int i = 0; i < 16; ++i) {
        heads.emplace_back(server.port()).send("GET / HTTP/1.1\r\nHo");
        bodies.emplace_back(server.port()).send(kPost + "Content-Length: 1000000\r\n\r\nply");
    }
    expect_well(server);
    for (RawConnection& slow : heads) {
        EXPECT_EQ(slow.receive(60s).status, 408);
        EXPECT_TRUE(slow.closed_within(60s));
    }
    for (RawConnection& slow : bodies) EXPECT_EQ(slow.receive(60s).status, 408);
    expect_well(server);
}

TEST(Attack, ConnectionsAboveTheCapAreToldSo) {
    const StippledProcess server({"--max-connections-per-address", "8"});
    std::list<RawConnection> idle;
    for (int i = 0; i < 8; ++i) idle.emplace_back(server.port());
    RawConnection refused(server.port());
    const HttpReply reply = refused.receive(kGenerous);
    EXPECT_EQ(reply.status, 503);
    EXPECT_EQ(reply.field("Retry-After"), "1");
    EXPECT_EQ(request(server.admin_port(), "GET", "/livez").status, 200);
    idle.clear();
    for (const auto deadline = steady_clock::now() + kGenerous; steady_clock::now() < deadline;) {
        if (request(server.port(), "GET", "/v1/limits").status == 200) return;
        std::this_thread::sleep_for(20ms);
    }
    FAIL() << "places of clients that left are not given back";
}

TEST(Attack, ConnectionsForWhichThereIsNoThreadAreToldSo) {
    const StippledProcess server;
    std::ifstream pages("/proc/" + std::to_string(server.pid()) + "/statm");
    std::uint64_t taken = 0;
    pages >> taken;
    // Room for the stacks of a few threads.
    const rlim_t bytes =
        taken * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE)) + 32 * kMebibyte;
    const rlimit room{bytes, RLIM_INFINITY};
    ASSERT_EQ(::prlimit(server.pid(), RLIMIT_AS, &room, nullptr), 0);
    std::list<RawConnection> many;
    std::map<int, int> replies;
    for (int i = 0; i < 30; ++i) {
        many.emplace_back(server.port());
        many.back().send("GET /v1/limits HTTP/1.1\r\nHost: h\r\n\r\n");
        ++replies[many.back().receive(kGenerous).status];
    }
    EXPECT_GT(replies[200], 0);
    EXPECT_GT(replies[503], 0);
    EXPECT_EQ(replies[200] + replies[503], 30);
    many.clear();
    expect_well(server);
}

TEST(Attack, NineHundredIdleConnectionsFailNoHealthCheck) {
    const StippledProcess server;
    std::list<RawConnection> idle;
    for (int i = 0; i < 900; ++i) idle.emplace_back(server.port());
    EXPECT_EQ(request(server.admin_port(), "GET", "/livez").status, 200);
    idle.clear();
    EXPECT_LT(server.peak_memory_bytes(), 128 * kMebibyte);
}

TEST(Attack, OneNeighbourCannotTakeTheHealthCheckOfOthers) {
    const StippledProcess server;
    std::list<RawConnection> idle;
    for (int i = 0; i < 100; ++i) idle.emplace_back(server.admin_port(), "127.0.0.2");
    EXPECT_EQ(request(server.admin_port(), "GET", "/livez").status, 200);
}

TEST(Attack, LongPollsAndStreamsNeverTakeTheLastThread) {
    // Nothing claims jobs here: the job stays queued while it is asked about.
    const StippledProcess server({"--role", "api", "--max-connections", "16"});
    const HttpReply cloud = request(server.port(), "POST", "/v1/clouds", kOnePoint);
    const std::string input = nlohmann::json::parse(cloud.body).at("id");
    const nlohmann::json job = {{"type", "simplify"}, {"input", input}, {"points", 1}};
    const HttpReply queued =
        request(server.port(), "POST", "/v1/jobs", job.dump(), {"Content-Type: application/json"});
    const std::string target = nlohmann::json::parse(queued.body).at("links").at(0).at("href");

    std::list<RawConnection> streams, polls;
    for (int i = 0; i < 5; ++i) {
        streams.emplace_back(server.port())
            .send("GET " + target + "/events HTTP/1.1\r\nHost: h\r\n\r\n");
        EXPECT_EQ(streams.back().receive(kGenerous, false).status, 200);
    }
    const HttpReply refused = request(server.port(), "GET", target + "/events");
    EXPECT_EQ(refused.status, 503) << refused.body;
    EXPECT_EQ(refused.field("Retry-After"), "2");
    for (int i = 0; i < 5; ++i) {
        polls.emplace_back(server.port())
            .send("GET " + target + "?wait=60 HTTP/1.1\r\nHost: h\r\n\r\n");
    }
    EXPECT_EQ(request(server.port(), "GET", "/v1/limits").status, 200);
}

/// An upload under way that holds its place: the server has said that it reads.
RawConnection& begin_upload(std::list<RawConnection>& uploads, const StippledProcess& server) {
    uploads.emplace_back(server.port())
        .send(kPost + "Content-Length: 1000000\r\nExpect: 100-continue\r\n\r\n");
    return uploads.back();
}

TEST(Attack, OneSenderCannotTakeAllPlacesForUploads) {
    const StippledProcess server(
        {"--max-connections", "64", "--max-connections-per-address", "16"});
    std::list<RawConnection> uploads;
    for (int i = 0; i < 3; ++i) {
        EXPECT_EQ(begin_upload(uploads, server).receive(kGenerous).status, 100);
        uploads.back().send("ply\n");
    }
    const HttpReply refused = begin_upload(uploads, server).receive(kGenerous);
    EXPECT_EQ(refused.status, 503);
    EXPECT_NE(refused.body.find("your address has 3 of the 9 places"), std::string::npos)
        << refused.body;
    RawConnection other(server.port(), "127.0.0.2");
    other.send(kPost + "Content-Length: " + std::to_string(kOnePoint.size()) + "\r\n\r\n" +
               kOnePoint);
    EXPECT_EQ(other.receive(kGenerous).status, 201);
}

TEST(Attack, ConnectionsThatLeaveNoFileDescriptorAreToldSo) {
    const StippledProcess server;
    const rlimit few{128, 128};
    ASSERT_EQ(::prlimit(server.pid(), RLIMIT_NOFILE, &few, nullptr), 0);
    std::list<RawConnection> many;
    for (int i = 0; i < 120; ++i) many.emplace_back(server.port());
    EXPECT_EQ(request(server.admin_port(), "GET", "/readyz").status, 200);
    // What was open for a moment only leaves room for a few more.
    for (int i = 0; i < 16; ++i) many.emplace_back(server.port());
    EXPECT_EQ(many.back().receive(kGenerous).status, 503);
    many.clear();
    expect_well(server);
}

/// A server that queues jobs and does none, and whose places for long polls are all taken.
struct Polled {
    const StippledProcess server{{"--role", "api", "--max-connections", "16"}};
    std::string cloud;
    std::list<RawConnection> polls;

    Polled() {
        const HttpReply reply = request(server.port(), "POST", "/v1/clouds", kOnePoint);
        cloud = nlohmann::json::parse(reply.body).at("id");
        const nlohmann::json job = {{"type", "simplify"}, {"input", cloud}, {"points", 1}};
        const HttpReply queued = request(server.port(), "POST", "/v1/jobs", job.dump(),
                                         {"Content-Type: application/json"});
        const std::string target = nlohmann::json::parse(queued.body).at("links").at(0).at("href");
        for (int i = 0; i < 5; ++i) {
            polls.emplace_back(server.port())
                .send("GET " + target + "?wait=60 HTTP/1.1\r\nHost: h\r\n\r\n");
        }
        while (request(server.port(), "GET", target + "?wait=0.1").status != 503) {
        }
    }
    std::size_t count(const char* list) const {
        return nlohmann::json::parse(request(server.port(), "GET", list).body).at("items").size();
    }
};

TEST(Attack, WhoIsRefusedAPlaceToWaitHasChangedNothing) {
    const Polled polled;
    EXPECT_EQ(
        request(polled.server.port(), "POST", "/v1/simplify?points=1", kOnePoint + "1").status,
        503);
    const nlohmann::json pair = {{"reference", polled.cloud}, {"candidate", polled.cloud}};
    EXPECT_EQ(request(polled.server.port(), "POST", "/v1/evaluations", pair.dump(),
                      {"Content-Type: application/json"})
                  .status,
              503);
    EXPECT_EQ(polled.count("/v1/jobs"), 1U);
    EXPECT_EQ(polled.count("/v1/clouds"), 1U);
}

TEST(Attack, AFullQueueStoresNoCloudInVain) {
    const StippledProcess server({"--max-queued", "0"});
    EXPECT_EQ(request(server.port(), "POST", "/v1/simplify?points=1", kOnePoint).status, 429);
    EXPECT_EQ(request(server.port(), "GET", "/v1/clouds").body, "{\"items\":[]}");
}

TEST(Attack, WhoLeavesTakesAJobAlongThatNobodyElseKnows) {
    const StippledProcess server({"--role", "api"});
    const std::string body = kOnePoint;
    const auto status = [&server]() -> std::string {
        const auto jobs = nlohmann::json::parse(request(server.port(), "GET", "/v1/jobs").body);
        return jobs.at("items").empty() ? "none" : jobs.at("items").at(0).at("status");
    };
    const auto becomes = [&status](const std::string& wanted) {
        for (const auto deadline = steady_clock::now() + kGenerous;
             status() != wanted && steady_clock::now() < deadline;)
            std::this_thread::sleep_for(20ms);
        return status() == wanted;
    };
    {
        RawConnection caller(server.port());
        caller.send("POST /v1/simplify?points=1&wait=60 HTTP/1.1\r\nHost: h\r\nContent-Length: " +
                    std::to_string(body.size()) + "\r\n\r\n" + body);
        EXPECT_TRUE(becomes("accepted")) << status();
    }
    EXPECT_TRUE(becomes("dismissed")) << status();
}

TEST(Attack, AnUploadThatBreaksOffIsNoSuccess) {
    const StippledProcess server;
    {
        RawConnection connection(server.port());
        connection.send(kPost + "Content-Length: 1000000\r\n\r\nply\n");
    }
    const auto counted = [&server](const char* status) {
        return request(server.admin_port(), "GET", "/metrics")
                   .body.find("route=\"/v1/clouds\",status=\"" + std::string(status) + "\"}") !=
               std::string::npos;
    };
    for (const auto deadline = steady_clock::now() + kGenerous;
         !counted("499") && !counted("200") && steady_clock::now() < deadline;)
        std::this_thread::sleep_for(20ms);
    EXPECT_TRUE(counted("499"));
    EXPECT_FALSE(counted("200"));
}

TEST(Attack, AnUploadThatBreaksOffLeavesNothing) {
    const StippledProcess server;
    {
        RawConnection connection(server.port());
        connection.send(kPost + "Content-Length: 1000000\r\n\r\nply\n" + std::string(100'000, ' '));
    }
    const auto leftovers = [&server] {
        std::size_t files = 0;
        for (const auto& entry :
             std::filesystem::recursive_directory_iterator(server.data() / "blobs"))
            files += entry.is_regular_file() ? 1 : 0;
        return files;
    };
    // The server may not have seen the end yet.
    for (const auto deadline = steady_clock::now() + kGenerous;
         leftovers() > 0 && steady_clock::now() < deadline;) {
        std::this_thread::sleep_for(20ms);
    }
    EXPECT_EQ(leftovers(), 0U);
    EXPECT_EQ(request(server.port(), "GET", "/v1/clouds").body, "{\"items\":[]}");
}

TEST(Attack, AReaderThatTakesNothingIsLeft) {
    const StippledProcess server({"--min-rate", "1073741824"});
    std::list<RawConnection> readers;
    const std::string bytes = "ply\n" + std::string(32 * kMebibyte, ' ');
    const std::string id =
        nlohmann::json::parse(request(server.port(), "POST", "/v1/clouds", bytes).body).at("id");
    for (int i = 0; i < 8; ++i) {
        readers.emplace_back(server.port())
            .send("GET /v1/clouds/" + id + "/content HTTP/1.1\r\nHost: h\r\n\r\n");
    }
    expect_well(server);
    const auto open = [&server] {
        const std::string metrics = request(server.admin_port(), "GET", "/metrics").body;
        const std::string name = "\nstipple_http_connections ";
        return std::stoi(metrics.substr(metrics.find(name) + name.size()));
    };
    for (const auto deadline = steady_clock::now() + 90s;
         open() > 0 && steady_clock::now() < deadline;) {
        std::this_thread::sleep_for(200ms);
    }
    EXPECT_EQ(open(), 0);
}

}  // namespace
}  // namespace stipple::test
