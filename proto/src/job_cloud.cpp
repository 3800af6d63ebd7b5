#include "job_cloud.hpp"

#include "stipple/error.hpp"

#include <numeric>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace stipple::proto {

namespace {

std::string shown(std::uint64_t count, const char* what) {
    return std::to_string(count) + " " + what;
}

}  // namespace

void require_usable(const PointCloud& cloud, std::uint64_t points, const CleaningReport& removed,
                    const Aabb& box) {
    if (!cloud.empty()) return require_squares(box.diagonal());
    if (points == 0) throw Error(ErrorCode::MalformedInput, "the file holds no points");
    throw Error(ErrorCode::MalformedInput,
                "no point is left: of " + shown(points, "in the file ") +
                    shown(removed.non_finite, "have a NaN or infinite coordinate and ") +
                    shown(removed.duplicates, "are duplicates"));
}

std::optional<OutlierOptions> outliers_of(const JobRequest& request) {
    return std::visit(
        [](const auto& job) -> std::optional<OutlierOptions> {
            if constexpr (requires { job.outliers; }) return job.outliers;
            return std::nullopt;
        },
        request.job);
}

bool wants_source_index(const JobRequest& request) {
    return std::visit(
        [](const auto& job) {
            if constexpr (requires { job.added; }) return job.added.source_index;
            return false;
        },
        request.job);
}

void add_source_index(PointCloud& cloud) {
    std::vector<std::uint32_t> numbers(cloud.size());
    std::iota(numbers.begin(), numbers.end(), 0U);
    set_attribute(cloud, {"source_index", std::move(numbers), 1, Reduction::Nearest});
}

void to_frame_of(const PointCloud& cloud, ParticleSimulationOptions& options) {
    for (DensityRegion& region : options.regions) {
        if (auto* sphere = std::get_if<DensityRegion::Sphere>(&region.where)) {
            sphere->center -= cloud.origin;
        } else if (auto* box = std::get_if<DensityRegion::Box>(&region.where)) {
            box->min -= cloud.origin;
            box->max -= cloud.origin;
        }
    }
}

}  // namespace stipple::proto
