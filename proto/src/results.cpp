#include "stipple/proto/results.hpp"

#include "json_parts.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <string>

namespace stipple::proto {

namespace {

std::string_view schema_of(const JobRequest& request) noexcept {
    if (std::holds_alternative<PyramidJob>(request.job)) return "stipple-pyramid/1";
    if (std::holds_alternative<EvaluateJob>(request.job)) return "stipple-evaluation/1";
    return "stipple-results/1";
}

Json source_json(const Results& results) {
    Json json;
    add_statistics(json, *results.source);
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

}  // namespace

void require_parents_first(std::span<const OutputCloud> levels) {
    std::size_t tiles = 0;
    for (const OutputCloud& level : levels) {
        for (const OutputFile& file : level.files) {
            if (!file.tile) continue;
            if (file.tile->parent && *file.tile->parent >= tiles) {
                throw Error(ErrorCode::MalformedInput,
                            "levels: expected the parent of tile " + std::to_string(tiles) +
                                " before it, not " + std::to_string(*file.tile->parent));
            }
            ++tiles;
        }
    }
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
                         {"points", results.source ? results.source->remaining() : 0}};
    if (!results.levels.empty() && !results.levels.front().pictures.empty())
        json["pictures"] = pictures_json(results.levels.front());
    return to_text(json);
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
    results.levels = object["levels"].list_of(read_level);
    require_parents_first(results.levels);
    if (const auto cost = object.find("cost")) results.cost = read_cost(*cost);
    if (const auto problem = object.find("problem")) results.problem = read_problem(*problem);
    object.finish();
    return results;
}

}  // namespace stipple::proto
