#pragma once

#include "stipple/simplify.hpp"
#include "stipple/surface_attributes.hpp"

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace CLI {
class App;
}

namespace stipple::cli {

/// The options of the methods of `simplify`, as they are read.
struct MethodValues {
    std::string representative = "nearest", placement = "optimal";
    std::optional<std::uint64_t> max_cluster_size;
    std::optional<double> max_variation, voxel_size;
    double oversampling = MultiphaseOptions{}.oversampling;
    IterativeSimplificationOptions contraction;
    std::vector<std::string> attribute_weights;  ///< NAME=W
    ParticleSimulationOptions particles;
    std::vector<std::string> regions;  ///< as `read_region` takes them
};

/// Adds a group of options for each method, or for several that share them.
/// @param methods  that the command takes.
void add_method_options(CLI::App& command, MethodValues& values, std::span<const Method> methods);
/// Those of `particles` alone, which are those of `upsample`.
void add_particle_options(CLI::App& command, MethodValues& values);

/// The option that stands for a field of a request: `--reduce` for `reductions`.
std::string option_of(std::string_view field);
/// What a method refuses once it knows the cloud begins with a field of a request: here with the
/// option that stands for it.
std::string naming_method_option(const std::string& refusal);
/// @throws UsageError naming an option on the command line that belongs to other methods.
void refuse_options_of_other_methods(const CLI::App& command, Method method);
/// Sets the options of every method. @throws UsageError.
void set_method_options(const MethodValues& values, SimplifyOptions& options);
/// @throws UsageError.
ParticleSimulationOptions particle_options(const MethodValues& values);

/// `sphere:X,Y,Z,R:DENSITY`, `box:X0,Y0,Z0,X1,Y1,Z1:DENSITY` or `attribute:NAME,LOW,HIGH:DENSITY`,
/// each with `:TRANSITION` after it or not. @throws UsageError.
DensityRegion read_region(const std::string& text);
/// `X,Y,Z`. @throws UsageError naming `option`.
Vec3d read_position(const std::string& text, const std::string& option);

}  // namespace stipple::cli
