#pragma once

#include "stipple/proto/job_process.hpp"

#include <string>
#include <string_view>

/// Documents with every field set, and the golden files that pin how they travel. With a sanitizer
/// they take as long to compile as the longest test here: so they have a source of their own.
namespace stipple::test {

inline const std::string kInput(64, 'a');

/// A golden file on one line, its keys in their order.
std::string golden(std::string_view name);

proto::JobRequest simplify_request();
proto::JobRequest particles_request();
proto::JobRequest upsample_request();
proto::JobRequest analyze_request();
proto::JobRequest evaluate_request();
proto::JobRequest pyramid_request();
proto::CloudStatistics statistics();
proto::JobDocument failed_job();
proto::CloudDocument cloud_document();
LodTile tile();
DirectedError directed_error();
proto::ErrorFigures error_figures();
proto::OutputCloud output_cloud();
proto::JobCost job_cost();
proto::Results pyramid_results();
proto::JobSpec job_spec();

/// The message of the error that `json` is refused with; empty when it is taken.
template <typename Parse>
std::string refusal(Parse&& parse, const std::string& json, ErrorCode expected) {
    try {
        parse(json);
    } catch (const Error& error) {
        if (error.code() == expected) return error.what();
        return "wrong code " + std::string(to_string(error.code())) + ": " + error.what();
    }
    return {};
}

}  // namespace stipple::test
