#pragma once

#include "http/routes.hpp"

#include <chrono>

namespace stipple::server::http {

/// How long a request waits that does not say.
inline constexpr std::chrono::seconds kDefaultWait{20};

/// A place for a request that may wait so long; none for one that does not wait. Taken before
/// anything is changed, so that who is refused can ask again.
std::shared_ptr<void> place_to_wait(Resources& resources, const Request& request,
                                    std::chrono::milliseconds wait);

/// The document of a job once it is final, or as it is after `wait`, in a place held by the caller.
/// @throws Disconnected when the client leaves meanwhile.
proto::JobDocument wait_for_job(Resources& resources, const Request& request, const std::string& id,
                                std::chrono::milliseconds wait);

/// The same of a job that was submitted for this request alone: it is dismissed when the client
/// leaves, since nobody else was told of it.
proto::JobDocument wait_for_own_job(Resources& resources, const Request& request,
                                    const std::string& id, std::chrono::milliseconds wait);

}  // namespace stipple::server::http
