#pragma once

#include "json_reader.hpp"
#include "stipple/proto/results.hpp"

#include <span>
#include <vector>

namespace stipple::proto {

// The parts that documents share: each has one writer and one reader.

Json problem_json(const Problem& problem);
Problem read_problem(const JsonValue& value);

/// Canonical: defaults written out, keys sorted.
Json request_json(const JobRequest& request);
JobRequest read_request(const JsonValue& value);

DracoEncodeOptions read_draco(const JsonValue& value);
Json draco_json(const DracoEncodeOptions& options);
std::vector<CloudFormat> read_formats(const JsonValue& value, std::span<const CloudFormat> of);

Json attributes_json(std::span<const CloudAttribute> attributes);
std::vector<CloudAttribute> read_attributes(const JsonValue& value);

/// The fields of a request to evaluate, but for `type` and `reference`.
EvaluateJob read_evaluate(JsonObject& object);
void add_options(Json& json, const EvaluateJob& job);

Json error_json(const ErrorFigures& figures);
/// Takes the figures from an object that may hold more.
ErrorFigures read_error(JsonObject& object);

Json level_json(const OutputCloud& cloud);
OutputCloud read_level(const JsonValue& value);
Json files_json(const OutputCloud& cloud);
Json pictures_json(const OutputCloud& cloud);

Json cost_json(const JobCost& cost);
JobCost read_cost(const JsonValue& value);

Json vector_json(const Vec3d& v);
Vec3d read_vector(const JsonValue& value);

Json bounds_json(const Aabb& bounds);
Aabb read_bounds(const JsonValue& value);

/// Statistics stand among other fields in two documents, so they are added to an object and taken
/// from one.
void add_statistics(Json& json, const CloudStatistics& statistics);
CloudStatistics read_statistics(JsonObject& object);

}  // namespace stipple::proto
