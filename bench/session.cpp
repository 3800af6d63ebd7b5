#include "cases.hpp"
#include "peers.hpp"
#include "report.hpp"

#include <algorithm>
#include <iostream>
#include <string_view>
#include <utility>

namespace stipple::bench {

namespace {

std::uint64_t hash_of(const PointCloud& cloud) {
    const std::string_view bytes(reinterpret_cast<const char*>(cloud.positions.data()),
                                 cloud.positions.size() * sizeof(Vec3f));
    return std::hash<std::string_view>{}(bytes);
}

std::vector<Figure> figures_of(const SurfaceDistance& error) {
    std::vector<Figure> figures = {{"Δmax", 1e4 * error.max},
                                   {"Δavg", 1e4 * error.mean},
                                   {"p99", 1e4 * error.p99},
                                   {"Δavg quad", 1e4 * error.mean_quadratic},
                                   {"Δavg points", 1e4 * error.mean_points},
                                   {"P'→S", 1e4 * error.back_mean},
                                   {"CV", error.spacing_variation, 3}};
    if (error.surface_to_mesh) figures.push_back({"S'→mesh", 1e4 * *error.surface_to_mesh});
    if (error.points_to_mesh) figures.push_back({"P'→mesh", 1e4 * *error.points_to_mesh});
    return figures;
}

}  // namespace

bool Session::invited(const std::string& contestant) const {
    return contestant.find(options_.contestants) != std::string::npos;
}

void Session::contest(CaseResult head, std::vector<Contestant> contestants) {
    std::erase_if(contestants, [this](const Contestant& c) { return !invited(c.name); });
    if (contestants.empty()) return;
    head.standings = hold_contest(contestants, options_.repeat);
    print(std::cout, head);
    results_.push_back(std::move(head));
}

const SurfaceMeter& Session::meter(const Model& model) {
    auto& meter = meters_[model.name];
    if (!meter)
        meter = std::make_unique<SurfaceMeter>(model.cloud, model.mesh,
                                               SurfaceDistanceOptions{.samples = options_.samples});
    return *meter;
}

std::vector<Figure> Session::error_figures(const Model& model, const PointCloud& simplified) {
    std::vector<Figure> figures = {{"points", static_cast<double>(simplified.size()), 0}};
    if (options_.samples == 0) return figures;
    const std::string key = model.name + ' ' + std::to_string(hash_of(simplified));
    if (!errors_.contains(key)) errors_[key] = meter(model).measure(simplified);
    std::ranges::copy(figures_of(errors_[key]), std::back_inserter(figures));
    return figures;
}

unsigned Session::tuned_cgal_size(const Model& model, std::uint64_t target) {
    unsigned& tuned = cgal_sizes_[model.name + ' ' + std::to_string(target)];
    if (tuned != 0) return tuned;
    const auto count = [&](unsigned size) {
        std::any points = cgal_points(model.cloud);
        return static_cast<std::int64_t>(cgal_hierarchy(points, size));
    };
    const auto wanted = static_cast<std::int64_t>(target);
    // The count falls as the size grows: `low` gives at least the target, `high` fewer.
    unsigned low = 1, high = static_cast<unsigned>(2 * model.cloud.size() / target + 2);
    while (count(high) >= wanted) low = std::exchange(high, 2 * high);
    while (high - low > 1) {
        const unsigned middle = low + (high - low) / 2;
        (count(middle) >= wanted ? low : high) = middle;
    }
    tuned = std::abs(count(low) - wanted) <= std::abs(count(high) - wanted) ? low : high;
    return tuned;
}

}  // namespace stipple::bench
