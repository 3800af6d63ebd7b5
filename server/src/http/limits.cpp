#include "http/routes.hpp"

#include <nlohmann/json.hpp>

namespace stipple::server::http {

Reply get_limits(Resources& resources, Request&) {
    const Limits& limits = resources.service.limits();
    auto methods = nlohmann::json::array();
    for (const Method method : kMethods) methods.push_back(to_string(method));
    auto formats = nlohmann::json::array();
    for (const CloudFormat format : kReadFormats) formats.push_back(to_string(format));
    const nlohmann::json json = {
        {"max_upload_bytes", limits.max_upload_bytes},
        {"max_points", limits.decode.max_points},
        {"max_attributes", limits.decode.max_attributes},
        {"max_job_memory_bytes", limits.max_job_memory_bytes},
        {"max_job_cpu_seconds", limits.max_job_cpu_seconds},
        {"max_job_output_bytes", limits.max_job_output_bytes},
        {"max_queued_jobs", limits.queue.max_queued},
        {"max_running_jobs", limits.queue.max_running},
        {"retention_seconds", limits.retention.count()},
        {"cloud_retention_seconds", limits.cloud_retention.count()},
        {"max_wait_seconds", limits.max_wait.count()},
        {"formats", formats},
        {"methods", methods},
    };
    return json_reply(200, json.dump());
}

}  // namespace stipple::server::http
