#include "stipple/proto/results.hpp"

#include "json_parts.hpp"
#include "stipple/proto/digest.hpp"

#include <algorithm>
#include <span>

namespace stipple::proto {

namespace {

constexpr JsonRules kReportRules{ErrorCode::MalformedInput, 16 << 20, 12};

void put_figures(Json& json, const LodFigures& figures) {
    json["error"] = {{"mean", figures.error.mean},
                     {"max", figures.error.max},
                     {"p99", figures.error.p99},
                     {"mean_confidence", figures.error.mean_confidence},
                     {"samples", figures.error.samples}};
    json["spacing"] = figures.spacing;
    json["cover_radius"] = figures.cover_radius;
}

void read_figures(JsonObject& object, LodFigures& figures) {
    JsonObject error = object["error"].object();
    figures.error = {.mean = error["mean"].number(),
                     .max = error["max"].number(),
                     .p99 = error["p99"].number(),
                     .mean_confidence = error["mean_confidence"].number(),
                     .samples = error["samples"].integer()};
    error.finish();
    figures.spacing = object["spacing"].number();
    figures.cover_radius = object["cover_radius"].number();
}

/// All tiles of a level have the same bits.
Json decoded_json(const LodFigures& figures, std::span<const OutputFile> files) {
    Json json;
    const auto tile = std::ranges::find_if(files, [](const auto& file) { return !!file.tile; });
    if (tile != files.end()) json["bits"] = tile->tile->bits;
    put_figures(json, figures);
    return json;
}

LodFigures read_decoded(const JsonValue& value) {
    JsonObject object = value.object();
    LodFigures figures;
    if (const auto bits = object.find("bits")) bits->small_integer();
    read_figures(object, figures);
    object.finish();
    return figures;
}

Json tile_json(const LodTile& tile) {
    Json json;
    if (tile.parent) json["parent"] = *tile.parent;
    json["points"] = tile.points;
    json["bits"] = tile.bits;
    json["step"] = tile.step;
    json["offset"] = vector_json(tile.offset);
    json["last"] = tile.last;
    put_figures(json, tile);
    return json;
}

LodTile read_tile(const JsonValue& value) {
    JsonObject object = value.object();
    LodTile tile;
    if (const auto parent = object.find("parent")) tile.parent = parent->small_integer();
    tile.points = object["points"].integer(1);
    tile.bits = object["bits"].small_integer();
    tile.step = object["step"].number();
    tile.offset = read_vector(object["offset"]);
    const JsonValue last = object["last"];
    const std::vector<JsonValue> numbers = last.items();
    if (numbers.size() != tile.last.size()) last.refuse("3 numbers");
    for (std::size_t axis = 0; axis < numbers.size(); ++axis)
        tile.last[axis] = static_cast<std::uint16_t>(numbers[axis].integer(0, 65'535));
    read_figures(object, tile);
    object.finish();
    return tile;
}

Json file_json(const OutputFile& file) {
    Json json = {{"format", to_string(file.format)},
                 {"bytes", file.bytes},
                 {"sha256", file.sha256},
                 {"href", file.href}};
    if (file.tile) json["tile"] = tile_json(*file.tile);
    if (file.error) json["error"] = {{"mean", file.error->mean}, {"max", file.error->max}};
    return json;
}

FileError read_file_error(const JsonValue& value) {
    JsonObject object = value.object();
    const FileError error{object["mean"].number(), object["max"].number()};
    object.finish();
    return error;
}

/// Names files, so it must be nothing else.
std::string read_sha256(const JsonValue& value) {
    if (!is_sha256(value.text())) value.refuse("64 lower-case hexadecimal digits");
    return value.text();
}

OutputFile read_file(const JsonValue& value) {
    JsonObject object = value.object();
    OutputFile file;
    file.format = object["format"].named(cloud_format_from_name);
    file.bytes = object["bytes"].integer();
    file.sha256 = read_sha256(object["sha256"]);
    file.href = object["href"].text();
    if (const auto tile = object.find("tile")) file.tile = read_tile(*tile);
    if (const auto error = object.find("error")) file.error = read_file_error(*error);
    object.finish();
    return file;
}

Json picture_json(const PictureFile& picture) {
    return {{"width", picture.width},
            {"height", picture.height},
            {"bytes", picture.bytes},
            {"sha256", picture.sha256},
            {"href", picture.href}};
}

PictureFile read_picture(const JsonValue& value) {
    JsonObject object = value.object();
    PictureFile picture;
    picture.width = object["width"].small_integer();
    picture.height = object["height"].small_integer();
    picture.bytes = object["bytes"].integer();
    picture.sha256 = read_sha256(object["sha256"]);
    picture.href = object["href"].text();
    object.finish();
    return picture;
}

Json files_json(const OutputCloud& cloud) {
    Json files = Json::array();
    for (const OutputFile& file : cloud.files) files.push_back(file_json(file));
    return files;
}

Json pictures_json(const OutputCloud& cloud) {
    Json pictures = Json::array();
    for (const PictureFile& picture : cloud.pictures) pictures.push_back(picture_json(picture));
    return pictures;
}

ErrorFigures read_whole_error(const JsonValue& value) {
    JsonObject object = value.object();
    ErrorFigures figures = read_error(object);
    object.finish();
    return figures;
}

Json bound_json(const MeasuredBound& bound) {
    Json json = {{"max_error", bound.max_error},
                 {"forward", bound.forward},
                 {"backward", bound.backward},
                 {"samples", bound.samples},
                 {"sampling", to_string(bound.sampling)},
                 {"tries", bound.tries},
                 {"whole", bound.whole}};
    if (bound.points_off_surface > 0) json["points_off_surface"] = bound.points_off_surface;
    if (bound.ended_early) json["ended_early"] = true;
    if (bound.too_far)
        json["too_far"] = {{"points", bound.too_far->points},
                           {"place", vector_json(bound.too_far->place)},
                           {"distance", bound.too_far->distance}};
    return json;
}

TooFar read_too_far(const JsonValue& value) {
    JsonObject object = value.object();
    TooFar tried;
    tried.points = object["points"].integer(1);
    tried.place = read_vector(object["place"]);
    tried.distance = object["distance"].number();
    object.finish();
    return tried;
}

MeasuredBound read_bound(const JsonValue& value) {
    JsonObject object = value.object();
    MeasuredBound bound;
    bound.max_error = object["max_error"].number();
    bound.forward = object["forward"].number();
    bound.backward = object["backward"].number();
    bound.samples = object["samples"].integer();
    bound.sampling = object["sampling"].named(error_sampling_from_name);
    if (const auto off = object.find("points_off_surface"))
        bound.points_off_surface = off->integer();
    bound.tries = object["tries"].small_integer();
    bound.whole = object["whole"].boolean();
    if (const auto early = object.find("ended_early")) bound.ended_early = early->boolean();
    if (const auto too_far = object.find("too_far")) bound.too_far = read_too_far(*too_far);
    object.finish();
    return bound;
}

Json distances_json(const CurveDistances& distances) {
    return {{"max", distances.max}, {"mean", distances.mean}, {"rms", distances.rms}};
}

CurveDistances read_distances(const JsonValue& value) {
    JsonObject object = value.object();
    const CurveDistances distances{object["max"].number(), object["mean"].number(),
                                   object["rms"].number()};
    object.finish();
    return distances;
}

Json curve_json(const CurveError& error) {
    return {{"forward", distances_json(error.forward)},
            {"backward", distances_json(error.backward)},
            {"diagonal", error.diagonal}};
}

CurveError read_curve(const JsonValue& value) {
    JsonObject object = value.object();
    const CurveError error{read_distances(object["forward"]), read_distances(object["backward"]),
                           object["diagonal"].number()};
    object.finish();
    return error;
}

Json level_json(const OutputCloud& cloud) {
    Json json = {{"level", cloud.level},
                 {"points", cloud.points},
                 {"spacing", cloud.spacing},
                 {"bounds", bounds_json(cloud.bounds)}};
    if (cloud.origin) json["origin"] = vector_json(*cloud.origin);
    json["attributes"] = attributes_json(cloud.attributes);
    json["files"] = files_json(cloud);
    if (cloud.error) json["error"] = error_json(*cloud.error);
    if (cloud.decoded) json["decoded"] = decoded_json(*cloud.decoded, cloud.files);
    if (!cloud.pictures.empty()) json["pictures"] = pictures_json(cloud);
    if (cloud.bound) json["bound"] = bound_json(*cloud.bound);
    if (cloud.curve) json["curve"] = curve_json(*cloud.curve);
    return json;
}

OutputCloud read_level(const JsonValue& value) {
    JsonObject object = value.object();
    OutputCloud cloud;
    cloud.level = object["level"].small_integer();
    cloud.points = object["points"].integer();
    cloud.spacing = object["spacing"].number();
    cloud.bounds = read_bounds(object["bounds"]);
    if (const auto origin = object.find("origin")) cloud.origin = read_vector(*origin);
    cloud.attributes = read_attributes(object["attributes"]);
    cloud.files = object["files"].list_of(read_file);
    for (OutputFile& file : cloud.files)
        if (file.tile) file.tile->level = cloud.level;
    if (const auto error = object.find("error")) cloud.error = read_whole_error(*error);
    if (const auto decoded = object.find("decoded")) cloud.decoded = read_decoded(*decoded);
    if (const auto pictures = object.find("pictures"))
        cloud.pictures = pictures->list_of(read_picture);
    if (const auto bound = object.find("bound")) cloud.bound = read_bound(*bound);
    if (const auto curve = object.find("curve")) cloud.curve = read_curve(*curve);
    object.finish();
    return cloud;
}

Json cost_json(const JobCost& cost) {
    return {{"seconds",
             {{"decode", cost.decode_seconds},
              {"simplify", cost.simplify_seconds},
              {"splats", cost.splats_seconds},
              {"error", cost.error_seconds},
              {"encode", cost.encode_seconds},
              {"total", cost.total_seconds}}},
            {"peak_memory_bytes", cost.peak_memory_bytes},
            {"threads", cost.threads}};
}

JobCost read_cost(const JsonValue& value) {
    JsonObject object = value.object();
    JsonObject seconds = object["seconds"].object();
    JobCost cost;
    cost.decode_seconds = seconds["decode"].number();
    cost.simplify_seconds = seconds["simplify"].number();
    cost.splats_seconds = seconds["splats"].number();
    cost.error_seconds = seconds["error"].number();
    cost.encode_seconds = seconds["encode"].number();
    cost.total_seconds = seconds["total"].number();
    seconds.finish();
    cost.peak_memory_bytes = object["peak_memory_bytes"].integer();
    cost.threads = object["threads"].small_integer();
    object.finish();
    return cost;
}

Json statistics_json(const CloudStatistics& statistics) {
    Json json;
    add_statistics(json, statistics);
    return json;
}

std::string_view schema_of(const JobRequest& request) noexcept {
    if (std::holds_alternative<PyramidJob>(request.job)) return "stipple-pyramid/1";
    if (std::holds_alternative<EvaluateJob>(request.job)) return "stipple-evaluation/1";
    return "stipple-results/1";
}

Json source_json(const Results& results) {
    Json json = statistics_json(*results.source);
    json["sha256"] = results.request.input;
    return json;
}

CloudStatistics read_source(const JsonValue& value, const JobRequest& request) {
    JsonObject object = value.object();
    CloudStatistics source = read_statistics(object);
    if (const JsonValue hash = object["sha256"]; hash.text() != request.input) {
        hash.refuse("the input of the request");
    }
    object.finish();
    return source;
}

void require_text(const JsonValue& value, std::string_view expected) {
    if (value.text() != expected) value.refuse(expected);
}

Json progress_json(const JobProgress& progress) {
    return {{"stage", progress.stage}, {"percent", progress.percent}};
}

JobProgress read_progress(const JsonValue& value) {
    JsonObject object = value.object();
    JobProgress progress{object["stage"].text(), object["percent"].number()};
    object.finish();
    return progress;
}

CloudStatistics read_whole_statistics(const JsonValue& value) {
    JsonObject object = value.object();
    CloudStatistics statistics = read_statistics(object);
    object.finish();
    return statistics;
}

Json report_json(const JobProgress& progress) {
    return {{"progress", progress_json(progress)}};
}

Json report_json(const CloudStatistics& source) {
    return {{"source", statistics_json(source)}};
}

Json report_json(const OutputCloud& level) {
    return {{"level", level_json(level)}};
}

Json report_json(const JobCost& cost) {
    return {{"cost", cost_json(cost)}};
}

Json report_json(const Problem& problem) {
    return {{"problem", problem_json(problem)}};
}

}  // namespace

std::string to_json(const MeasuredBound& bound) {
    return to_text(bound_json(bound));
}

std::string to_json(const CurveError& error) {
    return to_text(curve_json(error));
}

std::optional<Method> method_of(const JobRequest& request) noexcept {
    if (std::holds_alternative<AnalyzeJob>(request.job) ||
        std::holds_alternative<EvaluateJob>(request.job))
        return std::nullopt;
    if (const auto* pyramid = std::get_if<PyramidJob>(&request.job))
        return pyramid->options.simplification.method;
    if (std::holds_alternative<UpsampleJob>(request.job)) return Method::Particles;
    if (const auto* curve = std::get_if<CurveJob>(&request.job))
        return curve->options.simplification.method;
    return std::get<SimplifyJob>(request.job).options.method;
}

void raise_tile_errors(Results& pyramid) {
    std::vector<LodTile*> tiles;
    for (OutputCloud& level : pyramid.levels)
        for (OutputFile& file : level.files)
            if (file.tile) tiles.push_back(&*file.tile);
    // Parents stand before their children.
    for (std::size_t i = tiles.size(); i-- > 0;) {
        const LodTile& tile = *tiles[i];
        if (!tile.parent) continue;
        TileError& above = tiles.at(*tile.parent)->error;
        above.mean = std::max(above.mean, tile.error.mean);
        above.max = std::max(above.max, tile.error.max);
        above.p99 = std::max(above.p99, tile.error.p99);
    }
}

std::string to_json(const Results& results) {
    Json json = {{"schema", schema_of(results.request)},
                 {"complete", results.complete},
                 {"request", request_json(results.request)}};
    if (results.source) json["source"] = source_json(results);
    if (const auto method = method_of(results.request)) json["method"] = to_string(*method);
    json["levels"] = Json::array();
    for (const OutputCloud& level : results.levels) json["levels"].push_back(level_json(level));
    if (results.cost) json["cost"] = cost_json(*results.cost);
    if (results.problem) json["problem"] = problem_json(*results.problem);
    return to_text(json);
}

std::string evaluation_json(const Results& results) {
    const auto& job = std::get<EvaluateJob>(results.request.job);
    const auto candidate = [&](std::size_t i) {
        const OutputCloud& cloud = results.levels.at(i);
        Json json = error_json(cloud.error.value());
        json["candidate"] = {{"id", job.candidates.at(i)}, {"points", cloud.points}};
        if (!cloud.files.empty()) json["files"] = files_json(cloud);
        return json;
    };
    Json json;
    if (results.levels.size() == 1) {
        json = candidate(0);
    } else {
        json["candidates"] = Json::array();
        for (std::size_t i = 0; i < results.levels.size(); ++i)
            json["candidates"].push_back(candidate(i));
    }
    json["reference"] = {{"id", results.request.input},
                         {"points", results.source ? results.source->points : 0}};
    if (!results.levels.empty() && !results.levels.front().pictures.empty())
        json["pictures"] = pictures_json(results.levels.front());
    return to_text(json);
}

/// A tile's parent stands before it, as all who read a pyramid rely on.
void require_parents_first(const Results& results, const JsonValue& levels) {
    std::size_t tiles = 0;
    for (const OutputCloud& level : results.levels) {
        for (const OutputFile& file : level.files) {
            if (!file.tile) continue;
            if (file.tile->parent && *file.tile->parent >= tiles)
                levels.refuse("the parent of tile " + std::to_string(tiles) + " before it, not " +
                              std::to_string(*file.tile->parent));
            ++tiles;
        }
    }
}

Results results_from_json(std::string_view text) {
    const JsonDocument json(text, {});
    JsonObject object = json.object();
    Results results;
    results.request = read_request(object["request"]);
    require_text(object["schema"], schema_of(results.request));
    if (const auto method = method_of(results.request)) {
        require_text(object["method"], to_string(*method));
    }
    results.complete = object["complete"].boolean();
    if (const auto source = object.find("source")) {
        results.source = read_source(*source, results.request);
    }
    const JsonValue levels = object["levels"];
    results.levels = levels.list_of(read_level);
    require_parents_first(results, levels);
    if (const auto cost = object.find("cost")) results.cost = read_cost(*cost);
    if (const auto problem = object.find("problem")) results.problem = read_problem(*problem);
    object.finish();
    return results;
}

std::string to_json(const JobSpec& spec) {
    Json json = {
        {"request", request_json(spec.request)},
        {"input_file", spec.input_file},
        {"output_dir", spec.output_dir},
        {"limits",
         {{"max_points", spec.limits.max_points}, {"max_attributes", spec.limits.max_attributes}}},
        {"max_memory_bytes", spec.max_memory_bytes},
        {"max_cpu_seconds", spec.max_cpu_seconds},
        {"max_file_bytes", spec.max_file_bytes},
        {"threads", spec.threads}};
    if (!spec.candidate_files.empty()) json["candidate_files"] = spec.candidate_files;
    return to_text(json);
}

JobSpec job_spec_from_json(std::string_view text) {
    const JsonDocument json(text, {});
    JsonObject object = json.object();
    JobSpec spec;
    spec.request = read_request(object["request"]);
    spec.input_file = object["input_file"].text();
    if (const auto files = object.find("candidate_files")) {
        spec.candidate_files = files->list_of([](const JsonValue& file) { return file.text(); });
    }
    spec.output_dir = object["output_dir"].text();
    JsonObject limits = object["limits"].object();
    spec.limits.max_points = limits["max_points"].integer();
    spec.limits.max_attributes = limits["max_attributes"].small_integer();
    limits.finish();
    spec.max_memory_bytes = object["max_memory_bytes"].integer();
    spec.max_cpu_seconds = object["max_cpu_seconds"].integer();
    spec.max_file_bytes = object["max_file_bytes"].integer();
    spec.threads = object["threads"].small_integer();
    object.finish();
    return spec;
}

std::string to_json(const JobReport& report) {
    return to_text(std::visit([](const auto& what) { return report_json(what); }, report));
}

JobReport job_report_from_json(std::string_view text) {
    const JsonDocument json(text, kReportRules);
    JsonObject object = json.object();
    if (json.root().members().size() != 1) throw object.error("", "expected exactly one report");
    if (const auto value = object.find("progress")) return read_progress(*value);
    if (const auto value = object.find("source")) return read_whole_statistics(*value);
    if (const auto value = object.find("level")) return read_level(*value);
    if (const auto value = object.find("cost")) return read_cost(*value);
    if (const auto value = object.find("problem")) return read_problem(*value);
    object.finish();  // refuses what it is instead
    throw object.error("", "expected exactly one report");
}

}  // namespace stipple::proto
