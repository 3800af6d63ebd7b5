#pragma once

#include "json_reader.hpp"
#include "stipple/proto/job_request.hpp"

#include <map>
#include <string>

namespace stipple::proto {

// The options of the methods, as fields of the jobs that use them. What is absent stays as it is.

/// Those that only the method of `options` has.
void take_own_options(JsonObject& object, SimplifyOptions& options);
void add_own_options(Json& json, const SimplifyOptions& options);
/// A better word than that the field is unknown. Takes those that have their defaults.
void refuse_fields_of_other_methods(JsonObject& object, Method method);

void take_particles(JsonObject& object, ParticleSimulationOptions& options);
void add_particles(Json& json, const ParticleSimulationOptions& options);

void take_reductions(JsonObject& object, std::map<std::string, Reduction>& reductions);
Json reductions_json(const std::map<std::string, Reduction>& reductions);

/// A distance: a number of input units, or text such as `0.1%` of the diagonal.
void take_max_error(JsonObject& object, SimplifyOptions& options);
void add_max_error(Json& json, const SimplifyOptions& options);

}  // namespace stipple::proto
