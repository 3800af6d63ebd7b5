#include "method_options.hpp"

#include "json_fields.hpp"
#include "json_parts.hpp"
#include "stipple/proto/option_names.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string>

namespace stipple::proto {

namespace {

void take_bounds(JsonObject& object, auto& options) {
    take(object, "max_cluster_size", options.max_cluster_size);
    take(object, "max_variation", options.max_variation);
    take(object, "representative", representative_from_name, options.representative);
}

void add_bounds(Json& json, const auto& options) {
    add(json, "max_cluster_size", options.max_cluster_size);
    add(json, "max_variation", options.max_variation);
    json["representative"] = to_string(options.representative);
}

void take_contraction(JsonObject& object, IterativeSimplificationOptions& options) {
    take(object, "k", options.k);
    take(object, "placement", placement_from_name, options.placement);
    take(object, "max_displacement", options.max_displacement);
    take(object, "color_weight", options.color_weight);
    if (const auto weights = object.find("attribute_weights")) {
        for (const auto& [name, weight] : weights->members()) {
            options.attribute_weights[name] = weight.number();
        }
    }
}

void add_contraction(Json& json, const IterativeSimplificationOptions& options) {
    json["k"] = options.k;
    json["placement"] = to_string(options.placement);
    add(json, "max_displacement", options.max_displacement);
    json["color_weight"] = options.color_weight;
    json["attribute_weights"] = Json(options.attribute_weights);
}

DensityRegion::Sphere read_sphere(const JsonValue& value) {
    JsonObject object = value.object();
    const DensityRegion::Sphere sphere{read_vector(object["center"]), object["radius"].number()};
    object.finish();
    return sphere;
}

DensityRegion::Box read_box(const JsonValue& value) {
    const Aabb box = read_bounds(value);
    return {box.min, box.max};
}

DensityRegion::Scalar read_scalar(const JsonValue& value) {
    JsonObject object = value.object();
    const DensityRegion::Scalar scalar{object["name"].text(), object["low"].number(),
                                       object["high"].number()};
    object.finish();
    return scalar;
}

std::variant<DensityRegion::Sphere, DensityRegion::Box, DensityRegion::Scalar> read_place(
    JsonObject& object) {
    const auto sphere = object.find("sphere");
    const auto box = object.find("box");
    const auto scalar = object.find("attribute");
    if (int{sphere.has_value()} + int{box.has_value()} + int{scalar.has_value()} != 1) {
        throw object.error("", "expected exactly one of sphere, box and attribute");
    }
    if (sphere) return read_sphere(*sphere);
    if (box) return read_box(*box);
    return read_scalar(*scalar);
}

DensityRegion read_region(const JsonValue& value) {
    JsonObject object = value.object();
    DensityRegion region{.where = read_place(object)};
    region.density = object["density"].number();
    take(object, "transition", region.transition);
    object.finish();
    return region;
}

void add_place(Json& json, const DensityRegion::Sphere& sphere) {
    json["sphere"] = {{"center", vector_json(sphere.center)}, {"radius", sphere.radius}};
}
void add_place(Json& json, const DensityRegion::Box& box) {
    json["box"] = bounds_json({box.min, box.max});
}
void add_place(Json& json, const DensityRegion::Scalar& scalar) {
    json["attribute"] = {{"name", scalar.attribute}, {"low", scalar.low}, {"high", scalar.high}};
}

Json region_json(const DensityRegion& region) {
    Json json = {{"density", region.density}, {"transition", region.transition}};
    std::visit([&json](const auto& where) { add_place(json, where); }, region.where);
    return json;
}

}  // namespace

void take_particles(JsonObject& object, ParticleSimulationOptions& options) {
    take(object, "adaptivity", options.adaptivity);
    take(object, "max_grading", options.max_grading);
    take(object, "max_iterations", options.max_iterations);
    take(object, "tolerance", options.tolerance);
    if (const auto regions = object.find("regions")) {
        options.regions = regions->list_of(read_region);
    }
}

void add_particles(Json& json, const ParticleSimulationOptions& options) {
    json["adaptivity"] = options.adaptivity;
    json["max_grading"] = options.max_grading;
    json["max_iterations"] = options.max_iterations;
    json["tolerance"] = options.tolerance;
    json["regions"] = Json::array();
    for (const DensityRegion& region : options.regions) {
        json["regions"].push_back(region_json(region));
    }
}

void take_own_options(JsonObject& object, SimplifyOptions& options) {
    switch (options.method) {
        case Method::Multiphase:
            take(object, "oversampling", options.oversampling);
            return take_contraction(object, options.iterative);
        case Method::Hierarchical:
            return take_bounds(object, options.hierarchical);
        case Method::Incremental:
            return take_bounds(object, options.incremental);
        case Method::Iterative:
            return take_contraction(object, options.iterative);
        case Method::Particles:
            return take_particles(object, options.particles);
        case Method::Voxel:
            take(object, "voxel_size", options.voxel.voxel_size);
            return take(object, "representative", representative_from_name,
                        options.voxel.representative);
        case Method::Random:
            return;
    }
}

void add_own_options(Json& json, const SimplifyOptions& options) {
    switch (options.method) {
        case Method::Multiphase:
            json["oversampling"] = options.oversampling;
            return add_contraction(json, options.iterative);
        case Method::Hierarchical:
            return add_bounds(json, options.hierarchical);
        case Method::Incremental:
            return add_bounds(json, options.incremental);
        case Method::Iterative:
            return add_contraction(json, options.iterative);
        case Method::Particles:
            return add_particles(json, options.particles);
        case Method::Voxel:
            add(json, "voxel_size", options.voxel.voxel_size);
            json["representative"] = to_string(options.voxel.representative);
            return;
        case Method::Random:
            return;
    }
}

void refuse_fields_of_other_methods(JsonObject& object, Method method) {
    for (const MethodField& field : method_fields()) {
        if (field.has(method) || !object.has(field.name)) continue;
        // Clients that fill in what the schema says have the defaults of all methods.
        SimplifyOptions options;
        options.method = field.methods.front();
        Json defaults;
        add_own_options(defaults, options);
        const std::string name(field.name);
        const auto usual = defaults.find(name);
        if (usual != defaults.end() && object[name.c_str()].is(*usual)) continue;
        throw object.error(field.name, misplaced(field, method));
    }
}

void take_reductions(JsonObject& object, std::map<std::string, Reduction>& reductions) {
    const auto value = object.find("reductions");
    if (!value) return;
    for (const auto& [name, reduction] : value->members()) {
        reductions[name] = reduction.named(reduction_from_name);
    }
}

Json reductions_json(const std::map<std::string, Reduction>& reductions) {
    Json json = Json::object();
    for (const auto& [name, reduction] : reductions) json[name] = to_string(reduction);
    return json;
}

void take_max_error(JsonObject& object, SimplifyOptions& options) {
    const auto value = object.find("max_error");
    if (!value) return;
    if (value->is_text()) {
        options.max_error_rel = value->named(part_of_diagonal);
    } else {
        options.max_error = value->number();
    }
}

void add_max_error(Json& json, const SimplifyOptions& options) {
    add(json, "max_error", options.max_error);
    if (options.max_error_rel) json["max_error"] = percent_text(*options.max_error_rel);
}

namespace {

/// A number whose decimal point is moved: 100 times a double is not always a double.
/// @returns nothing where the text is no number.
std::optional<double> with_point_moved(std::string_view text, int places) {
    const auto e = std::min(text.find_first_of("eE"), text.size());
    int exponent = 0;
    if (e < text.size()) {
        const char* const digits = text.data() + e + (text.substr(e + 1).starts_with('+') ? 2 : 1);
        const char* const end = text.data() + text.size();
        const auto [stop, error] = std::from_chars(digits, end, exponent);
        if (error != std::errc() || stop != end) return {};
    }
    const std::string moved =
        std::string(text.substr(0, e)) + 'e' + std::to_string(std::int64_t{exponent} + places);
    double value = 0;
    const auto [stop, error] = std::from_chars(moved.data(), moved.data() + moved.size(), value);
    if (error != std::errc() || stop != moved.data() + moved.size()) return {};
    return value;
}

/// The shortest text that reads back as the number.
std::string shortest(double value, std::chars_format format) {
    std::array<char, 32> text{};
    return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value, format).ptr};
}

}  // namespace

