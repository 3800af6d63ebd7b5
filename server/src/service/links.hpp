#pragma once

#include "stipple/codec.hpp"
#include "stipple/proto/job.hpp"
#include "stipple/proto/results.hpp"

#include <string>
#include <string_view>
#include <vector>

namespace stipple::server {

inline constexpr std::string_view kPictureExtension = "png";

/// Where replies say that things are: absolute paths, behind the prefix under which a proxy offers
/// this server.
class Links {
public:
    /// @param prefix  empty, or with a slash before and none behind: `/stipple`
    explicit Links(std::string prefix = {});

    const std::string& prefix() const noexcept { return prefix_; }
    std::string cloud(const std::string& id) const { return prefix_ + "/v1/clouds/" + id; }
    std::string job(const std::string& id) const { return prefix_ + "/v1/jobs/" + id; }

    std::vector<proto::Link> of_cloud(const std::string& id, CloudFormat format) const;
    std::vector<proto::Link> of_job(const std::string& id, const proto::JobRequest& request) const;

    /// Fills in where the files of a level are served.
    void fill(proto::OutputCloud& level, const std::string& job_id, bool pyramid) const;

private:
    std::string prefix_;
};

}  // namespace stipple::server
