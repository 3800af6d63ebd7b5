#include "stipple/proto/job.hpp"

#include "json_parts.hpp"
#include "names.hpp"

#include <array>

namespace stipple::proto {

namespace {

constexpr std::array kStatuses = {
    Named<JobStatus>{JobStatus::Accepted, "accepted"},
    Named<JobStatus>{JobStatus::Running, "running"},
    Named<JobStatus>{JobStatus::Successful, "successful"},
    Named<JobStatus>{JobStatus::Failed, "failed"},
    Named<JobStatus>{JobStatus::Dismissed, "dismissed"},
};

// Parts of documents.

Json links_json(const std::vector<Link>& links) {
    Json json = Json::array();
    for (const Link& link : links) {
        json.push_back({{"rel", link.rel}, {"href", link.href}, {"type", link.type}});
    }
    return json;
}

std::vector<Link> read_links(const JsonValue& value) {
    return value.list_of([](const JsonValue& item) {
        JsonObject object = item.object();
        Link link{object["rel"].text(), object["href"].text(), object["type"].text()};
        object.finish();
        return link;
    });
}

Json attribute_json(const CloudAttribute& attribute) {
    return {
        {"name", attribute.name}, {"type", attribute.type}, {"components", attribute.components}};
}

CloudAttribute read_attribute(const JsonValue& value) {
    JsonObject object = value.object();
    CloudAttribute attribute{object["name"].text(), object["type"].text(),
                             object["components"].small_integer(1)};
    object.finish();
    return attribute;
}

std::string read_text(const JsonValue& value) {
    return value.text();
}

/// An absent time is the empty text.
void add_time(Json& json, const char* name, const std::string& time) {
    if (!time.empty()) json[name] = time;
}

std::string read_time(JsonObject& object, const char* name) {
    const auto time = object.find(name);
    return time ? time->text() : std::string();
}

template <typename T>
constexpr std::string_view kTypeName;
template <>
constexpr std::string_view kTypeName<std::int8_t> = "int8";
template <>
constexpr std::string_view kTypeName<std::uint8_t> = "uint8";
template <>
constexpr std::string_view kTypeName<std::int16_t> = "int16";
template <>
constexpr std::string_view kTypeName<std::uint16_t> = "uint16";
template <>
constexpr std::string_view kTypeName<std::int32_t> = "int32";
template <>
constexpr std::string_view kTypeName<std::uint32_t> = "uint32";
template <>
constexpr std::string_view kTypeName<float> = "float32";
template <>
constexpr std::string_view kTypeName<double> = "float64";

std::string type_of(const Attribute& attribute) {
    return std::visit([]<typename T>(const std::vector<T>&) { return std::string(kTypeName<T>); },
                      attribute.values);
}

/// The first lines of a list that a file decides on: a header may hold thousands.
std::vector<std::string> first_lines(const std::vector<std::string>& lines) {
    constexpr std::size_t kMaxLines = 100;
    constexpr std::size_t kMaxBytes = 1000;
    std::vector<std::string> result;
    for (const std::string& line : lines) {
        if (result.size() == kMaxLines) break;
        result.push_back(line.substr(0, kMaxBytes));
    }
    return result;
}

}  // namespace

std::string_view to_string(JobStatus status) noexcept {
    return name_of(kStatuses, status);
}

JobStatus job_status_from_name(std::string_view name) {
    return by_name(kStatuses, name);
}

bool is_final(JobStatus status) noexcept {
    return status != JobStatus::Accepted && status != JobStatus::Running;
}

std::string to_json(const JobDocument& document) {
    Json json = {{"id", document.id},
                 {"type", type_name(document.request)},
                 {"status", to_string(document.status)},
                 {"progress", document.progress},
                 {"stage", document.stage},
                 {"message", document.message}};
    add_time(json, "created", document.created);
    add_time(json, "started", document.started);
    add_time(json, "finished", document.finished);
    add_time(json, "updated", document.updated);
    json["request"] = request_json(document.request);
    if (document.input_name) json["input_name"] = *document.input_name;
    json["levels_ready"] = document.levels_ready;
    json["links"] = links_json(document.links);
    if (document.problem) json["problem"] = problem_json(*document.problem);
    return to_text(json);
}

JobDocument job_document_from_json(std::string_view text) {
    const JsonDocument json(text, {});
    JsonObject object = json.object();
    JobDocument document;
    document.id = object["id"].text();
    document.request = read_request(object["request"]);
    if (const JsonValue type = object["type"]; type.text() != type_name(document.request)) {
        type.refuse("the type of the request");
    }
    document.status = object["status"].named(job_status_from_name);
    document.progress = object["progress"].number();
    document.stage = object["stage"].text();
    document.message = object["message"].text();
    document.created = read_time(object, "created");
    document.started = read_time(object, "started");
    document.finished = read_time(object, "finished");
    document.updated = read_time(object, "updated");
    if (const auto name = object.find("input_name")) document.input_name = name->text();
    document.levels_ready = object["levels_ready"].small_integer();
    document.links = read_links(object["links"]);
    if (const auto problem = object.find("problem")) document.problem = read_problem(*problem);
    object.finish();
    return document;
}

Json vector_json(const Vec3d& v) {
    return {v.x(), v.y(), v.z()};
}

Vec3d read_vector(const JsonValue& value) {
    const std::vector<JsonValue> items = value.items();
    if (items.size() != 3) value.refuse("three numbers");
    return {items[0].number(), items[1].number(), items[2].number()};
}

Json bounds_json(const Aabb& bounds) {
    return {{"min", vector_json(bounds.min)}, {"max", vector_json(bounds.max)}};
}

Aabb read_bounds(const JsonValue& value) {
    JsonObject object = value.object();
    Aabb bounds{read_vector(object["min"]), read_vector(object["max"])};
    object.finish();
    return bounds;
}

void add_statistics(Json& json, const CloudStatistics& statistics) {
    json["points"] = statistics.points;
    json["removed"] = {{"non_finite", statistics.non_finite},
                       {"duplicates", statistics.duplicates}};
    if (statistics.outliers) json["removed"]["outliers"] = *statistics.outliers;
    if (!statistics.bounds.empty()) json["bounds"] = bounds_json(statistics.bounds);
    if (statistics.middle) json["middle"] = vector_json(*statistics.middle);
    json["attributes"] = attributes_json(statistics.attributes);
    json["encoding"] = statistics.encoding;
    json["skipped"] = statistics.skipped;
    json["comments"] = statistics.comments;
}

CloudStatistics read_statistics(JsonObject& object) {
    CloudStatistics statistics;
    statistics.points = object["points"].integer();
    JsonObject removed = object["removed"].object();
    statistics.non_finite = removed["non_finite"].integer();
    statistics.duplicates = removed["duplicates"].integer();
    if (const auto outliers = removed.find("outliers")) statistics.outliers = outliers->integer();
    removed.finish();
    if (const auto box = object.find("bounds")) statistics.bounds = read_bounds(*box);
    if (const auto middle = object.find("middle")) statistics.middle = read_vector(*middle);
    statistics.attributes = read_attributes(object["attributes"]);
    statistics.encoding = object["encoding"].text();
    statistics.skipped = object["skipped"].list_of(read_text);
    statistics.comments = object["comments"].list_of(read_text);
    return statistics;
}

std::string to_json(const CloudStatistics& statistics) {
    Json json;
    add_statistics(json, statistics);
    return to_text(json);
}

CloudStatistics cloud_statistics_from_json(std::string_view text) {
    const JsonDocument json(text, {});
    JsonObject object = json.object();
    CloudStatistics statistics = read_statistics(object);
    object.finish();
    return statistics;
}

std::string to_json(const CloudDocument& document) {
    Json json = {{"id", document.id}};
    if (document.name) json["name"] = *document.name;
    json["format"] = to_string(document.format);
    json["bytes"] = document.bytes;
    add_time(json, "created", document.created);
    if (document.statistics) add_statistics(json, *document.statistics);
    json["links"] = links_json(document.links);
    return to_text(json);
}

CloudDocument cloud_document_from_json(std::string_view text) {
    const JsonDocument json(text, {});
    JsonObject object = json.object();
    CloudDocument document;
    document.id = object["id"].text();
    if (const auto name = object.find("name")) document.name = name->text();
    document.format = object["format"].named(cloud_format_from_name);
    document.bytes = object["bytes"].integer();
    document.created = read_time(object, "created");
    if (object.find("points")) document.statistics = read_statistics(object);
    document.links = read_links(object["links"]);
    object.finish();
    return document;
}

Json attributes_json(std::span<const CloudAttribute> attributes) {
    Json json = Json::array();
    for (const CloudAttribute& attribute : attributes) json.push_back(attribute_json(attribute));
    return json;
}

std::vector<CloudAttribute> read_attributes(const JsonValue& value) {
    return value.list_of(read_attribute);
}

std::vector<CloudAttribute> attributes_of(const PointCloud& cloud) {
    std::vector<CloudAttribute> attributes;
    if (!cloud.normals.empty()) attributes.push_back({"normal", "float32", 3});
    if (!cloud.colors.empty()) {
        attributes.push_back({"color", "uint8", cloud.has_alpha ? 4U : 3U});
    }
    for (const Attribute& attribute : cloud.attributes) {
        attributes.push_back({attribute.name, type_of(attribute), attribute.components});
    }
    return attributes;
}

CloudStatistics describe(const PointCloud& cleaned, const DecodeReport& report,
                         std::uint64_t non_finite, std::uint64_t duplicates) {
    std::optional<Vec3d> middle;
    if (!cleaned.empty()) middle = middle_of_most(cleaned);
    return {.points = report.points,
            .non_finite = non_finite,
            .duplicates = duplicates,
            .outliers = {},
            .bounds = bounds(cleaned),
            .middle = middle,
            .attributes = attributes_of(cleaned),
            .encoding = report.encoding,
            .skipped = first_lines(report.skipped),
            .comments = first_lines(report.comments)};
}

std::string page_json(const std::vector<std::string>& items,
                      const std::optional<std::string>& next) {
    std::string page = R"({"items":[)";
    for (const std::string& item : items) {
        if (&item != &items.front()) page += ',';
        page += item;
    }
    page += ']';
    if (next) page += R"(,"next":)" + to_text(Json(*next));
    return page + '}';
}

}  // namespace stipple::proto
