#include "stipple/proto/job.hpp"

#include "json_parts.hpp"
#include "stipple/proto/digest.hpp"

#include <algorithm>
#include <array>

namespace stipple::proto {

namespace {

constexpr JsonRules kRequestRules{ErrorCode::InvalidArgument, 1 << 20, 8};

// Names on the wire.

template <typename Enum>
struct Named {
    Enum value;
    std::string_view name;
};

constexpr std::array kRepresentatives = {
    Named<Representative>{Representative::Surface, "surface"},
    Named<Representative>{Representative::Centroid, "centroid"},
    Named<Representative>{Representative::Nearest, "nearest"},
};
constexpr std::array kReductions = {
    Named<Reduction>{Reduction::Mean, "mean"}, Named<Reduction>{Reduction::Nearest, "nearest"},
    Named<Reduction>{Reduction::Min, "min"},   Named<Reduction>{Reduction::Max, "max"},
    Named<Reduction>{Reduction::Mode, "mode"},
};
constexpr std::array kCodings = {
    Named<DracoCoding>{DracoCoding::Auto, "auto"},
    Named<DracoCoding>{DracoCoding::Sequential, "sequential"},
    Named<DracoCoding>{DracoCoding::KdTree, "kd-tree"},
};
constexpr std::array kStatuses = {
    Named<JobStatus>{JobStatus::Accepted, "accepted"},
    Named<JobStatus>{JobStatus::Running, "running"},
    Named<JobStatus>{JobStatus::Successful, "successful"},
    Named<JobStatus>{JobStatus::Failed, "failed"},
    Named<JobStatus>{JobStatus::Dismissed, "dismissed"},
};

template <typename Names, typename Enum>
std::string_view name_of(const Names& names, Enum value) noexcept {
    return std::ranges::find(names, value, &Named<Enum>::value)->name;
}

template <typename Names>
auto by_name(const Names& names, std::string_view name) {
    std::string offered;
    for (const auto& entry : names) {
        if (entry.name == name) return entry.value;
        offered += (offered.empty() ? "" : ", ") + std::string(entry.name);
    }
    throw Error(ErrorCode::InvalidArgument,
                "\"" + std::string(name.substr(0, 60)) + "\": expected one of " + offered);
}

template <typename Names>
auto one_of(const Names& names, const JsonValue& value) {
    return value.named([&names](std::string_view name) { return by_name(names, name); });
}

// Requests.

Json reductions_json(const std::map<std::string, Reduction>& reductions) {
    Json json = Json::object();
    for (const auto& [name, reduction] : reductions) json[name] = name_of(kReductions, reduction);
    return json;
}

std::map<std::string, Reduction> read_reductions(const JsonValue& value) {
    std::map<std::string, Reduction> reductions;
    for (const auto& [name, reduction] : value.members()) {
        reductions[name] = one_of(kReductions, reduction);
    }
    return reductions;
}

Json draco_json(const DracoEncodeOptions& options) {
    Json json = {{"attribute_bits", options.attribute_bits},
                 {"coding", name_of(kCodings, options.coding)},
                 {"compression_level", options.compression_level},
                 {"normal_bits", options.normal_bits}};
    if (options.precision) {
        json["precision"] = *options.precision;
    } else {
        json["position_bits"] = options.position_bits;
    }
    return json;
}

DracoEncodeOptions read_draco(const JsonValue& value) {
    JsonObject object = value.object();
    DracoEncodeOptions options;
    const auto position_bits = object.find("position_bits");
    const auto precision = object.find("precision");
    if (position_bits && precision) {
        throw object.error("precision", "stands instead of position_bits: give one of the two");
    }
    if (position_bits) options.position_bits = position_bits->small_integer(0, 30);
    if (precision) {
        options.precision = precision->number();
        if (!(*options.precision > 0)) precision->refuse("a length above 0, in input units");
    }
    if (const auto bits = object.find("normal_bits")) {
        options.normal_bits = bits->small_integer(2, 30);
    }
    if (const auto bits = object.find("attribute_bits")) {
        options.attribute_bits = bits->small_integer(0, 30);
    }
    if (const auto level = object.find("compression_level")) {
        options.compression_level = level->small_integer(0, 10);
    }
    if (const auto coding = object.find("coding")) options.coding = one_of(kCodings, *coding);
    object.finish();
    return options;
}

std::optional<std::uint64_t> read_count(const std::optional<JsonValue>& value) {
    return value ? std::optional(value->integer(1)) : std::nullopt;
}

std::optional<double> read_number(const std::optional<JsonValue>& value) {
    return value ? std::optional(value->number()) : std::nullopt;
}

SimplifyJob read_simplify(JsonObject& object) {
    SimplifyJob job;
    SimplifyOptions& options = job.options;
    if (const auto method = object.find("method")) {
        options.method = method->named(method_from_name);
    }
    options.points = read_count(object.find("points"));
    options.ratio = read_number(object.find("ratio"));
    options.hierarchical.max_cluster_size = read_count(object.find("max_cluster_size"));
    options.hierarchical.max_variation = read_number(object.find("max_variation"));
    if (const auto kind = object.find("representative")) {
        options.hierarchical.representative = one_of(kRepresentatives, *kind);
    }
    if (const auto seed = object.find("seed")) options.seed = seed->integer();
    if (const auto policies = object.find("reductions")) {
        options.reductions = read_reductions(*policies);
    }

    job.output.formats = {CloudFormat::Ply};
    if (const auto format = object.find("format")) {
        job.output.formats = {format->named(cloud_format_from_name)};
    }
    if (const auto draco = object.find("draco")) job.output.draco = read_draco(*draco);
    return job;
}

std::vector<CloudFormat> read_formats(const JsonValue& value) {
    std::vector<CloudFormat> formats;
    for (const JsonValue& item : value.items()) {
        const auto format = item.named(cloud_format_from_name);
        if (std::ranges::find(formats, format) != formats.end()) item.refuse("each format once");
        formats.push_back(format);
    }
    if (formats.empty()) value.refuse("at least one format");
    return formats;
}

PyramidJob read_pyramid(JsonObject& object) {
    PyramidJob job;
    LodPyramidOptions& options = job.options;
    const auto levels = object.find("levels");
    const auto ratio = object.find("ratio");
    const auto base_points = object.find("base_points");
    if (levels && (ratio || base_points)) {
        throw object.error("levels", "stands instead of ratio and base_points: give one form");
    }
    if (levels) {
        options.sizes = levels->list_of([](const JsonValue& size) { return size.integer(1); });
        if (options.sizes.empty()) levels->refuse("at least one size");
    }
    if (ratio) options.ratio = ratio->number();
    if (base_points) options.base_points = base_points->integer(1);
    if (const auto kind = object.find("representative")) {
        options.representative = one_of(kRepresentatives, *kind);
    }
    if (const auto policies = object.find("reductions")) {
        options.reductions = read_reductions(*policies);
    }

    job.output.formats = {CloudFormat::Draco, CloudFormat::Ply};
    if (const auto formats = object.find("formats")) job.output.formats = read_formats(*formats);
    if (const auto draco = object.find("draco")) job.output.draco = read_draco(*draco);
    return job;
}

void add_options(Json& json, const SimplifyJob& job) {
    const SimplifyOptions& options = job.options;
    const HierarchicalClusteringOptions& hierarchical = options.hierarchical;
    json["type"] = "simplify";
    json["method"] = to_string(options.method);
    if (options.points) json["points"] = *options.points;
    if (options.ratio) json["ratio"] = *options.ratio;
    if (hierarchical.max_cluster_size) json["max_cluster_size"] = *hierarchical.max_cluster_size;
    if (hierarchical.max_variation) json["max_variation"] = *hierarchical.max_variation;
    json["representative"] = name_of(kRepresentatives, hierarchical.representative);
    json["seed"] = options.seed;
    json["reductions"] = reductions_json(options.reductions);
    json["format"] =
        to_string(job.output.formats.empty() ? CloudFormat::Ply : job.output.formats.front());
    json["draco"] = draco_json(job.output.draco);
}

void add_options(Json& json, const PyramidJob& job) {
    const LodPyramidOptions& options = job.options;
    json["type"] = "pyramid";
    if (options.sizes.empty()) {
        json["ratio"] = options.ratio;
        json["base_points"] = options.base_points;
    } else {
        json["levels"] = options.sizes;
    }
    json["representative"] = name_of(kRepresentatives, options.representative);
    json["reductions"] = reductions_json(options.reductions);
    json["formats"] = Json::array();
    for (const CloudFormat format : {CloudFormat::Draco, CloudFormat::Ply}) {
        const auto& formats = job.output.formats;
        const bool wanted = formats.empty() || std::ranges::find(formats, format) != formats.end();
        if (wanted) json["formats"].push_back(to_string(format));
    }
    json["draco"] = draco_json(job.output.draco);
}

// Parts of documents.

Json vector_json(const Vec3d& v) {
    return {v.x(), v.y(), v.z()};
}

Vec3d read_vector(const JsonValue& value) {
    const std::vector<JsonValue> items = value.items();
    if (items.size() != 3) value.refuse("three numbers");
    return {items[0].number(), items[1].number(), items[2].number()};
}

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

std::string_view type_name(const JobRequest& request) noexcept {
    return std::holds_alternative<SimplifyJob>(request.job) ? "simplify" : "pyramid";
}

Json request_json(const JobRequest& request) {
    Json json = {{"input", request.input}};
    std::visit([&json](const auto& job) { add_options(json, job); }, request.job);
    return nlohmann::json(json);  // which sorts the keys
}

JobRequest read_request(const JsonValue& value) {
    JsonObject object = value.object();
    JobRequest request;
    const JsonValue type = object["type"];
    const JsonValue input = object["input"];
    request.input = input.text();
    if (!is_sha256(request.input)) {
        input.refuse("the id of a cloud: 64 lower-case hexadecimal digits");
    }
    if (type.text() == "simplify") {
        request.job = read_simplify(object);
    } else if (type.text() == "pyramid") {
        request.job = read_pyramid(object);
    } else {
        type.refuse("simplify or pyramid");
    }
    object.finish();
    return request;
}

std::string to_json(const JobRequest& request) {
    return to_text(request_json(request));
}

JobRequest job_request_from_json(std::string_view json) {
    JobRequest request = read_request(JsonDocument(json, kRequestRules).root());
    std::visit([](const auto& job) { validate(job.options); }, request.job);
    return request;
}

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
    document.levels_ready = object["levels_ready"].small_integer();
    document.links = read_links(object["links"]);
    if (const auto problem = object.find("problem")) document.problem = read_problem(*problem);
    object.finish();
    return document;
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
    if (!statistics.bounds.empty()) json["bounds"] = bounds_json(statistics.bounds);
    json["attributes"] = Json::array();
    for (const auto& attribute : statistics.attributes) {
        json["attributes"].push_back(attribute_json(attribute));
    }
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
    removed.finish();
    if (const auto box = object.find("bounds")) statistics.bounds = read_bounds(*box);
    statistics.attributes = object["attributes"].list_of(read_attribute);
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
    Json json = {
        {"id", document.id}, {"format", to_string(document.format)}, {"bytes", document.bytes}};
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
    document.format = object["format"].named(cloud_format_from_name);
    document.bytes = object["bytes"].integer();
    document.created = read_time(object, "created");
    if (object.find("points")) document.statistics = read_statistics(object);
    document.links = read_links(object["links"]);
    object.finish();
    return document;
}

CloudStatistics describe(const PointCloud& cleaned, const DecodeReport& report,
                         std::uint64_t non_finite, std::uint64_t duplicates) {
    CloudStatistics statistics{.points = report.points,
                               .non_finite = non_finite,
                               .duplicates = duplicates,
                               .bounds = bounds(cleaned),
                               .attributes = {},
                               .encoding = report.encoding,
                               .skipped = first_lines(report.skipped),
                               .comments = first_lines(report.comments)};
    if (!cleaned.normals.empty()) statistics.attributes.push_back({"normal", "float32", 3});
    if (!cleaned.colors.empty()) {
        statistics.attributes.push_back({"color", "uint8", cleaned.has_alpha ? 4U : 3U});
    }
    for (const Attribute& attribute : cleaned.attributes) {
        statistics.attributes.push_back({attribute.name, type_of(attribute), attribute.components});
    }
    return statistics;
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
