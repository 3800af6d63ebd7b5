#include "http/conditional.hpp"
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

/// A field of the job request by its query parameter; the request's own reader checks ranges and
/// names.
enum class Kind { Text, Count, Number, Truth, Distance };
struct Field {
    const char* name;
    Kind kind;
};
constexpr std::array kJobFields = {
    Field{"method", Kind::Text},          Field{"points", Kind::Count},
    Field{"ratio", Kind::Number},         Field{"seed", Kind::Count},
    Field{"max_error", Kind::Distance},   Field{"error", Kind::Truth},
    Field{"splats", Kind::Text},          Field{"source_index", Kind::Truth},
    Field{"oversampling", Kind::Number},  Field{"k", Kind::Count},
    Field{"placement", Kind::Text},       Field{"max_displacement", Kind::Number},
    Field{"color_weight", Kind::Number},  Field{"max_cluster_size", Kind::Count},
    Field{"max_variation", Kind::Number}, Field{"representative", Kind::Text},
    Field{"adaptivity", Kind::Number},    Field{"max_grading", Kind::Number},
    Field{"max_iterations", Kind::Count}, Field{"tolerance", Kind::Number},
    Field{"voxel_size", Kind::Number},    Field{"remove_outliers", Kind::Number},
};
constexpr std::array kDracoFields = {
    Field{"position_bits", Kind::Count},     Field{"precision", Kind::Number},
    Field{"normal_bits", Kind::Count},       Field{"attribute_bits", Kind::Count},
    Field{"compression_level", Kind::Count}, Field{"coding", Kind::Text},
};

void copy_fields(const Request& request, std::span<const Field> fields, Json& out) {
    for (const auto& [name, kind] : fields) {
        const auto text = request.query_value(name);
        if (!text) continue;
        if (kind == Kind::Text) out[name] = *text;
        if (kind == Kind::Count) out[name] = *query_count(request, name, 0, UINT64_MAX);
        if (kind == Kind::Number) out[name] = *query_number(request, name);
        if (kind == Kind::Distance && text->ends_with('%')) out[name] = *text;
        if (kind == Kind::Distance && !text->ends_with('%'))
            out[name] = *query_number(request, name);
        if (kind == Kind::Truth) out[name] = *query_truth(request, name);
    }
}

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
    for (const Field& field : kJobFields) names.emplace_back(field.name);
    for (const Field& field : kDracoFields) names.emplace_back(field.name);
    return names;
}

/// What the query asks for, of a cloud that has not come yet.
proto::JobRequest read_query(const Request& request) {
    allow_query(request, query_names());
    Json json = {{"type", "simplify"}, {"input", std::string(64, '0')}};
    copy_fields(request, kJobFields, json);
    const auto format = request.query_value("format");
    json["format"] = format ? *format : std::string(to_string(accepted_format(request)));
    Json draco = Json::object();
    copy_fields(request, kDracoFields, draco);
    if (!draco.empty() &&
        cloud_format_from_name(json["format"].get<std::string>()) != CloudFormat::Draco) {
        throw HttpError(400, draco.begin().key() + ": belongs to format drc");
    }
    if (!draco.empty()) json["draco"] = std::move(draco);
    return proto::job_request_from_json(json.dump(-1, ' ', false, Json::error_handler_t::replace));
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
    const proto::Results results = resources.service.results(request.tenant, job.id);
    const proto::OutputCloud& cloud = results.levels.at(0);
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
    reply.headers.set("Link", "</v1/jobs/" + job.id + ">; rel=\"via\"");
    reply.headers.set("Stipple-Points", std::to_string(cloud.points));
    if (cloud.error) {
        reply.headers.set("Stipple-Error-Mean", Json(cloud.error->error.mean()).dump());
        reply.headers.set("Stipple-Error-Max", Json(cloud.error->error.max()).dump());
    }
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
    if (job.status == proto::JobStatus::Failed && job.problem) throw HttpError(*job.problem);
    Reply reply = json_reply(201, proto::to_json(job));
    reply.headers.set("Location", "/v1/jobs/" + job.id);
    return reply;
}

}  // namespace stipple::server::http
