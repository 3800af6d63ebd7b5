#pragma once

#include "job_run.hpp"
#include "stipple/lod_pyramid.hpp"

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

namespace stipple::proto {

/// A level as one file, Draco or PLY. Spends the level where that is Draco, and tells the step of
/// its grid where that is asked for.
OutputFile write_level(LodLevel& made, CloudFormat format, const DracoEncodeOptions& draco,
                       const RunContext& context, const JobSpec& spec, double* step = nullptr);

/// Writes the levels of a result one after the other, in every format that is wanted, and reports
/// each once its files are complete.
class LevelEncoder {
public:
    /// Writes a level in a format that only pyramids have, and tells in the last argument what it
    /// found out about it.
    using OtherWriter = std::function<std::vector<OutputFile>(
        const LodLevel& made, CloudFormat format, const RunContext& context, OutputCloud& level)>;

    /// @param points  of all levels together, for the progress. @param begin  how much of the stage
    /// is done before the first level.
    LevelEncoder(JobRun& run, OutputOptions options, std::uint64_t points, double begin = 0,
                 OtherWriter write_other = {});

    /// Spends the level: Draco, which takes most memory, comes last and takes it over.
    void encode(LodLevel&& made, const std::optional<ErrorFigures>& error = {},
                const std::optional<MeasuredBound>& bound = {});

    /// The part of the stage in which the next level, of so many points, is measured.
    RunContext measuring(std::uint64_t points);

private:
    /// How much of the stage is done once `more` points are.
    double encoded(std::uint64_t more = 0) const;
    /// Where the measuring of a level of so many points ends.
    double measured(std::uint64_t points) const;
    /// That of a level, if measured, with what a Draco file of such steps rounds at most.
    std::optional<FileError> draco_error(const OutputCloud& level, double step) const;

    JobRun& run_;
    const OutputOptions options_;
    const OtherWriter write_other_;
    const double begin_;
    const std::uint64_t points_;
    std::uint64_t points_encoded_ = 0;
};

}  // namespace stipple::proto
