#include "evaluation_notes.hpp"
#include "job_cloud.hpp"
#include "job_files.hpp"
#include "job_run.hpp"
#include "level_encoder.hpp"
#include "stipple/cleaning.hpp"
#include "stipple/neighbors.hpp"
#include "stipple/picture/visual_error.hpp"
#include "stipple/proto/digest.hpp"
#include "stipple/surface_error.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace stipple::proto {

namespace {

namespace fs = std::filesystem;

/// Measures how far candidates are from a reference, and shows where.
class EvaluationRun {
public:
    EvaluationRun(JobRun& run, const EvaluateJob& job) : run_(run), job_(job) {}

    void run(const PointCloud& reference) {
        const bool shown = job_.options.pictures || !job_.output.formats.empty();
        SurfaceErrorOptions options = job_.options.measure;
        options.keep_samples = shown;
        SurfaceErrorMeter meter = [&] {
            const Stopwatch watch(run_.cost().error_seconds);
            return SurfaceErrorMeter(reference, options, run_.quietly());
        }();
        std::vector<Candidate> candidates;
        for (std::size_t i = 0; i < run_.spec().candidate_files.size(); ++i)
            candidates.push_back(evaluate(meter, i, reference.size(), options));
        run_.advance(kEvaluate, 1);
        if (shown) show(candidates, reference.origin);
        for (const Candidate& candidate : candidates) run_.report(candidate.level);
    }

private:
    struct Candidate {
        OutputCloud level;
        DirectedError samples;  ///< kept for its map
    };

    /// A candidate, counted from 0.
    /// @throws CandidateError.
    PointCloud read_candidate(std::size_t number) {
        const Stopwatch watch(run_.cost().decode_seconds);
        try {
            DecodeReport decoded;
            run_.advance(kDecode, 1);  // once more: a failure tells its stage
            PointCloud cloud = read_cloud(run_.spec().candidate_files.at(number), run_.limits(),
                                          run_.quietly(), &decoded);
            run_.advance(kClean, 1);
            const CleaningReport removed = clean(cloud, run_.quietly());
            require_usable(cloud, decoded.points, removed, bounds(cloud));
            return cloud;
        } catch (const Error& error) {
            throw CandidateError(static_cast<unsigned>(number + 1), error);
        }
    }

    Candidate evaluate(SurfaceErrorMeter& meter, std::size_t number, std::uint64_t reference_points,
                       const SurfaceErrorOptions& options) {
        const double all = static_cast<double>(run_.spec().candidate_files.size());
        const double before = static_cast<double>(number);
        const PointCloud cloud = read_candidate(number);
        SurfaceError error;
        {
            const Stopwatch watch(run_.cost().error_seconds);
            error = meter.measure(cloud,
                                  run_.in_stage(kEvaluate).part(before / all, (before + 1) / all));
        }
        Candidate candidate;
        candidate.level = {.level = static_cast<unsigned>(number),
                           .points = cloud.size(),
                           .spacing = mean_spacing(cloud.positions, run_.quietly()),
                           .bounds = bounds(cloud),
                           .files = {},
                           .attributes = attributes_of(cloud)};
        candidate.samples.p99 = error.forward.p99;
        candidate.samples.max = error.forward.max;
        candidate.samples.positions = std::move(error.forward.positions);
        candidate.samples.distances = std::move(error.forward.distances);
        candidate.level.error = error_figures(error, options, reference_points, cloud.size());
        return candidate;
    }

    /// What 99 % of all distances do not exceed; where they are but what rounding makes of 0, all.
    static double most_of(const std::vector<Candidate>& candidates) {
        constexpr double kRounding = 1e-6;  // of the diagonal
        double p99 = 0, max = 0;
        for (const Candidate& candidate : candidates) {
            p99 = std::max(p99, candidate.samples.p99);
            max = std::max(max, candidate.samples.max);
        }
        return p99 > kRounding * candidates.front().level.error->error.diagonal ? p99 : max;
    }

    /// Maps and pictures of all candidates, in the same colours.
    void show(std::vector<Candidate>& candidates, const Vec3d& origin) {
        const Stopwatch watch(run_.cost().encode_seconds);
        const double range = job_.options.range.value_or(round_up(most_of(candidates)));
        std::vector<PointCloud> maps;
        for (Candidate& candidate : candidates) {
            candidate.level.error->range = range;
            maps.push_back(colored_by_distance(candidate.samples, origin, range));
            candidate.level.attributes = attributes_of(maps.back());
            candidate.level.origin = maps.back().origin;
            candidate.samples = {};
            for (const CloudFormat format : job_.output.formats) {
                LodLevel map{candidate.level.level, maps.back(), 0};
                candidate.level.files.push_back(write_level(map, format, job_.output.draco,
                                                            run_.in_stage(kEncode), run_.spec()));
            }
        }
        if (job_.options.pictures) candidates.front().level.pictures = {draw(candidates, maps)};
        run_.advance(kEncode, 1);
    }

    PictureFile draw(const std::vector<Candidate>& candidates,
                     const std::vector<PointCloud>& maps) {
        const SurfaceError& first = candidates.front().level.error->error;
        const double range = *candidates.front().level.error->range;
        VisualErrorOptions options{.range = range,
                                   .legend = distance_legend(range, first),
                                   .views = job_.options.views,
                                   .up = job_.options.up};
        std::vector<VisualError> shown;
        for (std::size_t i = 0; i < maps.size(); ++i) {
            const OutputCloud& level = candidates[i].level;
            const std::string label = job_.options.labels.empty()
                                          ? "candidate " + std::to_string(i + 1)
                                          : job_.options.labels[i];
            shown.push_back({label, error_notes(level.points, level.error->error), &maps[i]});
        }
        const Picture picture = draw_visual_error(shown, options, run_.in_stage(kEncode));
        const std::string name = "picture.png";
        write_whole_file(fs::path(run_.spec().output_dir) / name, picture.png, run_.spec());
        return {picture.width, picture.height, picture.png.size(), sha256_hex(picture.png), name};
    }

    JobRun& run_;
    const EvaluateJob& job_;
};

}  // namespace

void evaluate(JobRun& run, const PointCloud& reference, const EvaluateJob& job) {
    EvaluationRun(run, job).run(reference);
}

}  // namespace stipple::proto
