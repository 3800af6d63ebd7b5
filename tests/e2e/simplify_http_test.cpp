// The real stippled asked to simplify in one call.
#include "served_jobs.hpp"

#include "stipple/simplify.hpp"

#include <gtest/gtest.h>

namespace stipple::test {
namespace {

TEST(Stippled, SimplifiesInOneCall) {
    const StippledProcess server;
    const std::string bytes = as_ply(sphere(3000));
    const HttpReply ply = request(server.port(), "POST", "/v1/simplify?points=300&wait=60", bytes);
    ASSERT_EQ(ply.status, 200) << ply.body;
    EXPECT_EQ(ply.field("Content-Type"), "model/ply");
    EXPECT_EQ(ply.field("Stipple-Points"), "300");
    const PointCloud cloud = decode_cloud(std::as_bytes(std::span(ply.body)));
    EXPECT_EQ(cloud.size(), 300U);
    EXPECT_NE(find_attribute(cloud, "radius"), nullptr);

    for (const Method method : kMethods) {
        const std::string target =
            "/v1/simplify?points=300&wait=60&splats=none&source_index=true&"
            "method=" +
            std::string(to_string(method));
        const HttpReply reply = request(server.port(), "POST", target, bytes);
        ASSERT_EQ(reply.status, 200) << target << reply.body;
        const PointCloud result = decode_cloud(std::as_bytes(std::span(reply.body)));
        EXPECT_EQ(result.size(), 300U) << target;
        EXPECT_NE(find_attribute(result, "source_index"), nullptr) << target;
        EXPECT_EQ(find_attribute(result, "radius"), nullptr) << target;
    }
    const HttpReply voxels =
        request(server.port(), "POST", "/v1/simplify?method=voxel&voxel_size=0.25&wait=60", bytes);
    EXPECT_EQ(voxels.status, 200) << voxels.body;

    const HttpReply bounded = request(
        server.port(), "POST", "/v1/simplify?method=hierarchical&max_error=5%25&wait=60", bytes);
    EXPECT_EQ(bounded.status, 200) << bounded.body;
    EXPECT_EQ(problem_of(request(server.port(), "POST", "/v1/simplify?max_error=0", bytes)),
              "invalid-argument");

    const HttpReply draco = request(server.port(), "POST", "/v1/simplify?ratio=0.1&wait=60", bytes,
                                    {"Accept: model/vnd.google.draco"});
    ASSERT_EQ(draco.status, 200) << draco.body;
    EXPECT_EQ(draco.body.substr(0, 5), "DRACO");
    const auto begin_of = [&](const char* query, const char* accept) {
        return request(server.port(), "POST", std::string("/v1/simplify?wait=60&points=30") + query,
                       bytes, {std::string("Accept: ") + accept})
            .body.substr(0, 4);
    };
    EXPECT_EQ(begin_of("", "model/ply;q=0.5, model/vnd.google.draco, */*;q=0.1"), "DRAC");
    EXPECT_EQ(begin_of("", "model/vnd.google.draco;q=0, model/*"), "ply\n");
    EXPECT_EQ(begin_of("&format=drc", "text/html"), "DRAC");

    const HttpReply later = request(server.port(), "POST", "/v1/simplify?points=300&wait=0", bytes);
    EXPECT_EQ(later.status, 201) << later.body;
    EXPECT_EQ(finished(server, Json::parse(later.body).at("id")).at("status"), "successful");

    EXPECT_EQ(problem_of(request(server.port(), "POST", "/v1/simplify?points=0", bytes)),
              "invalid-argument");
    EXPECT_EQ(problem_of(request(server.port(), "POST", "/v1/simplify?pionts=9", bytes)),
              "invalid-argument");
    EXPECT_EQ(problem_of(request(server.port(), "POST",
                                 "/v1/simplify?points=9&source_index=perhaps", bytes)),
              "invalid-argument");
    const HttpReply misplaced =
        request(server.port(), "POST", "/v1/simplify?points=9&voxel_size=1", bytes);
    EXPECT_EQ(problem_of(misplaced), "invalid-argument");
    EXPECT_NE(misplaced.body.find("voxel_size: belongs to voxel, not to multiphase"),
              std::string::npos)
        << misplaced.body;
    EXPECT_EQ(problem_of(request(server.port(), "POST", "/v1/simplify?points=9", bytes,
                                 {"Accept: image/png"})),
              "not-acceptable");
    EXPECT_EQ(problem_of(request(server.port(), "POST", "/v1/simplify?points=9&wait=60", kNoPoint)),
              "malformed-input");
}

TEST(Stippled, TellsWhatToAddToThePositionsOfASimplifiedDracoFile) {
    const StippledProcess server;
    PointCloud far = sphere(500);
    far.origin = Vec3d(500'000, 5'000'000, 100);
    far.double_precision = true;
    const auto reply = [&](const PointCloud& cloud, const std::string& format) {
        return request(server.port(), "POST",
                       "/v1/simplify?points=50&error=false&wait=60&format=" + format,
                       as_ply(cloud));
    };
    const HttpReply draco = reply(far, "drc");
    ASSERT_EQ(draco.status, 200) << draco.body;
    const PointCloud cloud = decode_cloud(std::as_bytes(std::span(draco.body)));
    ASSERT_FALSE(cloud.origin.isZero(0));
    const Json place = Json::parse('[' + draco.field("Stipple-Origin") + ']');
    EXPECT_EQ(Vec3d(place.at(0), place.at(1), place.at(2)), cloud.origin);
    EXPECT_EQ(reply(far, "ply").field("Stipple-Origin"), "");
    EXPECT_EQ(reply(sphere(500), "drc").field("Stipple-Origin"), "");
}

}  // namespace
}  // namespace stipple::test
