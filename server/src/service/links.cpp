#include "service/links.hpp"

#include <utility>
#include <variant>

namespace stipple::server {
namespace {

constexpr const char* kJson = "application/json";

}  // namespace

Links::Links(std::string prefix) : prefix_(std::move(prefix)) {}

std::vector<proto::Link> Links::of_cloud(const std::string& id, CloudFormat format) const {
    return {{"self", cloud(id), kJson},
            {"content", cloud(id) + "/content", std::string(media_type(format))}};
}

std::vector<proto::Link> Links::of_job(const std::string& id,
                                       const proto::JobRequest& request) const {
    std::vector<proto::Link> links = {{"self", job(id), kJson},
                                      {"events", job(id) + "/events", "text/event-stream"},
                                      {"results", job(id) + "/results", kJson}};
    if (const auto* const pyramid = std::get_if<proto::PyramidJob>(&request.job)) {
        const std::string folder = prefix_ + "/v1/pyramids/" + id;
        links.push_back({"pyramid", folder + "/manifest.json", kJson});
        if (makes(*pyramid, CloudFormat::Glb))
            links.push_back({"tileset", folder + "/tileset.json", kJson});
        links.push_back({"viewer", prefix_ + "/?pyramid=" + id, "text/html"});
    }
    return links;
}

void Links::fill(proto::OutputCloud& level, const std::string& job_id, bool pyramid) const {
    const std::string folder =
        pyramid ? prefix_ + "/v1/pyramids/" + job_id + "/" : job(job_id) + "/results/";
    for (proto::OutputFile& file : level.files)
        file.href = folder + file.sha256 + "." + std::string(to_string(file.format));
    for (proto::PictureFile& picture : level.pictures)
        picture.href = folder + picture.sha256 + "." + std::string(kPictureExtension);
}

}  // namespace stipple::server
