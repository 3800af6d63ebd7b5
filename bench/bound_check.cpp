// stipple-bound-check: whether results within an error bound stay within it when they are measured
// again, by places that the search has not seen and by a measure that shares no code with it.

#include "models.hpp"
#include "program.hpp"
#include "stipple/error.hpp"
#include "stipple/error_bounded.hpp"
#include "surface_distance.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <random>
#include <string>
#include <vector>

namespace stipple::bench {

namespace {

struct CheckOptions {
    std::vector<std::string> models;
    std::vector<std::string> methods{"multiphase", "hierarchical", "iterative", "particles"};
    std::vector<double> bounds{0.002};
    std::uint64_t seeds = 1, first = 0, again = 1;
    unsigned threads = 0;
    bool only_promise = false;
};

/// Turned at random, which moves every tree, grid and tie; seed 0 leaves it as it is.
PointCloud turned(PointCloud cloud, std::uint64_t seed) {
    if (seed == 0) return cloud;
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    Eigen::Quaterniond turn(normal(random), normal(random), normal(random), normal(random));
    turn.normalize();
    for (Vec3f& p : cloud.positions) p = (turn * p.cast<double>()).cast<float>();
    return cloud;
}

/// What is left of a promise: each the largest over all measurements, over the bound.
struct Outcome {
    double random = 0;       ///< `measure_error`, four times as many random places as before
    double points = 0;       ///< and at points that are safely within it of their own surface
    double independent = 0;  ///< the measure of surface_distance.hpp
    double certain = 0;      ///< of that what is certain
};

/// From the points that are safely within the bound of their own surface: those that are not are
/// noise.
double max_at_points(const PointCloud& cloud, const ErrorBoundedCloud& found,
                     const RunContext& context) {
    const SurfaceErrorOptions options{
        .sampling = ErrorSampling::Points, .samples = cloud.size(), .keep_samples = true};
    const DirectedError own = measure_error(cloud, cloud, options, context).forward;
    const DirectedError error = measure_error(cloud, found.cloud, options, context).forward;
    constexpr double kSafe = 0.95;
    double max = 0;
    for (std::size_t i = 0; i < own.distances.size(); ++i)
        if (own.distances[i] <= kSafe * found.bound)
            max = std::max(max, static_cast<double>(error.distances[i]));
    return max;
}

Outcome measure_again(const PointCloud& cloud, const ErrorBoundedCloud& found, std::uint64_t seed,
                      const CheckOptions& options) {
    const RunContext context{.stop = {}, .progress = {}, .threads = options.threads};
    Outcome outcome;
    for (std::uint64_t i = 0; i < options.again; ++i) {
        SurfaceErrorOptions measure;
        measure.seed = 1'000'000 + 1'000 * seed + i;
        measure.samples =
            found.whole ? 4 * cloud.size() : 4 * found.error.forward.samples;  // of each surface
        measure.sampling = ErrorSampling::Surface;
        const double random = measure_error(cloud, found.cloud, measure, context).max();
        const double points = max_at_points(cloud, found, context);
        outcome.random = std::max(outcome.random, random / found.bound);
        outcome.points = std::max(outcome.points, points / found.bound);
        if (options.only_promise) continue;
        const SurfaceMeter meter(
            cloud, {}, {.samples = 400'000, .seed = measure.seed, .threads = options.threads});
        const SurfaceDistance independent = meter.measure(found.cloud);
        const double in_bounds = bounds(cloud).diagonal() / found.bound;
        outcome.independent = std::max(outcome.independent, independent.max * in_bounds);
        outcome.certain = std::max(outcome.certain, independent.max_certain * in_bounds);
    }
    return outcome;
}

/// Runs one method within one bound; the broken are named, to be looked into.
void check(const std::string& name, const PointCloud& original, Method method, double bound,
           std::uint64_t first, const CheckOptions& options) {
    Outcome worst;
    std::size_t fewest = original.size(), most = 0, whole = 0, broken = 0;
    double seconds = 0;
    for (std::uint64_t seed = first; seed < first + options.seeds; ++seed) {
        const PointCloud cloud = turned(original, seed);
        SimplifyOptions simplification;
        simplification.method = method;
        simplification.max_error_rel = bound;
        simplification.seed = seed;
        const auto start = std::chrono::steady_clock::now();
        const ErrorBoundedCloud found = simplify_within_error(
            cloud, simplification, {.stop = {}, .progress = {}, .threads = options.threads});
        seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        const Outcome outcome = measure_again(cloud, found, seed, options);
        constexpr double kPromise = 1.02;
        if (std::max(outcome.random, outcome.points) > kPromise) {
            ++broken;
            std::fprintf(stderr, "broken: %s --methods %s --bound %g --first %zu: %.3f, %.3f\n",
                         name.c_str(), std::string(to_string(method)).c_str(), bound,
                         static_cast<std::size_t>(seed), outcome.random, outcome.points);
        }
        worst.random = std::max(worst.random, outcome.random);
        worst.points = std::max(worst.points, outcome.points);
        worst.independent = std::max(worst.independent, outcome.independent);
        worst.certain = std::max(worst.certain, outcome.certain);
        fewest = std::min(fewest, found.cloud.size());
        most = std::max(most, found.cloud.size());
        whole += found.whole ? 1 : 0;
    }
    std::printf(
        "| %s | %s | %g | %zu | %zu | %zu..%zu | %zu | %.3f | %.3f | %.3f | %.3f | %zu | %.1f |\n",
        name.c_str(), std::string(to_string(method)).c_str(), bound,
        static_cast<std::size_t>(options.seeds), original.size(), fewest, most, whole, worst.random,
        worst.points, worst.independent, worst.certain, broken,
        seconds / static_cast<double>(options.seeds));
    std::fflush(stdout);
}

int run(const CheckOptions& options) {
    std::printf(
        "| model | method | bound | seeds | points | kept | whole | random | points | "
        "independent | certain | broken | s "
        "|\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
    Models models({});
    for (const std::string& model : options.models) {
        const PointCloud& cloud = models.get(model).cloud;
        const std::string name = std::filesystem::path(model).stem().string();
        std::uint64_t seed = options.first;
        for (const std::string& method : options.methods)
            for (const double bound : options.bounds) {
                check(name, cloud, method_from_name(method), bound, seed, options);
                seed += options.seeds;
            }
    }
    return 0;
}

}  // namespace

}  // namespace stipple::bench

int main(int argc, char** argv) {
    using namespace stipple::bench;
    CheckOptions options;
    CLI::App app("Whether results within an error bound stay within it when measured again.",
                 "stipple-bound-check");
    app.add_option("MODEL", options.models,
                   "a PLY file, or 1k, 250k, 2M...: a bumpy sphere of so many points")
        ->required();
    app.add_option("--bound", options.bounds, "parts of the diagonal of the box")
        ->delimiter(',')
        ->allow_extra_args(false)
        ->capture_default_str();
    app.add_option("--methods", options.methods, "those that keep to a bound")
        ->delimiter(',')
        ->allow_extra_args(false)
        ->capture_default_str();
    app.add_option("--seeds", options.seeds,
                   "runs of each method and bound: another rotation of the model, other seeds")
        ->check(at_least(1))
        ->capture_default_str();
    app.add_option("--first", options.first,
                   "the seed of a model's first run; those of the others follow")
        ->check(at_least(0))
        ->capture_default_str();
    app.add_option("--again", options.again, "measurements of each result, at other places each")
        ->check(at_least(0))
        ->capture_default_str();
    app.add_flag("--promise", options.only_promise,
                 "measures only what is promised, without the independent measure: twice as fast");
    app.add_option("--threads", options.threads, "0: all")->check(at_least(0));
    return run_program(app, argc, argv, [&] { return run(options); });
}
