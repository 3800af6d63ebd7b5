#include "cases.hpp"
#include "report.hpp"
#include "stipple/proto/thousands.hpp"

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
                                   {"CV", error.spacing_variation, 3},
                                   {"min/mean", error.least_spacing, 2}};
    if (error.surface_to_mesh) figures.push_back({"S'→mesh", 1e4 * *error.surface_to_mesh});
    if (error.points_to_mesh) figures.push_back({"P'→mesh", 1e4 * *error.points_to_mesh});
    return figures;
}

}  // namespace

bool Session::invited(const std::string& contestant) const {
    const std::vector<std::string>& parts = options_.contestants;
    return parts.empty() || holds_any(contestant, parts);
}

void Session::contest(CaseResult head, std::vector<Contestant> contestants) {
    std::erase_if(contestants, [this](const Contestant& c) { return !invited(c.name); });
    if (contestants.empty()) return;
    head.standings = hold_contest(contestants, options_.repeat, options_.patience_s);
    print(std::cout, head);
    results_.push_back(std::move(head));
}

const SurfaceMeter& Session::meter(const Model& model) {
    auto& meter = meters_[model.name];
    if (!meter)
        meter = std::make_unique<SurfaceMeter>(
            model.cloud, model.mesh,
            SurfaceDistanceOptions{.samples = options_.samples, .foot = model.foot});
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

Contestant contestant(const Peer& peer, unsigned threads) {
    const auto loaded = std::make_shared<std::any>();
    return {.name = peer.name,
            .run = [=, run = peer.run] { return run(*loaded, threads); },
            .prepare = [=, load = peer.load] { *loaded = load(); },
            .release = [=] { loaded->reset(); }};
}

std::string described(const Model& model) {
    const std::string name = std::filesystem::path(model.name).stem().string();
    return name + (model.synthetic() ? " (synthetic)" : "") + ": " +
           proto::with_separators(model.cloud.size()) + " points";
}

bool holds_any(const std::string& name, const std::vector<std::string>& parts) {
    return std::ranges::any_of(
        parts, [&](const std::string& part) { return name.find(part) != std::string::npos; });
}

RunContext on_threads(unsigned threads) {
    RunContext context;
    context.threads = threads;
    return context;
}

}  // namespace stipple::bench
