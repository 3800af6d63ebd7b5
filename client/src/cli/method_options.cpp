#include "cli/method_options.hpp"

#include "cli/names.hpp"
#include "cli/numbers.hpp"
#include "cli/units.hpp"
#include "stipple/proto/job_request.hpp"
#include "stipple/proto/option_names.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>

namespace stipple::cli {

std::string option_of(std::string_view field) {
    if (field == "reductions") return "--reduce";
    if (field == "attribute_weights") return "--attribute-weight";
    if (field == "regions") return "--region";
    if (field == "feature_lines.variation") return "--feature-variation";
    std::string name = "--" + std::string(field);
    std::replace(name.begin(), name.end(), '_', '-');
    return name;
}

namespace {

void add_contraction(CLI::App& command, MethodValues& values) {
    command
        .add_option("--oversampling", values.oversampling,
                    "clusters per point of the result, 1..1000")
        ->type_name("M")
        ->capture_default_str()
        ->transform(real_number("clusters per point, 1..1000, as in 3"));
    command.add_option("--k", values.contraction.k, "neighbours a point may contract with, 3..32")
        ->type_name("K")
        ->capture_default_str()
        ->transform(small_number("3..32"));
    command
        .add_option("--placement", values.placement, "optimal, or end-point: a subset of the input")
        ->type_name("P")
        ->capture_default_str();
    command
        .add_option("--max-displacement", values.contraction.max_displacement,
                    "largest distance of a point from the surface of the input, in its units")
        ->type_name("D")
        ->transform(real_number("a length, in input units, as in 0.01"));
    command
        .add_option("--color-weight", values.contraction.color_weight,
                    "cost of a colour difference; 0: shape alone")
        ->type_name("W")
        ->capture_default_str()
        ->transform(real_number("a number of at least 0, as in 0.01"));
    command
        .add_option("--attribute-weight", values.attribute_weights,
                    "the same for an attribute; may be repeated")
        ->type_name("NAME=W")
        ->allow_extra_args(false);
}

void add_clustering(CLI::App& command, MethodValues& values) {
    command
        .add_option("--max-cluster-size", values.max_cluster_size,
                    "instead of a target: most points in a cluster")
        ->type_name("N")
        ->transform(whole_number());
    command
        .add_option("--max-variation", values.max_variation,
                    "instead of a target: most surface variation, in (0, 1/3]; incremental: also "
                    "beside one")
        ->type_name("S")
        ->transform(real_number("a number in (0, 1/3], as in 0.02"));
    command
        .add_option("--voxel-size", values.voxel_size,
                    "instead of a target: edge of a cube, input units")
        ->type_name("L")
        ->transform(real_number("a length, in input units, as in 0.01"));
    command.add_option("--representative", values.representative, "nearest, surface or centroid")
        ->type_name("KIND")
        ->capture_default_str();
}

/// `For hierarchical, incremental and voxel`; empty, which hides an option, when it is of none.
std::string owners(const proto::MethodField& field, std::span<const Method> methods) {
    std::vector<std::string> names;
    for (const Method method : methods)
        if (field.has(method)) names.emplace_back(to_string(method));
    if (names.empty()) return "";
    const std::string last = names.back();
    names.pop_back();
    return "For " + (names.empty() ? "" : joined(names, ", ") + " and ") + last;
}

std::vector<std::string> split(const std::string& text, char separator) {
    std::vector<std::string> parts;
    std::size_t from = 0;
    while (true) {
        const std::size_t to = text.find(separator, from);
        parts.push_back(text.substr(from, to - from));
        if (to == text.npos) return parts;
        from = to + 1;
    }
}

/// All of them, or none.
std::vector<double> numbers(const std::vector<std::string>& texts) {
    std::vector<double> values;
    for (const std::string& text : texts) {
        const std::optional<double> value = finite_number(text);
        if (!value) return {};
        values.push_back(*value);
    }
    return values;
}

[[noreturn]] void refuse_region(const std::string& text) {
    throw UsageError("--region " + text +
                     ": expected sphere:X,Y,Z,R:DENSITY, box:X0,Y0,Z0,X1,Y1,Z1:DENSITY or "
                     "attribute:NAME,LOW,HIGH:DENSITY, optionally with :TRANSITION");
}

using Place = decltype(DensityRegion::where);

std::optional<Place> read_place(const std::string& kind, const std::vector<std::string>& parts) {
    if (kind == "attribute") {
        if (parts.size() != 3) return std::nullopt;
        const std::vector<double> range = numbers({parts[1], parts[2]});
        if (range.empty()) return std::nullopt;
        return DensityRegion::Scalar{parts[0], range[0], range[1]};
    }
    const std::vector<double> v = numbers(parts);
    if (kind == "sphere" && v.size() == 4) return DensityRegion::Sphere{{v[0], v[1], v[2]}, v[3]};
    if (kind == "box" && v.size() == 6)
        return DensityRegion::Box{{v[0], v[1], v[2]}, {v[3], v[4], v[5]}};
    return std::nullopt;
}

}  // namespace

void add_method_options(CLI::App& command, MethodValues& values, std::span<const Method> methods) {
    add_contraction(command, values);
    add_clustering(command, values);
    add_particle_options(command, values);
    for (const proto::MethodField& field : proto::method_fields())
        if (field.name != "reductions")  // of all that make points of several
            command.get_option(option_of(field.name))->group(owners(field, methods));
}

void add_particle_options(CLI::App& command, MethodValues& values) {
    command
        .add_option("--adaptivity", values.particles.adaptivity,
                    "0: even; 1: closer where the surface bends")
        ->type_name("A")
        ->capture_default_str()
        ->transform(real_number("a number in [0, 1], as in 0.5"));
    command
        .add_option("--max-grading", values.particles.max_grading,
                    "ratio of largest to smallest distance, when adaptive")
        ->type_name("G")
        ->capture_default_str()
        ->transform(real_number("a number of at least 1, as in 4"));
    command
        .add_option("--region", values.regions,
                    "sphere:X,Y,Z,R:DENSITY[:TRANSITION], box:X0,Y0,Z0,X1,Y1,Z1:… or "
                    "attribute:NAME,LOW,HIGH:…; may be repeated")
        ->type_name("WHERE:DENSITY")
        ->allow_extra_args(false);
    command
        .add_option("--max-iterations", values.particles.max_iterations,
                    "iterations in each of three stages")
        ->type_name("I")
        ->capture_default_str()
        ->transform(small_number("1..4294967295"));
    command
        .add_option("--tolerance", values.particles.tolerance,
                    "converged when the mean step is below this fraction of the spacing")
        ->type_name("T")
        ->capture_default_str()
        ->transform(real_number("a number in (0, 1), as in 0.01"));
}

std::string naming_method_option(const std::string& refusal) {
    const std::size_t length = refusal.find_first_not_of("abcdefghijklmnopqrstuvwxyz_");
    const std::string field = refusal.substr(0, length);
    const auto fields = proto::method_fields();
    const bool is_known =
        field == "reductions" || field == "max_error" ||
        std::ranges::find(fields, field, &proto::MethodField::name) != fields.end();
    return is_known ? option_of(field) + refusal.substr(field.size()) : refusal;
}

void refuse_options_of_other_methods(const CLI::App& command, Method method) {
    for (const proto::MethodField& field : proto::method_fields()) {
        const std::string name = option_of(field.name);
        const CLI::Option* const option = command.get_option_no_throw(name);
        if (field.has(method) || option == nullptr || option->count() == 0) continue;
        throw UsageError(name + " " + proto::misplaced(field, method));
    }
}

ParticleSimulationOptions particle_options(const MethodValues& values) {
    ParticleSimulationOptions options = values.particles;
    for (const std::string& region : values.regions) options.regions.push_back(read_region(region));
    return options;
}

void set_method_options(const MethodValues& values, SimplifyOptions& options) {
    const auto representative =
        named("--representative", values.representative, proto::representative_from_name);
    options.hierarchical.max_cluster_size = values.max_cluster_size;
    options.hierarchical.max_variation = values.max_variation;
    options.hierarchical.representative = representative;
    options.incremental.max_cluster_size = values.max_cluster_size;
    options.incremental.max_variation = values.max_variation;
    options.incremental.representative = representative;
    options.voxel.voxel_size = values.voxel_size;
    options.voxel.representative = representative;
    options.oversampling = values.oversampling;
    options.iterative = values.contraction;
    options.iterative.placement =
        named("--placement", values.placement, proto::placement_from_name);
    for (const std::string& text : values.attribute_weights) {
        const std::size_t equals = text.rfind('=');
        const auto weight =
            equals == text.npos ? std::nullopt : finite_number(text.substr(equals + 1));
        if (equals == 0 || !weight)
            throw UsageError("--attribute-weight " + text + ": expected NAME=W, as in intensity=1");
        options.iterative.attribute_weights[text.substr(0, equals)] = *weight;
    }
    options.particles = particle_options(values);
}

DensityRegion read_region(const std::string& text) {
    // From both ends, for the name of an attribute may hold colons and commas.
    const std::size_t colon = text.find(':');
    const std::size_t comma = text.rfind(',');
    if (colon == text.npos || comma == text.npos || comma < colon) refuse_region(text);
    const std::string kind = text.substr(0, colon);
    const std::string before = text.substr(colon + 1, comma - colon - 1);
    const std::vector<std::string> last = split(text.substr(comma + 1), ':');
    if (last.size() < 2 || last.size() > 3) refuse_region(text);

    std::vector<std::string> parts;
    if (kind == "attribute") {
        const std::size_t end = before.rfind(',');
        if (end == before.npos) refuse_region(text);
        parts = {before.substr(0, end), before.substr(end + 1)};
    } else {
        parts = split(before, ',');
    }
    parts.push_back(last[0]);
    const std::optional<Place> place = read_place(kind, parts);
    const std::vector<double> figures = numbers({last.begin() + 1, last.end()});
    if (!place || figures.empty()) refuse_region(text);
    return {*place, figures[0], figures.size() > 1 ? figures[1] : 0.0};
}

Vec3d read_position(const std::string& text, const std::string& option) {
    const std::vector<double> v = numbers(split(text, ','));
    if (v.size() != 3) throw UsageError(option + " " + text + ": expected X,Y,Z");
    return {v[0], v[1], v[2]};
}

}  // namespace stipple::cli
