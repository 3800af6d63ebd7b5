#include "stipple/proto/evaluation.hpp"

#include "json_fields.hpp"
#include "json_parts.hpp"
#include "names.hpp"
#include "stipple/error.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace stipple::proto {

namespace {

constexpr std::array kSamplings = {
    Named<ErrorSampling>{ErrorSampling::Points, "points"},
    Named<ErrorSampling>{ErrorSampling::Surface, "surface"},
    Named<ErrorSampling>{ErrorSampling::Particles, "particles"},
};
constexpr std::array kSurfaces = {
    Named<ErrorSurface>{ErrorSurface::Linear, "linear"},
    Named<ErrorSurface>{ErrorSurface::Quadratic, "quadratic"},
    Named<ErrorSurface>{ErrorSurface::Samples, "samples"},
};

constexpr std::size_t kMostLabelBytes = 200;

[[noreturn]] void refuse(const std::string& what) {
    throw Error(ErrorCode::InvalidArgument, what);
}

std::string text_of(const JsonValue& value) {
    return value.text();
}

Json direction_json(const DirectedError& error, const SurfaceError& all) {
    const auto part = [&all](double distance) { return relative(distance, all); };
    Json json = {{"max", error.max}, {"mean", error.mean},
                 {"rms", error.rms}, {"mean_confidence", error.mean_confidence},
                 {"p50", error.p50}, {"p95", error.p95},
                 {"p99", error.p99}};
    if (error.max_at) json["max_at"] = vector_json(*error.max_at);
    if (!error.histogram.empty()) json["histogram"] = error.histogram;
    json["samples"] = error.samples;
    json["not_converged"] = error.not_converged;
    add(json, "cover_radius", error.cover_radius);
    json["relative"] = {{"max", part(error.max)}, {"mean", part(error.mean)},
                        {"rms", part(error.rms)}, {"mean_confidence", part(error.mean_confidence)},
                        {"p50", part(error.p50)}, {"p95", part(error.p95)},
                        {"p99", part(error.p99)}};
    if (error.attributes.empty()) return json;
    json["attributes"] = Json::array();
    for (const AttributeError& a : error.attributes) {
        Json& attribute = json["attributes"].emplace_back(
            Json{{"name", a.name}, {"max", a.max}, {"mean", a.mean}, {"rms", a.rms}});
        add(attribute, "differing", a.differing);
    }
    return json;
}

DirectedError read_direction(const JsonValue& value) {
    JsonObject object = value.object();
    DirectedError error;
    error.max = object["max"].number();
    error.mean = object["mean"].number();
    error.rms = object["rms"].number();
    error.mean_confidence = object["mean_confidence"].number();
    error.p50 = object["p50"].number();
    error.p95 = object["p95"].number();
    error.p99 = object["p99"].number();
    if (const auto place = object.find("max_at")) error.max_at = read_vector(*place);
    if (const auto histogram = object.find("histogram"))
        error.histogram = histogram->list_of([](const JsonValue& bin) { return bin.number(); });
    error.samples = object["samples"].integer();
    error.not_converged = object["not_converged"].number();
    take(object, "cover_radius", error.cover_radius);
    (void)object["relative"];  // follows from the rest
    if (const auto attributes = object.find("attributes")) {
        error.attributes = attributes->list_of([](const JsonValue& item) {
            JsonObject fields = item.object();
            AttributeError attribute{fields["name"].text(), fields["max"].number(),
                                     fields["mean"].number(), fields["rms"].number()};
            take(fields, "differing", attribute.differing);
            fields.finish();
            return attribute;
        });
    }
    object.finish();
    return error;
}

}  // namespace

std::string_view to_string(ErrorSampling sampling) noexcept {
    return name_of(kSamplings, sampling);
}
std::string_view to_string(ErrorSurface surface) noexcept {
    return name_of(kSurfaces, surface);
}
ErrorSampling error_sampling_from_name(std::string_view name) {
    return by_name(kSamplings, name);
}
ErrorSurface error_surface_from_name(std::string_view name) {
    return by_name(kSurfaces, name);
}

double relative(double distance, const SurfaceError& error) noexcept {
    return error.diagonal > 0 ? distance / error.diagonal : 0;
}

ErrorFigures error_figures(const SurfaceError& error, const SurfaceErrorOptions& options,
                           std::uint64_t reference_points, std::uint64_t candidate_points) {
    ErrorFigures figures{error, sampling_of(options, reference_points, candidate_points),
                         options.surface};
    for (DirectedError* const direction : {&figures.error.forward, &figures.error.backward}) {
        direction->positions.clear();
        direction->distances.clear();
    }
    const auto warn = [&figures](std::string text) { figures.warnings.push_back(std::move(text)); };
    const auto warn_of_few = [&](const char* which, std::uint64_t points) {
        if (points < options.k && options.surface != ErrorSurface::Samples)
            warn(which + std::string(" of ") + std::to_string(points) +
                 (points == 1 ? " point" : " points") + ", fewer than the " +
                 std::to_string(options.k) +
                 " neighbours that define a surface: distances mean little");
    };
    warn_of_few("reference", reference_points);
    warn_of_few("candidate", candidate_points);
    const auto warn_of_far = [&](const char* which) {
        warn("the largest distance is above the diagonal of the " + std::string(which) +
             ": do both clouds use the same unit and lie in the same place?");
    };
    if (!(error.diagonal > 0))
        warn("all points of the reference coincide: there is no diagonal to compare with");
    else if (error.max() > error.diagonal)
        warn_of_far("reference");
    else if (candidate_points >= options.k && error.max() > error.candidate_diagonal)
        warn_of_far("candidate");
    constexpr double kMany = 0.05;
    for (const DirectedError* const direction : {&error.forward, &error.backward}) {
        if (direction->not_converged <= kMany) continue;
        warn(
            "more than 5 % of the samples have no foot point on the surface, as in noise and "
            "leaves, or with few points: their distances may be too long");
        break;
    }
    return figures;
}

