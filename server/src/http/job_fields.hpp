#pragma once

#include "http/message.hpp"
#include "stipple/proto/job_request.hpp"

#include <array>
#include <nlohmann/json.hpp>
#include <span>
#include <string_view>
#include <vector>

namespace stipple::server::http {

/// A field of a job that a query may name; the reader of jobs checks its range and names.
struct JobField {
    enum class Kind { Text, Count, Number, Truth, Distance };

    const char* name;
    Kind kind;
};

inline constexpr std::array kDracoFields = {
    JobField{"position_bits", JobField::Kind::Count},
    JobField{"precision", JobField::Kind::Number},
    JobField{"normal_bits", JobField::Kind::Count},
    JobField{"attribute_bits", JobField::Kind::Count},
    JobField{"compression_level", JobField::Kind::Count},
    JobField{"coding", JobField::Kind::Text},
};

void add_names(std::vector<std::string_view>& names, std::span<const JobField> fields);

/// Copies what the query has of these fields into an object, as a job has them.
/// @throws HttpError(400) for what is no number, or neither `true` nor `false`.
void copy_fields(const Request& request, std::span<const JobField> fields, nlohmann::json& out);

/// What `kDracoFields` ask for. @throws HttpError(400) for one of them with another format;
/// Error(InvalidArgument) for one out of range.
DracoEncodeOptions query_draco(const Request& request, CloudFormat format);

}  // namespace stipple::server::http
