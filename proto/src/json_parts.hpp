#pragma once

#include "json_reader.hpp"
#include "stipple/proto/results.hpp"

namespace stipple::proto {

// The parts that documents share: each has one writer and one reader.

Json problem_json(const Problem& problem);
Problem read_problem(const JsonValue& value);

/// Canonical: defaults written out, keys sorted.
Json request_json(const JobRequest& request);
JobRequest read_request(const JsonValue& value);

Json vector_json(const Vec3d& v);
Vec3d read_vector(const JsonValue& value);

Json bounds_json(const Aabb& bounds);
Aabb read_bounds(const JsonValue& value);

/// Statistics stand among other fields in two documents, so they are added to an object and taken
/// from one.
void add_statistics(Json& json, const CloudStatistics& statistics);
CloudStatistics read_statistics(JsonObject& object);

}  // namespace stipple::proto
