#include "level_encoder.hpp"

#include "job_files.hpp"
#include "rounding_error.hpp"
#include "stipple/codec.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <string>
#include <utility>

namespace stipple::proto {

OutputFile write_level(LodLevel& made, CloudFormat format, const DracoEncodeOptions& draco,
                       const RunContext& context, const JobSpec& spec, double* step) {
    const std::vector<std::byte> bytes =
        format == CloudFormat::Draco ? encode_draco(std::move(made.cloud), draco, context, step)
                                     : encode_ply(made.cloud, {}, context);
    return write_output("level-" + std::to_string(made.level), format, bytes, spec);
}

LevelEncoder::LevelEncoder(JobRun& run, OutputOptions options, std::uint64_t points, double begin,
                           OtherWriter write_other)
    : run_(run),
      options_(std::move(options)),
      write_other_(std::move(write_other)),
      begin_(begin),
      points_(points) {}

void LevelEncoder::encode(LodLevel&& made, const std::optional<ErrorFigures>& error,
                          const std::optional<MeasuredBound>& bound) {
    const Stopwatch watch(run_.cost().encode_seconds);
    const std::size_t points = made.cloud.size();
    double from = error ? measured(points) : encoded();
    const double share = (encoded(points) - from) / static_cast<double>(options_.formats.size());

    OutputCloud level = {.level = made.level,
                         .points = points,
                         .spacing = made.spacing,
                         .bounds = bounds(made.cloud),
                         .files = {},
                         .error = error,
                         .origin = made.cloud.origin,
                         .attributes = attributes_of(made.cloud),
                         .bound = bound};
    std::vector<std::vector<OutputFile>> files(options_.formats.size());
    const auto encode_as = [&](std::size_t i) {
        const CloudFormat format = options_.formats[i];
        const RunContext context = run_.in_stage(kEncode).part(from, from + share);
        from += share;
        if (format != CloudFormat::Draco && format != CloudFormat::Ply) {
            files[i] = write_other_(made, format, context, level);
            return;
        }
        double step = 0;
        files[i] = {write_level(made, format, options_.draco, context, run_.spec(), &step)};
        if (format == CloudFormat::Draco) files[i].front().error = draco_error(level, step);
    };
    for (const bool draco : {false, true})
        for (std::size_t i = 0; i < files.size(); ++i)
            if ((options_.formats[i] == CloudFormat::Draco) == draco) encode_as(i);
    for (std::vector<OutputFile>& some : files)
        std::ranges::move(some, std::back_inserter(level.files));
    points_encoded_ += points;
    run_.advance(kEncode, encoded());
    run_.report(std::move(level));
}

RunContext LevelEncoder::measuring(std::uint64_t points) {
    return run_.in_stage(kEncode).part(encoded(), measured(points));
}

double LevelEncoder::encoded(std::uint64_t more) const {
    return std::lerp(begin_, 1.0,
                     static_cast<double>(points_encoded_ + more) / static_cast<double>(points_));
}

double LevelEncoder::measured(std::uint64_t points) const {
    constexpr double kMeasured = 0.3;  // of a level's part
    return std::lerp(encoded(), encoded(points), kMeasured);
}

std::optional<FileError> LevelEncoder::draco_error(const OutputCloud& level, double step) const {
    if (!level.error) return std::nullopt;
    const SurfaceError& error = level.error->error;
    const FileError added = error_of_step(step);
    return FileError{error.mean() + added.mean, error.max() + added.max};
}

}  // namespace stipple::proto
