#pragma once

#include "http/routes.hpp"

namespace stipple::server::http {

/// One event as server-sent events write it.
void write_event(const JobEvent& event, const StreamWriter& write);
/// Whether nothing comes after it: a change to a final status.
bool is_last(const JobEvent& event);

/// The events of a job after `after`, until its final status, the client leaves or the server
/// stops.
Stream event_stream(Service& service, const Request& request, const std::string& job_id,
                    std::uint64_t after);

}  // namespace stipple::server::http
