#pragma once

#include "http/routes.hpp"

namespace stipple::server::http {

/// The document of a job once it is final, or as it is after `wait`. @throws Disconnected when the
/// client leaves meanwhile.
proto::JobDocument wait_for_job(Resources& resources, const Request& request, const std::string& id,
                                std::chrono::milliseconds wait);

/// The bytes of an output under its hash.
Reply output_reply(Resources& resources, const Request& request, const std::string& job_id,
                   const std::string& file_name);

}  // namespace stipple::server::http