std::string percent_text(double part) {
    const std::string digits = shortest(part, std::chars_format::scientific);
    const double percent = with_point_moved(digits, 2).value_or(100 * part);
    std::string text = shortest(percent, std::chars_format::general);
    if (with_point_moved(text, -2) == part) return text + '%';
    const auto e = digits.find('e');
    const int exponent = std::stoi(digits.substr(e + 1));
    return digits.substr(0, e + 1) + std::to_string(exponent + 2) + '%';
}

double part_of_diagonal(std::string_view text) {
    const auto part =
        text.ends_with('%') ? with_point_moved(text.substr(0, text.size() - 1), -2) : std::nullopt;
    if (!part || !(*part > 0))
        throw Error(
            ErrorCode::InvalidArgument,
            "max_error " + std::string(text.substr(0, 60)) +
                ": expected a distance in input units, or as in 0.1% of the diagonal, above 0");
    return *part;
}

bool MethodField::has(Method method) const noexcept {
    return std::ranges::find(methods, method) != methods.end();
}

std::span<const MethodField> method_fields() {
    using enum Method;
    static const std::vector<Method> contracting = {Multiphase, Iterative};
    static const std::vector<Method> bounded = {Hierarchical, Incremental};
    static const std::vector<MethodField> fields = {
        {"oversampling", {Multiphase}},
        {"k", contracting},
        {"placement", contracting},
        {"max_displacement", contracting},
        {"color_weight", contracting},
        {"attribute_weights", contracting},
        {"max_cluster_size", bounded},
        {"max_variation", bounded},
        {"representative", {Hierarchical, Incremental, Voxel}},
        {"adaptivity", {Particles}},
        {"max_grading", {Particles}},
        {"regions", {Particles}},
        {"max_iterations", {Particles}},
        {"tolerance", {Particles}},
        {"voxel_size", {Voxel}},
        {"reductions", {Multiphase, Hierarchical, Incremental, Iterative, Particles, Voxel}},
    };
    return fields;
}

std::string misplaced(const MethodField& field, Method method) {
    std::string owners;
    for (const Method owner : field.methods) {
        const bool last = owner == field.methods.back();
        if (!owners.empty()) owners += last ? " and " : ", ";
        owners += to_string(owner);
    }
    return "belongs to " + owners + ", not to " + std::string(to_string(method));
}

}  // namespace stipple::proto
