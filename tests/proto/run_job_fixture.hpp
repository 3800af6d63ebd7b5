#pragma once

#include "stipple/proto/run_job.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <filesystem>
#include <iterator>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace stipple::proto {

/// A job on a cloud in a folder of its own, and what it reports.
class RunJob : public testing::Test {
protected:
    RunJob() { std::filesystem::create_directory(folder_ / "out"); }

    JobSpec spec_for(const PointCloud& cloud, const decltype(JobRequest::job)& job) {
        const std::filesystem::path input = folder_ / "in.ply";
        write_cloud(cloud, input);
        return {.request = {std::string(64, 'a'), job},
                .input_file = input,
                .output_dir = folder_ / "out",
                .limits = {},
                .threads = 2};
    }

    void run(const JobSpec& spec, const RunContext& context = {}) {
        run_job(
            spec, [this](const JobReport& report) { reports_.push_back(report); }, context);
    }

    std::vector<OutputCloud> levels() const {
        std::vector<OutputCloud> result;
        for (const JobReport& report : reports_) {
            if (const auto* level = std::get_if<OutputCloud>(&report)) result.push_back(*level);
        }
        return result;
    }

    std::optional<CloudStatistics> source() const {
        for (const JobReport& report : reports_) {
            if (const auto* source = std::get_if<CloudStatistics>(&report)) return *source;
        }
        return std::nullopt;
    }

    std::filesystem::path output() const { return folder_ / "out" / "level-0.ply"; }

    std::size_t files_written() const {
        const std::filesystem::directory_iterator files(folder_ / "out");
        return static_cast<std::size_t>(std::distance(begin(files), end(files)));
    }

    test::TemporaryFolder folder_;
    std::vector<JobReport> reports_;
};

inline PyramidJob levels_of(std::vector<std::uint64_t> sizes) {
    PyramidJob job;
    job.options.sizes = std::move(sizes);
    job.output.formats = {CloudFormat::Draco, CloudFormat::Ply};
    return job;
}

}  // namespace stipple::proto
