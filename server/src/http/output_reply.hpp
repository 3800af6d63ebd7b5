#pragma once

#include "http/routes.hpp"

#include <string>

namespace stipple::server::http {

/// The bytes of an output under its hash.
Reply output_reply(Resources& resources, const Request& request, const std::string& job_id,
                   const std::string& file_name);

}  // namespace stipple::server::http
