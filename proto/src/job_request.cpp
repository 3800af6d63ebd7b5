#include "stipple/proto/job_request.hpp"

#include "json_fields.hpp"
#include "json_parts.hpp"
#include "method_options.hpp"
#include "names.hpp"
#include "stipple/globe.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/proto/option_names.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>

namespace stipple::proto {

namespace {

/// Those of a job that names none: the others are of the finest level alone.
constexpr std::span kUsualFormats = std::span(kPyramidFormats).first(3);

}  // namespace

bool makes(const PyramidJob& job, CloudFormat format) {
    const std::span<const CloudFormat> formats =
        job.output.formats.empty() ? kUsualFormats : std::span(job.output.formats);
    return std::ranges::find(formats, format) != formats.end();
}

namespace {

constexpr JsonRules kRequestRules{.code = ErrorCode::InvalidArgument,
                                  .max_bytes = kMaxRequestBytes,
                                  .max_depth = 8,
                                  .max_items = kMaxRequestItems,
                                  .unknown_fields = UnknownFields::Refused,
                                  .allows_nul = false};
constexpr JsonRules kStoredRules{
    .code = ErrorCode::Internal, .max_bytes = 1 << 20, .max_depth = 8};  // with all defaults

/// Of a job that makes one file.
OutputOptions read_output(JsonObject& object) {
    OutputOptions output{.formats = {CloudFormat::Ply}, .draco = {}};
    if (const auto format = object.find("format")) {
        const auto named = format->named(cloud_format_from_name);
        if (named != CloudFormat::Ply && named != CloudFormat::Draco) format->refuse("ply or drc");
        output.formats = {named};
    }
    if (const auto draco = object.find("draco")) output.draco = read_draco(*draco);
    return output;
}

void add_output(Json& json, const OutputOptions& output) {
    json["format"] = to_string(output.formats.empty() ? CloudFormat::Ply : output.formats.front());
    json["draco"] = draco_json(output.draco);
}

AddedAttributes read_added(JsonObject& object) {
    AddedAttributes added;
    take(object, "splats", splats_from_name, added.splats);
    take(object, "source_index", added.source_index);
    return added;
}

void add_added(Json& json, const AddedAttributes& added) {
    json["splats"] = to_string(added.splats);
    json["source_index"] = added.source_index;
}

std::optional<OutlierOptions> read_outliers(JsonObject& object) {
    const auto deviations = object.find("remove_outliers");
    if (!deviations) return std::nullopt;
    const OutlierOptions options{.deviations = deviations->number()};
    validate(options);
    return options;
}

void add_outliers(Json& json, const std::optional<OutlierOptions>& outliers) {
    if (outliers) json["remove_outliers"] = outliers->deviations;
}

SimplifyJob read_simplify(JsonObject& object) {
    SimplifyJob job;
    SimplifyOptions& options = job.options;
    if (const auto method = object.find("method")) {
        options.method = method->named(method_from_name);
    }
    refuse_fields_of_other_methods(object, options.method);
    take(object, "points", options.points);
    take(object, "ratio", options.ratio);
    take_max_error(object, options);
    take_own_options(object, options);
    take(object, "seed", options.seed);
    if (options.method != Method::Random) take_reductions(object, options.reductions);
    job.added = read_added(object);
    take(object, "error", job.error);
    job.output = read_output(object);
    job.outliers = read_outliers(object);
    return job;
}

void add_options(Json& json, const SimplifyJob& job) {
    const SimplifyOptions& options = job.options;
    json["type"] = "simplify";
    json["method"] = to_string(options.method);
    add(json, "points", options.points);
    add(json, "ratio", options.ratio);
    add_max_error(json, options);
    add_own_options(json, options);
    json["seed"] = options.seed;
    if (options.method != Method::Random) json["reductions"] = reductions_json(options.reductions);
    add_added(json, job.added);
    json["error"] = job.error;
    add_output(json, job.output);
    add_outliers(json, job.outliers);
}

UpsampleJob read_upsample(JsonObject& object) {
    UpsampleJob job;
    take(object, "points", job.options.points);
    take(object, "ratio", job.options.ratio);
    take_particles(object, job.options.particles);
    take(object, "seed", job.options.particles.seed);
    take_reductions(object, job.options.particles.reductions);
    job.added = read_added(object);
    take(object, "error", job.error);
    job.output = read_output(object);
    job.outliers = read_outliers(object);
    return job;
}

void add_options(Json& json, const UpsampleJob& job) {
    const UpsampleOptions& options = job.options;
    json["type"] = "upsample";
    add(json, "points", options.points);
    add(json, "ratio", options.ratio);
    add_particles(json, options.particles);
    json["seed"] = options.particles.seed;
    json["reductions"] = reductions_json(options.particles.reductions);
    add_added(json, job.added);
    json["error"] = job.error;
    add_output(json, job.output);
    add_outliers(json, job.outliers);
}

FeatureLineOptions read_feature_lines(const JsonValue& value) {
    JsonObject object = value.object();
    FeatureLineOptions options;
    take(object, "variation", options.variation);
    take(object, "high", options.high);
    take(object, "low", options.low);
    take(object, "min_links", options.min_links);
    object.finish();
    return options;
}

Json feature_lines_json(const FeatureLineOptions& options) {
    return {{"variation", options.variation},
            {"high", options.high},
            {"low", options.low},
            {"min_links", options.min_links}};
}

AnalyzeJob read_analyze(JsonObject& object) {
    AnalyzeJob job;
    take(object, "k", job.options.k);
    take(object, "orient", normal_signs_from_name, job.options.signs);
    if (const auto viewpoint = object.find("viewpoint")) {
        job.options.viewpoint = read_vector(*viewpoint);
    }
    if (const auto lines = object.find("feature_lines")) {
        job.options.feature_lines = read_feature_lines(*lines);
    }
    job.output = read_output(object);
    job.outliers = read_outliers(object);
    return job;
}

void add_options(Json& json, const AnalyzeJob& job) {
    json["type"] = "analyze";
    json["k"] = job.options.k;
    json["orient"] = to_string(job.options.signs);
    if (job.options.viewpoint) json["viewpoint"] = vector_json(*job.options.viewpoint);
    if (job.options.feature_lines) {
        json["feature_lines"] = feature_lines_json(*job.options.feature_lines);
    }
    add_output(json, job.output);
    add_outliers(json, job.outliers);
}

CurveJob read_curve(JsonObject& object) {
    CurveJob job;
    SimplifyOptions& method = job.options.simplification;
    if (const auto name = object.find("method")) method.method = name->named(method_from_name);
    refuse_fields_of_other_methods(object, method.method);
    if (object.has("points") && object.has("count"))
        throw object.error("count", "excludes points: give one of the two");
    if (const auto points = object.find("points")) {
        job.options.points = points->list_of([](const JsonValue& n) { return n.integer(1); });
        if (job.options.points.empty()) points->refuse("at least one count");
    }
    take(object, "count", job.options.count);
    take_own_options(object, method);
    take(object, "seed", method.seed);
    job.outliers = read_outliers(object);
    return job;
}

void add_options(Json& json, const CurveJob& job) {
    const SimplifyOptions& method = job.options.simplification;
    json["type"] = "curve";
    json["method"] = to_string(method.method);
    if (job.options.points.empty())
        json["count"] = job.options.count;
    else
        json["points"] = job.options.points;
    add_own_options(json, method);
    json["seed"] = method.seed;
    add_outliers(json, job.outliers);
}

/// Whether any of its files has points on a grid.
bool has_grid(const PyramidJob& job) {
    return makes(job, CloudFormat::Glb) || makes(job, CloudFormat::Progressive) ||
           makes(job, CloudFormat::Copc);
}

std::array<double, 16> read_transform(const JsonValue& value) {
    const std::vector<JsonValue> numbers = value.items();
    std::array<double, 16> transform{};
    if (numbers.size() != transform.size()) value.refuse("16 numbers, column by column");
    for (std::size_t i = 0; i < numbers.size(); ++i) transform[i] = numbers[i].number();
    if (const std::string_view expected = transform_expected(transform); !expected.empty())
        value.refuse(expected);
    return transform;
}

/// To a grid of so many bits, or within a length.
template <typename Options>
void read_rounding(JsonObject& object, unsigned least_bits, unsigned most_bits, Options& options) {
    const auto position_bits = object.find("position_bits");
    const auto precision = object.find("precision");
    if (position_bits && precision)
        throw object.error("precision", "excludes position_bits: give one of the two");
    if (position_bits) options.position_bits = position_bits->small_integer(least_bits, most_bits);
    if (!precision) return;
    options.precision = precision->number();
    if (!(*options.precision > 0)) precision->refuse("a length above 0, in input units");
}

void read_tiles(const JsonValue& value, PyramidJob& job) {
    if (!has_grid(job) && !value.members().empty())
        value.refuse("none without glb, stpc or copc.laz among the formats");
    JsonObject object = value.object();
    LodTileOptions& tiles = job.tiles;
    read_rounding(object, 2, 24, tiles);
    if (const auto most = object.find("max_points"))
        tiles.max_points = most->small_integer(1, 65'536);
    take(object, "attributes", tiles.attributes);
    bool exact = false;
    take(object, "exact_errors", exact);
    if (exact) tiles.errors = LodErrors::Exact;
    const auto transform = object.find("transform");
    const auto epsg = object.find("epsg");
    if (transform && epsg) {
        throw object.error("epsg", "excludes transform: give one of the two");
    }
    if (transform) job.transform = read_transform(*transform);
    if (epsg) {
        job.epsg = epsg->small_integer();
        if (!is_on_globe(*job.epsg))
            epsg->refuse("4978, 3857, 32601..32660, 32701..32760, 25828..25838 or 26901..26923");
    }
    object.finish();
}

Json tiles_json(const PyramidJob& job) {
    Json json;
    if (job.tiles.precision) {
        json["precision"] = *job.tiles.precision;
    } else {
        json["position_bits"] = job.tiles.position_bits;
    }
    json["max_points"] = job.tiles.max_points;
    json["attributes"] = job.tiles.attributes;
    json["exact_errors"] = job.tiles.errors == LodErrors::Exact;
    if (job.transform) json["transform"] = *job.transform;
    if (job.epsg) json["epsg"] = *job.epsg;
    return json;
}

constexpr std::array kRefinements = {Named<bool>{false, "replace"}, Named<bool>{true, "add"}};

/// How many points, in how many levels.
void read_sizes(JsonObject& object, PyramidJob& job) {
    LodPyramidOptions& options = job.options;
    const auto levels = object.find("levels");
    const auto ratio = object.find("ratio");
    const auto base_points = object.find("base_points");
    const auto base_bytes = object.find("base_bytes");
    if (levels && (ratio || base_points || base_bytes)) {
        throw object.error("levels", "excludes ratio and base_points: give one form");
    }
    if (base_points && base_bytes) {
        throw object.error("base_bytes", "excludes base_points: give one of the two");
    }
    if (levels) {
        options.sizes = levels->list_of([](const JsonValue& size) { return size.integer(1); });
        if (options.sizes.empty()) levels->refuse("at least one size");
    }
    if (ratio) options.ratio = ratio->number();
    if (base_points) options.base_points = base_points->integer(1);
    if (base_bytes) job.base_bytes = base_bytes->integer(1);
}

PyramidJob read_pyramid(JsonObject& object) {
    PyramidJob job;
    LodPyramidOptions& options = job.options;
    read_sizes(object, job);
    take(object, "refine", kRefinements, options.nested);
    SimplifyOptions& method = options.simplification;
    if (options.nested) method.method = Method::Iterative;
    if (const auto name = object.find("method")) method.method = name->named(method_from_name);
    refuse_fields_of_other_methods(object, method.method);
    take_own_options(object, method);
    take(object, "seed", method.seed);
    if (method.method != Method::Random) take_reductions(object, method.reductions);
    take(object, "error", job.error);

    job.output.formats.assign(kUsualFormats.begin(), kUsualFormats.end());
    if (const auto formats = object.find("formats")) {
        job.output.formats = read_formats(*formats, kPyramidFormats);
        if (job.output.formats.empty()) formats->refuse("at least one format");
    }
    if (job.base_bytes && !makes(job, CloudFormat::Glb))
        throw object.error("base_bytes", "is the size of a glb: expected glb among the formats");
    if (const auto draco = object.find("draco")) job.output.draco = read_draco(*draco);
    if (const auto tiles = object.find("tiles")) read_tiles(*tiles, job);
    job.outliers = read_outliers(object);
    return job;
}

void add_options(Json& json, const PyramidJob& job) {
    const LodPyramidOptions& options = job.options;
    json["type"] = "pyramid";
    if (options.sizes.empty()) {
        json["ratio"] = options.ratio;
        if (job.base_bytes) {
            json["base_bytes"] = *job.base_bytes;
        } else {
            json["base_points"] = options.base_points;
        }
    } else {
        json["levels"] = options.sizes;
    }
    json["refine"] = name_of(kRefinements, options.nested);
    const SimplifyOptions& method = options.simplification;
    json["method"] = to_string(method.method);
    add_own_options(json, method);
    json["seed"] = method.seed;
    if (method.method != Method::Random) json["reductions"] = reductions_json(method.reductions);
    json["error"] = job.error;
    json["formats"] = Json::array();
    for (const CloudFormat format : kPyramidFormats)
        if (makes(job, format)) json["formats"].push_back(to_string(format));
    json["draco"] = draco_json(job.output.draco);
    if (has_grid(job)) json["tiles"] = tiles_json(job);
    add_outliers(json, job.outliers);
}

}  // namespace

DracoEncodeOptions read_draco(const JsonValue& value) {
    JsonObject object = value.object();
    DracoEncodeOptions options;
    read_rounding(object, 0, 30, options);
    if (const auto bits = object.find("normal_bits")) {
        options.normal_bits = bits->small_integer(2, 30);
    }
    if (const auto bits = object.find("attribute_bits")) {
        options.attribute_bits = bits->small_integer(0, 30);
    }
    if (const auto level = object.find("compression_level")) {
        options.compression_level = level->small_integer(0, 10);
    }
    if (const auto coding = object.find("coding"))
        options.coding = coding->named(draco_coding_from_name);
    // Before the work that it would end.
    if (options.coding == DracoCoding::KdTree && !options.precision && options.position_bits == 0)
        throw object.error("coding",
                           "kd-tree holds no unquantised positions: expected sequential, "
                           "or other position_bits than 0");
    object.finish();
    return options;
}

Json draco_json(const DracoEncodeOptions& options) {
    Json json = {{"attribute_bits", options.attribute_bits},
                 {"coding", to_string(options.coding)},
                 {"compression_level", options.compression_level},
                 {"normal_bits", options.normal_bits}};
    if (options.precision) {
        json["precision"] = *options.precision;
    } else {
        json["position_bits"] = options.position_bits;
    }
    return json;
}

std::vector<CloudFormat> read_formats(const JsonValue& value, std::span<const CloudFormat> of) {
    std::vector<CloudFormat> formats;
    for (const JsonValue& item : value.items()) {
        const auto format = item.named(cloud_format_from_name);
        if (std::ranges::find(of, format) == of.end()) {
            std::string names;
            for (const CloudFormat one : of)
                names += (names.empty() ? "" : " or ") + std::string(to_string(one));
            item.refuse(names);
        }
        if (std::ranges::find(formats, format) != formats.end()) item.refuse("each format once");
        formats.push_back(format);
    }
    return formats;
}

std::string_view type_name(const JobRequest& request) noexcept {
    return kJobTypes[request.job.index()];
}

std::string_view transform_expected(const std::array<double, 16>& transform) noexcept {
    constexpr double kMost = 1e100;  // of which products are finite
    const Eigen::Map<const Eigen::Matrix4d> m(transform.data());
    if (!(m.array().abs() <= kMost).all()) return "finite numbers of at most 1e100";
    if (m.row(3) != Eigen::RowVector4d(0, 0, 0, 1))
        return "0, 0, 0 and 1 as the last number of its columns";
    const Eigen::Matrix3d linear = m.topLeftCorner<3, 3>();
    const double largest = linear.cwiseAbs().maxCoeff();
    if (!(largest > 0) || (linear / largest).determinant() == 0)
        return "a transform that keeps three dimensions";
    return {};
}

std::vector<std::string> inputs_of(const JobRequest& request) {
    std::vector<std::string> inputs = {request.input};
    if (const auto* job = std::get_if<EvaluateJob>(&request.job))
        inputs.insert(inputs.end(), job->candidates.begin(), job->candidates.end());
    return inputs;
}

std::string input_field(const JobRequest& request, std::size_t i) {
    if (i > 0) return "candidates[" + std::to_string(i - 1) + "]";
    return std::holds_alternative<EvaluateJob>(request.job) ? "reference" : "input";
}

Json request_json(const JobRequest& request) {
    const bool compares = std::holds_alternative<EvaluateJob>(request.job);
    Json json = {{compares ? "reference" : "input", request.input}};
    std::visit([&json](const auto& job) { add_options(json, job); }, request.job);
    return nlohmann::json(json);  // which sorts the keys
}

namespace {

std::string read_id(const JsonValue& value) {
    if (!is_sha256(value.text()))
        value.refuse("the id of a cloud: 64 lower-case hexadecimal digits");
    return value.text();
}

JobRequest read_evaluation(JsonObject& object) {
    JobRequest request;
    request.input = read_id(object["reference"]);
    request.job = read_evaluate(object);
    for (const std::string& id : std::get<EvaluateJob>(request.job).candidates) {
        if (!is_sha256(id))
            throw object.error("candidates",
                               "expected ids of clouds: 64 lower-case hexadecimal digits");
    }
    object.finish();
    return request;
}

JobRequest validated(JobRequest request) {
    std::visit([](const auto& job) { validate(job.options); }, request.job);
    return request;
}

}  // namespace

JobRequest read_request(const JsonValue& value) {
    JsonObject object = value.object();
    const JsonValue type = object["type"];
    if (type.text() == "evaluate") return read_evaluation(object);
    if (std::ranges::find(kJobTypes, type.text()) == kJobTypes.end()) type.refuse(kAnyJobType);
    JobRequest request;
    request.input = read_id(object["input"]);
    if (type.text() == "simplify") {
        request.job = read_simplify(object);
    } else if (type.text() == "pyramid") {
        request.job = read_pyramid(object);
    } else if (type.text() == "upsample") {
        request.job = read_upsample(object);
    } else if (type.text() == "analyze") {
        request.job = read_analyze(object);
    } else {
        request.job = read_curve(object);
    }
    object.finish();
    return request;
}

std::string to_json(const JobRequest& request) {
    return to_text(request_json(request));
}

JobRequest job_request_from_json(std::string_view json) {
    return validated(read_request(JsonDocument(json, kRequestRules).root()));
}

JobRequest stored_request_from_json(std::string_view json) {
    return read_request(JsonDocument(json, kStoredRules).root());
}

JobRequest evaluation_from_json(std::string_view json) {
    const JsonDocument document(json, kRequestRules);
    JsonObject object = document.object();
    if (const auto type = object.find("type"); type && type->text() != "evaluate")
        type->refuse("evaluate");
    return validated(read_evaluation(object));
}

DracoEncodeOptions draco_options_from_json(std::string_view json) {
    return read_draco(JsonDocument(json, kRequestRules).root());
}

}  // namespace stipple::proto
