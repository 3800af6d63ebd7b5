// stipple-bound-check: whether results within an error bound stay within it when they are measured
// again, by places that the search has not seen and by a measure that shares no code with it.

#include "models.hpp"
#include "stipple/cleaning.hpp"
#include "stipple/error.hpp"
#include "stipple/error_bounded.hpp"
#include "surface_distance.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <iostream>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace stipple::bench {

namespace {

constexpr const char* kUsage = R"(stipple-bound-check [options] MODEL...
  MODEL          a PLY file, or 1k, 250k, 2M...: a bumpy sphere of so many points
  --bound R,S    parts of the diagonal of the box (0.002)
  --methods A,B  multiphase,hierarchical,iterative,particles
  --seeds N      runs of each method and bound: another rotation of the model, other seeds (1)
  --first N      the seed of a model's first run; those of the others follow (0)
  --again N      measurements of each result, at other places each (1)
  --promise      measures only what is promised, without the independent measure: twice as fast
  --threads N    (all)
)";

struct CheckOptions {
    std::vector<std::string> models;
    std::vector<Method> methods{kErrorBoundedMethods.begin(), kErrorBoundedMethods.end()};
    std::vector<double> bounds{0.002};
    std::uint64_t seeds = 1, first = 0, again = 1;
    unsigned threads = 0;
    bool only_promise = false;
};

/// What stands between commas.
std::vector<std::string> parts_of(const std::string& list) {
    std::vector<std::string> parts;
    for (std::size_t at = 0; at <= list.size();) {
        const std::size_t comma = std::min(list.find(',', at), list.size());
        parts.push_back(list.substr(at, comma - at));
        at = comma + 1;
    }
    return parts;
}

CheckOptions parse(const std::vector<std::string>& arguments) {
    CheckOptions options;
    for (std::size_t i = 0; i < arguments.size(); ++i) {
        const std::string& option = arguments[i];
        if (!option.starts_with("--")) {
            options.models.push_back(option);
            continue;
        }
        if (option == "--promise") {
            options.only_promise = true;
            continue;
        }
        if (i + 1 == arguments.size()) throw std::invalid_argument(option + ": a value is missing");
        const std::string& value = arguments[++i];
        if (option == "--bound") {
            options.bounds.clear();
            for (const std::string& bound : parts_of(value))
                options.bounds.push_back(std::stod(bound));
        } else if (option == "--seeds") {
            options.seeds = std::stoul(value);
        } else if (option == "--first") {
            options.first = std::stoul(value);
        } else if (option == "--again") {
            options.again = std::stoul(value);
        } else if (option == "--threads") {
            options.threads = static_cast<unsigned>(std::stoul(value));
        } else if (option == "--methods") {
            options.methods.clear();
            for (const std::string& method : parts_of(value))
                options.methods.push_back(method_from_name(method));
        } else {
            throw std::invalid_argument(option + ": unknown");
        }
    }
    if (options.models.empty()) throw std::invalid_argument("no model");
    return options;
}

PointCloud load(const std::string& name) {
    if (!std::filesystem::exists(name)) return Models({}).get(name).cloud;
    PointCloud cloud;
    const TriangleMesh mesh = read_triangles(name);
    cloud.origin = mesh.vertices.empty() ? Vec3d::Zero() : mesh.vertices.front();
    for (const Vec3d& p : mesh.vertices)
        cloud.positions.push_back((p - cloud.origin).cast<float>());
    clean(cloud);
    return cloud;
}

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
    double points = 0;       ///< and at points that are within the bound of their own surface
    double independent = 0;  ///< the measure of surface_distance.hpp
    double certain = 0;      ///< of that what is certain
};

/// From the points that are within the bound of their own surface: those that are not are noise.
double max_at_points(const PointCloud& cloud, const ErrorBoundedCloud& found,
                     const RunContext& context) {
    const SurfaceErrorOptions options{
        .sampling = ErrorSampling::Points, .samples = cloud.size(), .keep_samples = true};
    const DirectedError own = measure_error(cloud, cloud, options, context).forward;
    const DirectedError error = measure_error(cloud, found.cloud, options, context).forward;
    double max = 0;
    for (std::size_t i = 0; i < own.distances.size(); ++i)
        if (own.distances[i] <= found.bound)
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

int run(const std::vector<std::string>& arguments) {
    try {
        const CheckOptions options = parse(arguments);
        std::printf(
            "| model | method | bound | seeds | points | kept | whole | random | points | "
            "independent | certain | broken | s "
            "|\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
        for (const std::string& model : options.models) {
            const PointCloud cloud = load(model);
            const std::string name = std::filesystem::path(model).stem().string();
            std::uint64_t seed = options.first;
            for (const Method method : options.methods)
                for (const double bound : options.bounds) {
                    check(name, cloud, method, bound, seed, options);
                    seed += options.seeds;
                }
        }
        return 0;
    } catch (const std::invalid_argument& error) {
        std::cerr << "stipple-bound-check: " << error.what() << '\n' << kUsage;
        return 2;
    } catch (const std::exception& error) {
        std::cerr << "stipple-bound-check: " << error.what() << '\n';
        return 1;
    }
}

}  // namespace

}  // namespace stipple::bench

int main(int argc, char** argv) {
    return stipple::bench::run({argv + 1, argv + argc});
}
