#include "stipple/proto/job_process.hpp"

#include "json_parts.hpp"

namespace stipple::proto {

namespace {

constexpr JsonRules kReportRules{.max_bytes = kMaxReportBytes, .max_depth = 12};

Json statistics_json(const CloudStatistics& statistics) {
    Json json;
    add_statistics(json, statistics);
    return json;
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
    const JsonDocument json(text, {.unknown_fields = UnknownFields::Refused});
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
    const auto members = json.root().members();
    if (members.size() != 1) throw object.error("", "expected exactly one report");
    if (const auto value = object.find("progress")) return read_progress(*value);
    if (const auto value = object.find("source")) return read_whole_statistics(*value);
    if (const auto value = object.find("level")) return read_level(*value);
    if (const auto value = object.find("cost")) return read_cost(*value);
    if (const auto value = object.find("problem")) return read_problem(*value);
    throw object.error(members[0].first, "expected progress, source, level, cost or problem");
}

}  // namespace stipple::proto