Json error_json(const ErrorFigures& figures) {
    const SurfaceError& error = figures.error;
    const auto part = [&error](double distance) { return relative(distance, error); };
    Json json = {
        {"max", error.max()},
        {"mean", error.mean()},
        {"rms", error.rms()},
        {"relative",
         {{"max", part(error.max())}, {"mean", part(error.mean())}, {"rms", part(error.rms())}}},
        {"forward", direction_json(error.forward, error)},
        {"backward", direction_json(error.backward, error)},
        {"diagonal", error.diagonal},
        {"samples", error.forward.samples},
        {"sampling", to_string(figures.sampling)},
        {"basis", to_string(figures.surface)}};
    if (figures.range) json["range"] = *figures.range;
    if (!figures.warnings.empty()) json["warnings"] = figures.warnings;
    return json;
}

std::string to_json(const ErrorFigures& figures) {
    return to_text(error_json(figures));
}

ErrorFigures read_error(JsonObject& object) {
    ErrorFigures figures;
    for (const char* derived : {"max", "mean", "rms", "relative", "samples"}) (void)object[derived];
    figures.error.forward = read_direction(object["forward"]);
    figures.error.backward = read_direction(object["backward"]);
    figures.error.diagonal = object["diagonal"].number();
    figures.sampling = one_of(kSamplings, object["sampling"]);
    figures.surface = one_of(kSurfaces, object["basis"]);
    if (const auto range = object.find("range")) figures.range = range->number();
    if (const auto warnings = object.find("warnings"))
        figures.warnings = warnings->list_of(text_of);
    return figures;
}

void validate(const EvaluationOptions& options) {
    validate(options.measure);
    if (options.range && !(*options.range > 0 && std::isfinite(*options.range)))
        refuse("range " + Json(*options.range).dump() +
               ": expected a distance above 0, in input units");
    if (options.up != 'x' && options.up != 'y' && options.up != 'z')
        refuse("up " + std::string(1, options.up) + ": expected x, y or z");
    if (options.views.empty() || options.views.size() > kViews.size())
        refuse(std::to_string(options.views.size()) + " views: expected 1 to " +
               std::to_string(kViews.size()));
    for (const std::string& view : options.views) {
        if (std::ranges::find(kViews, view) != kViews.end()) continue;
        refuse("views: \"" + view.substr(0, 60) +
               "\": expected front, right, back, left, top or bottom");
    }
    for (const std::string& label : options.labels) {
        if (label.size() > kMostLabelBytes)
            refuse("a label of " + std::to_string(label.size()) + " bytes: expected at most " +
                   std::to_string(kMostLabelBytes));
    }
}

EvaluateJob read_evaluate(JsonObject& object) {
    EvaluateJob job;
    EvaluationOptions& options = job.options;
    SurfaceErrorOptions& measure = options.measure;
    const auto one = object.find("candidate");
    const auto several = object.find("candidates");
    if (one.has_value() == several.has_value())
        throw object.error("candidates",
                           "expected either candidates or candidate, for a single one");
    job.candidates = one ? std::vector{one->text()} : several->list_of(text_of);
    if (job.candidates.empty() || job.candidates.size() > kMostCandidates)
        throw object.error("candidates", std::to_string(job.candidates.size()) +
                                             " of them: expected 1 to " +
                                             std::to_string(kMostCandidates));
    if (const auto value = object.find("samples")) measure.samples = value->integer();
    if (const auto value = object.find("sampling")) measure.sampling = one_of(kSamplings, *value);
    if (const auto value = object.find("basis")) measure.surface = one_of(kSurfaces, *value);
    if (const auto value = object.find("k")) measure.k = value->small_integer();
    if (const auto value = object.find("seed")) measure.seed = value->integer();
    if (const auto value = object.find("attributes")) measure.attributes = value->boolean();
    if (const auto value = object.find("range")) options.range = value->number();
    if (const auto value = object.find("pictures")) options.pictures = value->boolean();
    if (const auto value = object.find("views")) options.views = value->list_of(text_of);
    if (const auto value = object.find("up")) {
        if (value->text().size() != 1) value->refuse("x, y or z");
        options.up = value->text().front();
    }
    if (const auto value = object.find("labels")) {
        options.labels = value->list_of(text_of);
        if (!options.labels.empty() && options.labels.size() != job.candidates.size())
            value->refuse("one for each candidate");
    }
    if (const auto value = object.find("map")) {
        constexpr std::array kMapFormats = {CloudFormat::Ply, CloudFormat::Draco};
        job.output.formats = read_formats(*value, kMapFormats);
    }
    if (const auto value = object.find("draco")) job.output.draco = read_draco(*value);
    return job;
}

void add_options(Json& json, const EvaluateJob& job) {
    const EvaluationOptions& options = job.options;
    const SurfaceErrorOptions& measure = options.measure;
    json["type"] = "evaluate";
    json["candidates"] = job.candidates;
    json["samples"] = measure.samples;
    json["sampling"] = to_string(measure.sampling);
    json["basis"] = to_string(measure.surface);
    json["k"] = measure.k;
    json["seed"] = measure.seed;
    json["attributes"] = measure.attributes;
    json["map"] = Json::array();
    for (const CloudFormat format : job.output.formats) json["map"].push_back(to_string(format));
    json["draco"] = draco_json(job.output.draco);
    if (options.range) json["range"] = *options.range;
    json["pictures"] = options.pictures;
    json["views"] = options.views;
    json["up"] = std::string(1, options.up);
    json["labels"] = options.labels;
}

}  // namespace stipple::proto
