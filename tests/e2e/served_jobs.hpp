// What tests over HTTP send to a real stippled, and how they read its replies.
#pragma once

#include "support/ply_text.hpp"
#include "support/stippled_process.hpp"

#include "stipple/codec.hpp"
#include "stipple/proto/digest.hpp"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

namespace stipple::test {

using Json = nlohmann::json;

inline std::string as_ply(const PointCloud& cloud) {
    const auto bytes = encode_ply(cloud);
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

inline std::string hash_of(const std::string& bytes) {
    return proto::sha256_hex(std::as_bytes(std::span(bytes)));
}

inline const std::vector<std::string> kJson = {"Content-Type: application/json"};

/// Uploads a cloud; returns its id.
inline std::string upload(const StippledProcess& server, const std::string& bytes) {
    const HttpReply reply = request(server.port(), "POST", "/v1/clouds", bytes);
    EXPECT_TRUE(reply.status == 201 || reply.status == 200) << reply.body;
    return Json::parse(reply.body).at("id");
}

inline std::string submit(const StippledProcess& server, const Json& job,
                          std::vector<std::string> fields = kJson) {
    const HttpReply reply = request(server.port(), "POST", "/v1/jobs", job.dump(), fields);
    EXPECT_TRUE(reply.status == 201 || reply.status == 200) << reply.body;
    return Json::parse(reply.body).at("id");
}

inline Json pyramid_of(const std::string& cloud) {
    return {
        {"type", "pyramid"}, {"input", cloud}, {"levels", {100, 500}}, {"formats", {"drc", "ply"}}};
}

/// The document of a job once it is final.
inline Json finished(const StippledProcess& server, const std::string& id) {
    for (int attempt = 0; attempt < 20; ++attempt) {
        const Json job =
            Json::parse(request(server.port(), "GET", "/v1/jobs/" + id + "?wait=10").body);
        const std::string status = job.at("status");
        if (status != "accepted" && status != "running") return job;
    }
    ADD_FAILURE() << "job " << id << " did not end";
    return {};
}

/// The type of a problem, without its base; what else a problem must have is checked.
inline std::string problem_of(const HttpReply& reply) {
    EXPECT_EQ(reply.field("Content-Type"), "application/problem+json") << reply.head << reply.body;
    const Json problem = Json::parse(reply.body, nullptr, false);
    if (!problem.is_object()) return "no problem document";
    EXPECT_EQ(problem.at("status"), reply.status);
    EXPECT_FALSE(problem.at("detail").get<std::string>().empty());
    const std::string type = problem.at("type");
    return type.substr(type.rfind('/') + 1);
}

}  // namespace stipple::test
