// The client library against the real stippled: what comes back is what the same job gives here, on
// real scans too.
#include "stipple/client.hpp"

#include "stipple/cleaning.hpp"
#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/run_job.hpp"
#include "support/expect_error.hpp"
#include "support/stippled_process.hpp"

#include <gtest/gtest.h>
#include <httplib.h>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <list>
#include <thread>

namespace stipple {
namespace {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

proto::JobRequest pyramid_request(const std::string& input) {
    proto::PyramidJob job;
    job.output.formats = {CloudFormat::Draco, CloudFormat::Ply};
    job.output.draco.position_bits = 16;
    return {input, job};
}

/// Everything that a level of the finest size must share with the cloud that was sent: bytes of
/// colours, attributes, and positions.
void expect_same_cloud(const PointCloud& result, const PointCloud& sent) {
    ASSERT_EQ(result.size(), sent.size());
    EXPECT_EQ(result.colors, sent.colors);
    ASSERT_EQ(result.attributes.size(), sent.attributes.size());
    for (std::size_t a = 0; a < sent.attributes.size(); ++a) {
        EXPECT_EQ(result.attributes[a].name, sent.attributes[a].name);
        EXPECT_TRUE(result.attributes[a].values == sent.attributes[a].values)
            << sent.attributes[a].name;
    }
    const double step = bounds(sent).diagonal() * 1e-7;  // of single precision
    for (std::size_t i = 0; i < sent.size(); ++i) {
        const Vec3d there = result.positions[i].cast<double>() + result.origin;
        const Vec3d here = sent.positions[i].cast<double>() + sent.origin;
        ASSERT_LE((there - here).cwiseAbs().maxCoeff(), step) << "point " << i;
    }
}

class RealScan : public testing::TestWithParam<const char*> {};

TEST_P(RealScan, GoesThroughUploadAndPyramidWithCountsColoursAndCoordinatesIntact) {
    const auto file = test::shared_file(GetParam());
    if (!file) GTEST_SKIP() << "the shared scans are not here";
    const test::StippledProcess server;
    const test::TemporaryFolder folder;
    Client client(server.url());
    const auto cloud = client.upload(*file);
    EXPECT_EQ(cloud.name, file->filename().string());
    const auto job = client.wait(client.submit(pyramid_request(cloud.id)).id);
    ASSERT_EQ(job.status, proto::JobStatus::Successful) << (job.problem ? job.problem->detail : "");

    PointCloud sent = read_cloud(*file);
    const std::size_t in_file = sent.size();
    const CleaningReport cleaned = clean(sent);
    const proto::Results results = client.results(job.id);
    ASSERT_TRUE(results.complete && results.source);
    EXPECT_EQ(results.source->points, in_file);
    EXPECT_EQ(results.source->non_finite, cleaned.non_finite);
    EXPECT_EQ(results.source->duplicates, cleaned.duplicates);

    for (const proto::OutputCloud& level : results.levels) {
        for (const proto::OutputFile& output : level.files) {
            const fs::path path = folder / (std::to_string(level.level) + "." +
                                            std::string(to_string(output.format)));
            client.download(output, path);
            const PointCloud decoded = read_cloud(path);
            EXPECT_EQ(decoded.size(), level.points);
            EXPECT_EQ(decoded.colors.size(), sent.colors.empty() ? 0 : decoded.size());
            EXPECT_EQ(decoded.normals.size(), sent.normals.empty() ? 0 : decoded.size());
            const Aabb box = bounds(decoded), whole = bounds(sent);
            const double slack = whole.diagonal() * 2e-5;  // 16 bits
            EXPECT_TRUE((box.min.array() >= whole.min.array() - slack).all());
            EXPECT_TRUE((box.max.array() <= whole.max.array() + slack).all());
        }
    }
    EXPECT_EQ(results.levels.back().points, sent.size());
    expect_same_cloud(read_cloud(folder / (std::to_string(results.levels.back().level) + ".ply")),
                      sent);
}

INSTANTIATE_TEST_SUITE_P(
    Shared, RealScan,
    testing::Values("models/igea.ply", "models/dragon_vrip.ply", "colour/3dhop_pc.ply",
                    "colour/frag_115.ply", "colour/pond.0.ply",
                    "colour/open3d_fragment_normals_curvature.ply", "lidar/small_gicp_target.ply",
                    "lidar/autzen_stadium_tile.ply", "raw/kinect_milk_cartoon_nan.ply",
                    "raw/indoor_1cm_grid.ply"),
    [](const auto& instance) {
        std::string name = fs::path(instance.param).stem().string();
        std::erase_if(name,
                      [](char c) { return std::isalnum(static_cast<unsigned char>(c)) == 0; });
        return name;
    });

TEST(Client, AServersResultIsByteForByteTheLocalOne) {
    const test::StippledProcess server;
    const test::TemporaryFolder folder;
    write_cloud(test::with_attributes(test::sphere(5000, 0.02)), folder / "in.ply");
    Client client(server.url());
    proto::SimplifyJob job;
    job.options.points = 321;
    job.output.formats = {CloudFormat::Ply};
    const proto::JobRequest request{client.upload(folder / "in.ply").id, job};
    test::expect_refused("printable ASCII", [&] { client.submit(request, "a\r\nX: y"); });
    const auto document = client.wait(client.submit(request).id);
    ASSERT_EQ(document.status, proto::JobStatus::Successful);
    const auto results = client.results(document.id);

    fs::create_directory(folder / "here");
    std::optional<proto::OutputCloud> here;
    proto::run_job({.request = request,
                    .input_file = folder / "in.ply",
                    .output_dir = folder / "here",
                    .limits = {}},
                   [&](const proto::JobReport& report) {
                       if (const auto* level = std::get_if<proto::OutputCloud>(&report))
                           here = *level;
                   });
    ASSERT_TRUE(here);
    EXPECT_EQ(results.levels.front().files.front().sha256, here->files.front().sha256);
}

TEST(Client, ATinyFileThatAsksForAllMemoryEndsItsJobWhileOthersGoOn) {
    const test::StippledProcess server({"--workers", "2"});
    const test::TemporaryFolder folder;
    write_cloud(test::sphere(300'000), folder / "good.ply");
    Client client(server.url());
    const auto good = client.upload(folder / "good.ply");
    for (const char* bomb :
         {"bad/bomb_sequential.drc", "bad/bomb_quantized.drc", "bad/bomb_kd_tree.drc"}) {
        const auto bad = client.upload(test::data_file(bomb));
        const auto started = std::chrono::steady_clock::now();
        const auto bad_job = client.submit(pyramid_request(bad.id));
        const auto good_job = client.submit(pyramid_request(good.id));
        const auto ended = client.wait(bad_job.id);
        const std::chrono::duration<double> took = std::chrono::steady_clock::now() - started;
        EXPECT_EQ(ended.status, proto::JobStatus::Failed) << bomb;
        ASSERT_TRUE(ended.problem);
        EXPECT_FALSE(ended.problem->detail.empty());
        EXPECT_LT(took.count(), 30.0)
            << bomb;  // 2 s on a quiet machine; only a hang is an error here
        RecordProperty(bomb, std::to_string(took.count()));
        EXPECT_EQ(client.wait(good_job.id).status, proto::JobStatus::Successful);
    }
}

/// Answers every request as a host of single-page applications does.
class PageHost {
public:
    PageHost() {
        host_.set_pre_routing_handler([](const httplib::Request&, httplib::Response& reply) {
            reply.set_content("<!doctype html><title>Scans</title>", "text/html");
            return httplib::Server::HandlerResponse::Handled;
        });
        port_ = host_.bind_to_any_port("127.0.0.1");
        thread_ = std::thread([this] { host_.listen_after_bind(); });
    }
    ~PageHost() {
        host_.stop();
        thread_.join();
    }
    std::string url() const { return "http://127.0.0.1:" + std::to_string(port_); }

private:
    httplib::Server host_;
    int port_ = 0;
    std::thread thread_;
};

TEST(Client, WhatIsNoStippledServerIsSaidToBeNone) {
    const PageHost host;
    const test::TemporaryFolder folder;
    write_cloud(test::sphere(10), folder / "in.ply");
    Client client(host.url());
    const auto expect_told = [](auto call) {
        test::expect_error(ErrorCode::Internal, "not the answer of a stippled server", call);
    };
    const std::string id = proto::sha256_of_file(folder / "in.ply");
    expect_told([&] { client.upload(folder / "in.ply"); });
    expect_told([&] { client.cloud(id); });
    expect_told([&] { client.clouds(); });
    expect_told([&] { client.submit(pyramid_request(id)); });
    expect_told([&] { client.job("0"); });
    expect_told([&] { client.wait("0"); });
    expect_told([&] { client.results("0"); });
}

TEST(Client, FollowsAJobToItsEndWithoutAPlaceForItsEvents) {
    const test::StippledProcess server({"--max-connections", "32", "--workers", "1"});
    const test::TemporaryFolder folder;
    write_cloud(test::sphere(200'000, 0.01), folder / "in.ply");
    Client client(server.url());
    proto::SimplifyJob job;
    job.options.method = Method::Particles;
    job.options.points = 50'000;
    const proto::JobRequest request{client.upload(folder / "in.ply").id, job};
    const std::string first = client.submit(request).id, second = client.submit(request).id;
    std::list<test::RawConnection> listeners;
    int status = 200;
    while (status == 200) {
        test::RawConnection& listener = listeners.emplace_back(server.port());
        ASSERT_TRUE(listener.send("GET /v1/jobs/" + second +
                                  "/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"));
        status = listener.receive(60s, false).status;
    }
    ASSERT_TRUE(status == 429 || status == 503) << status;
    listeners.pop_back();
    EXPECT_EQ(client.follow(first, {}).status, proto::JobStatus::Successful);
}

TEST(Client, AFinishedJobIsLeftByADismissalAndGoneOnceItIsRemoved) {
    const test::StippledProcess server;
    const test::TemporaryFolder folder;
    write_cloud(test::sphere(1000), folder / "in.ply");
    Client client(server.url());
    const auto job =
        client.wait(client.submit(pyramid_request(client.upload(folder / "in.ply").id)).id);
    ASSERT_EQ(job.status, proto::JobStatus::Successful);
    client.dismiss(job.id);
    EXPECT_EQ(client.job(job.id).status, proto::JobStatus::Successful);
    client.remove(job.id);
    EXPECT_THROW(client.job(job.id), Error);
    EXPECT_THROW(client.remove(job.id), Error);
}

TEST(Client, ARunningJobIsGoneSoonAfterItIsDismissed) {
    const test::StippledProcess server;
    const test::TemporaryFolder folder;
    write_cloud(test::sphere(3'000'000, 0.01), folder / "big.ply");
    Client client(server.url());
    const auto cloud = client.upload(folder / "big.ply");
    const auto job = client.submit(pyramid_request(cloud.id));
    while (client.job(job.id).progress < 20) std::this_thread::sleep_for(5ms);  // decoding is over

    client.dismiss(job.id);
    EXPECT_EQ(client.job(job.id).status, proto::JobStatus::Dismissed);
    const auto started = std::chrono::steady_clock::now();
    const auto job_processes = [&] { return test::children_of(server.pid()).size(); };
    while (job_processes() > 0 && std::chrono::steady_clock::now() - started < 20s)
        std::this_thread::sleep_for(1ms);
    const std::chrono::duration<double, std::milli> took =
        std::chrono::steady_clock::now() - started;
    EXPECT_EQ(job_processes(), 0U);
    RecordProperty("milliseconds", std::to_string(took.count()));
    std::cout << "the job process was gone " << took.count() << " ms after the dismissal\n";
}

}  // namespace
}  // namespace stipple
