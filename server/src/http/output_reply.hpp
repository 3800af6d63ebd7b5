#pragma once

#include "http/routes.hpp"

#include <memory>
#include <string>

namespace stipple::server::http {

/// The bytes of an output under its hash.
Reply output_reply(Resources& resources, const Request& request, const std::string& job_id,
                   const std::string& file_name);

/// Held while documents of a pyramid are written. @throws HttpError(503) when there is no place,
/// Disconnected when nobody waits any more.
std::shared_ptr<void> document_turn(Resources& resources, const Request& request);

/// A document of the pyramid that the path names: it grows while the job runs.
Reply document_reply(Resources& resources, const Request& request, const std::string& name,
                     const DocumentOptions& options = {});

/// Says what the coordinates of a Draco file are relative to, where that is not zero.
void tell_origin(Reply& reply, const Vec3d& origin);

}  // namespace stipple::server::http
