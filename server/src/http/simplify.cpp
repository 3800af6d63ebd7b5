#include "http/conditional.hpp"
#include "http/job_fields.hpp"
#include "http/output_reply.hpp"
#include "http/query.hpp"
#include "http/routes.hpp"
#include "http/upload.hpp"
#include "http/waiting.hpp"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

namespace stipple::server::http {

namespace {

using namespace std::chrono_literals;
using namespace std::string_view_literals;
using Json = nlohmann::json;

using Kind = JobField::Kind;
constexpr std::array kJobFields = {
    JobField{"method", Kind::Text},          JobField{"points", Kind::Count},
    JobField{"ratio", Kind::Number},         JobField{"seed", Kind::Count},
    JobField{"max_error", Kind::Distance},   JobField{"error", Kind::Truth},
    JobField{"splats", Kind::Text},          JobField{"source_index", Kind::Truth},
    JobField{"oversampling", Kind::Number},  JobField{"k", Kind::Count},
    JobField{"placement", Kind::Text},       JobField{"max_displacement", Kind::Number},
    JobField{"color_weight", Kind::Number},  JobField{"max_cluster_size", Kind::Count},
    JobField{"max_variation", Kind::Number}, JobField{"representative", Kind::Text},
    JobField{"adaptivity", Kind::Number},    JobField{"max_grading", Kind::Number},
    JobField{"max_iterations", Kind::Count}, JobField{"tolerance", Kind::Number},
    JobField{"voxel_size", Kind::Number},    JobField{"remove_outliers", Kind::Number},
};

/// The format that `Accept` wants most, of equals the first; PLY when it takes anything.
CloudFormat accepted_format(const Request& request) {
    const std::string field = request.headers.joined("Accept").value_or("*/*");
    std::string_view accept = field;
    std::optional<CloudFormat> wanted;
    double most = 0;
    while (!accept.empty()) {
        const auto comma = accept.find(',');
        const ListItem item = list_item(accept.substr(0, comma));
        accept = comma == accept.npos ? std::string_view() : accept.substr(comma + 1);
        std::optional<CloudFormat> named;
        for (const std::string_view type :
             {"*/*"sv, "model/*"sv, "application/*"sv, "application/octet-stream"sv})
            if (equal_ignoring_case(item.name, type)) named = CloudFormat::Ply;
        for (const CloudFormat format : {CloudFormat::Ply, CloudFormat::Draco})
            if (equal_ignoring_case(item.name, media_type(format))) named = format;
        if (!named || item.quality <= most) continue;
        wanted = named;
        most = item.quality;
    }
    if (!wanted) throw HttpError(406, "Accept names neither model/ply nor model/vnd.google.draco");
    return *wanted;
}

std::vector<std::string_view> query_names() {
    std::vector<std::string_view> names = {"format", "wait"};
    add_names(names, kJobFields);
    add_names(names, kDracoFields);
    return names;
}

/// What the query asks for, of a cloud that has not come yet.
proto::JobRequest read_query(const Request& request) {
    allow_query(request, query_names());
    Json json = {{"type", "simplify"}, {"input", std::string(64, '0')}};
    copy_fields(request, kJobFields, json);
    const auto format = request.query_value("format");
    json["format"] = format ? *format : std::string(to_string(accepted_format(request)));
    proto::JobRequest job =
        proto::job_request_from_json(json.dump(-1, ' ', false, Json::error_handler_t::replace));
    proto::OutputOptions& output = std::get<proto::SimplifyJob>(job.job).output;
    output.draco = query_draco(request, output.formats.front());
    return job;
}

/// A queue that is full before the cloud comes would refuse it afterwards, when it is stored. With
/// keys only the store, which looks last of all, tells the queues of tenants apart.
void check_queue(Resources& resources) {
    const QueueLimits& limits = resources.service.limits().queue;
    if (resources.with_keys && limits.max_queued > 0) return;
    check_queued(resources.service.counts().queued, limits);
}

/// @param place  that of the wait, held on while the reply is sent.
Reply result_reply(Resources& resources, const Request& request, const proto::JobDocument& job,
                   std::shared_ptr<void> place) {
    const auto results = resources.service.results(request.tenant, job.id);
    const proto::OutputCloud& cloud = results->levels.at(0);
    const proto::OutputFile& file = cloud.files.at(0);
    StoredFile stored = resources.service.outputs().file(
        request.tenant, job.id, file.sha256 + "." + std::string(to_string(file.format)), {});
    const std::uint64_t size = stored.size();
    Reply reply{.status = 200,
                .headers = {},
                .media_type = std::string(media_type(file.format)),
                .content = StoredRange{std::move(stored.content), 0, size},
                .permit = std::move(place)};
    reply.headers.set("ETag", '"' + file.sha256 + '"');
    reply.headers.set("Cache-Control", "no-store");
    reply.headers.set("Link", "<" + resources.service.links().job(job.id) + ">; rel=\"via\"");
    reply.headers.set("Stipple-Points", std::to_string(cloud.points));
    if (cloud.error) {
        reply.headers.set("Stipple-Error-Mean", Json(cloud.error->error.mean()).dump());
        reply.headers.set("Stipple-Error-Max", Json(cloud.error->error.max()).dump());
    }
    if (file.format == CloudFormat::Draco && cloud.origin) tell_origin(reply, *cloud.origin);
    return reply;
}

}  // namespace

Reply simplify(Resources& resources, Request& request) {
    proto::JobRequest wanted = read_query(request);
    const auto wait = query_wait(request, resources.service.limits(), kDefaultWait);
    auto place = place_to_wait(resources, request, wait);
    check_queue(resources);
    wanted.input = receive_cloud(resources, request, std::nullopt).document.id;
    const proto::JobDocument queued =
        resources.service.submit(request.tenant, wanted, std::nullopt).document;
    const proto::JobDocument job = wait_for_own_job(resources, request, queued.id, wait);

    if (job.status == proto::JobStatus::Successful)
        return result_reply(resources, request, job, std::move(place));
    if (const auto problem = why_incomplete(job)) throw HttpError(*problem);
    Reply reply = json_reply(201, proto::to_json(job));
    reply.headers.set("Cache-Control", "no-store");
    reply.headers.set("Location", resources.service.links().job(job.id));
    return reply;
}

}  // namespace stipple::server::http
