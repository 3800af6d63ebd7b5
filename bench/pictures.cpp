// stipple-pictures: the pictures of the README files, in the manner of the paper's Figures 1, 3, 5,
// 7, 10, 11 and 12.

#include "program.hpp"
#include "sheet.hpp"
#include "stipple/cleaning.hpp"
#include "stipple/codec.hpp"
#include "stipple/hierarchical_clustering.hpp"
#include "stipple/incremental_clustering.hpp"
#include "stipple/iterative_simplification.hpp"
#include "stipple/local_analysis.hpp"
#include "stipple/normal_orientation.hpp"
#include "stipple/particle_simulation.hpp"
#include "stipple/proto/thousands.hpp"
#include "stipple/simplify.hpp"
#include "stipple/splat_renderer.hpp"
#include "stipple/splats.hpp"
#include "stipple/surface_error.hpp"
#include "stipple/synthetic_scan.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <iostream>
#include <map>
#include <string>
#include <vector>

namespace stipple::bench {

namespace {

struct PictureOptions {
    std::filesystem::path model;      // a cloud file; empty: the synthetic scan
    std::filesystem::path out = ".";  // a folder
    std::string filter;               // pictures whose names hold this
    std::string format = "webp";      // or png
    std::size_t points = 3000;        // of what is simplified
};

std::string points_of(const PointCloud& cloud) {
    return proto::with_separators(cloud.size()) + " points";
}

/// A model and the camera that all its pictures are taken with.
class Studio {
public:
    Studio(PointCloud cloud, unsigned height) : cloud_(std::move(cloud)), height_(height) {
        if (cloud_.normals.empty()) {
            cloud_.normals = analyze_locally(cloud_.positions).normals;
            orient_normals(cloud_.positions, cloud_.normals);
        }
        // As wide as the model is, but wide enough for words below.
        const ViewOptions view{.margin = 0.01};
        constexpr double kNarrowest = 0.65, kWidest = 1.4;
        for (double aspect = kNarrowest; aspect <= kWidest; aspect += 0.05) {
            const Camera wider = fit_camera(cloud_.positions, view, aspect);
            if (aspect > kNarrowest && distance(wider) > 0.99 * distance(camera_)) break;
            camera_ = wider;
            width_ = static_cast<unsigned>(aspect * height_);
        }
    }

    const PointCloud& cloud() const { return cloud_; }

    /// The surface that the points describe; without normals both of its sides are shown.
    Image surface(const PointCloud& cloud, std::span<const Rgba8> colors = {}) const {
        return picture(cloud, colors, {.style = SplatStyle::Smooth, .radius_scale = 1.5});
    }
    /// Values of a surface in colour, with little shade in them.
    Image values(const PointCloud& cloud, std::span<const float> values, double high) const {
        std::vector<Rgba8> colors;
        for (const float v : values) colors.push_back(viridis(v / high));
        return picture(cloud, colors,
                       {.style = SplatStyle::Smooth, .radius_scale = 1.5, .relief = 0.5});
    }
    /// The points themselves, each a disc that meets the next. Needs normals.
    Image discs(const PointCloud& cloud, std::span<const Rgba8> colors = {}) const {
        return picture(cloud, colors, {.style = SplatStyle::Discs, .radius_scale = 1.05});
    }

private:
    Image picture(const PointCloud& cloud, std::span<const Rgba8> colors,
                  SplatRenderOptions options) const {
        Splats splats = measure_splats(cloud.positions, {.normals = true});
        // Which side is out is better known of the original, whose normals come along.
        for (std::size_t i = 0; i < cloud.normals.size(); ++i)
            if (splats.normals[i].dot(cloud.normals[i]) < 0) splats.normals[i] *= -1;
        options.cull_back_faces = !cloud.normals.empty();
        options.width = width_;
        options.height = height_;
        return render_splats(cloud.positions, splats, colors, camera_, options);
    }

    double distance(const Camera& camera) const {
        return (camera.eye - cloud_.positions.front().cast<double>()).norm();
    }

    PointCloud cloud_;
    unsigned width_ = 0, height_;
    Camera camera_;
};

/// A picture is a sheet under a name.
using Draw = std::unique_ptr<Sheet> (*)(const Studio&, const PictureOptions&);

SimplifyOptions by(Method method, std::size_t points) {
    return {.method = method, .points = points};
}

/// Every method at the same count (Fig. 5, 6 and 7).
std::unique_ptr<Sheet> methods(const Studio& studio, const PictureOptions& options) {
    std::vector<Tile> tiles = {
        {studio.surface(studio.cloud()), "original", points_of(studio.cloud())}};
    for (const Method method : kMethods) {
        const PointCloud small = simplify(studio.cloud(), by(method, options.points));
        tiles.push_back({studio.discs(small), std::string(to_string(method)), points_of(small)});
    }
    return tiled(tiles, 4);
}

/// One run of contractions, stopped again and again (Fig. 1).
std::unique_ptr<Sheet> levels(const Studio& studio, const PictureOptions&) {
    std::vector<std::uint64_t> sizes;
    for (std::uint64_t size = 32'000; size >= 2'000; size /= 4)
        if (size < studio.cloud().size()) sizes.push_back(size);
    std::vector<Tile> tiles = {{studio.surface(studio.cloud()), points_of(studio.cloud())}};
    iterative_snapshots(studio.cloud(), sizes, {}, [&](PointCloud&& level) {
        tiles.push_back({studio.surface(level), points_of(level)});
    });
    std::ranges::reverse(tiles);
    return tiled(tiles, static_cast<unsigned>(tiles.size()));
}

/// Colours that differ from one number to the next.
Rgba8 color_of(std::size_t i) {
    const double hue = 6 * std::fmod(0.61803398875 * static_cast<double>(i), 1.0);
    const auto channel = [&](double shift) {
        const double distance = std::abs(std::fmod(hue + shift, 6.0) - 3);
        return static_cast<std::uint8_t>(110 + 120 * std::clamp(distance - 1, 0.0, 1.0));
    };
    return {channel(0), channel(4), channel(2), 255};
}

std::vector<Rgba8> cluster_colors(const Clusters& clusters, std::size_t points) {
    std::vector<Rgba8> colors(points);
    for (std::size_t c = 0; c < clusters.size(); ++c)
        for (const Index i : clusters.of(c)) colors[i] = color_of(c);
    return colors;
}

/// Clusters on the original, and what stands for them (Fig. 5).
std::unique_ptr<Sheet> clusters(const Studio& studio, const PictureOptions& options) {
    const PointCloud& cloud = studio.cloud();
    const std::size_t count = options.points / 3;
    const Clusters grown = incremental_clusters(cloud.positions, {.target_size = count});
    const Clusters split = hierarchical_clusters(cloud.positions, {.target_size = count});
    std::vector<Tile> tiles;
    const auto add = [&](const Clusters& all, const std::string& name) {
        const PointCloud small = representatives(cloud, all, Representative::Nearest);
        tiles.push_back({studio.surface(cloud, cluster_colors(all, cloud.size())), name,
                         proto::with_separators(all.size()) + " clusters"});
        tiles.push_back({studio.discs(small), name, points_of(small)});
    };
    add(grown, "region growing");
    add(split, "hierarchical");
    return tiled(tiles, 4);
}

/// Surface variation at several scales (Fig. 3).
std::unique_ptr<Sheet> variation(const Studio& studio, const PictureOptions&) {
    constexpr double kHigh = 0.03;
    const PointCloud& cloud = studio.cloud();
    std::vector<Tile> tiles = {{studio.surface(cloud), "surface", points_of(cloud)}};
    for (const unsigned k : {12U, 24U, 64U}) {
        const auto values = analyze_locally(cloud.positions, {.k = k}).variation;
        tiles.push_back(
            {studio.values(cloud, values, kHigh), "n = " + std::to_string(k) + " neighbours"});
    }
    const Legend legend{.title = "surface variation σₙ", .low = 0, .high = kHigh};
    return tiled(tiles, 4, &legend);
}

/// Where simplification moved the surface (Fig. 10).
std::unique_ptr<Sheet> error(const Studio& studio, const PictureOptions& options) {
    constexpr double kHigh = 25;  // 10^-4 of the diagonal
    const PointCloud& cloud = studio.cloud();
    std::vector<Tile> tiles;
    for (const Method method :
         {Method::Incremental, Method::Hierarchical, Method::Iterative, Method::Particles}) {
        const PointCloud small = simplify(cloud, by(method, options.points));
        const SurfaceError found =
            measure_error(cloud, small, {.samples = cloud.size(), .keep_samples = true});
        PointCloud samples;
        samples.positions = found.forward.positions;
        char note[80];
        std::snprintf(note, sizeof note, "mean %.1f, max %.0f", 1e4 * found.mean() / found.diagonal,
                      1e4 * found.max() / found.diagonal);
        tiles.push_back(
            {studio.values(samples, found.forward.distances, kHigh * 1e-4 * found.diagonal),
             std::string(to_string(method)) + ", " + proto::with_separators(small.size()), note});
    }
    const Legend legend{.title = "distance to the simplified surface, 10⁻⁴ of the diagonal",
                        .low = 0,
                        .high = kHigh};
    return tiled(tiles, 4, &legend);
}

/// Particles: even, by variation, in a region of chosen density, and more than there were (Fig. 7,
/// 11 and 12).
std::unique_ptr<Sheet> particles(const Studio& studio, const PictureOptions& options) {
    const PointCloud& cloud = studio.cloud();
    const ParticleSimulationOptions even{.target_size = options.points};
    ParticleSimulationOptions adaptive = even;
    adaptive.adaptivity = 1;
    ParticleSimulationOptions region = even;
    const Aabb box = bounds(cloud);
    const Vec3d middle = 0.5 * (box.min + box.max) - cloud.origin;
    const Vec3d center(middle.x(), middle.y() + 0.1 * box.diagonal(),
                       box.max.z() - cloud.origin.z());
    region.regions = {
        {.where = DensityRegion::Sphere{center, 0.12 * box.diagonal()}, .density = 8}};
    std::vector<Tile> tiles;
    const auto add = [&](const ParticleSimulationOptions& how, const std::string& name) {
        const PointCloud small = particle_simulation(cloud, how);
        tiles.push_back({studio.discs(small), name, points_of(small)});
    };
    add(even, "uniform");
    add(adaptive, "adaptive, by 1 / σₙ");
    add(region, "denser in a region");
    const PointCloud small = particle_simulation(cloud, even);
    const PointCloud dense = upsample(small, {.points = 30 * options.points});
    tiles.push_back({studio.surface(dense),
                     "upsampled from " + proto::with_separators(small.size()), points_of(dense)});
    return tiled(tiles, 4);
}

const std::map<std::string, Draw>& all_pictures() {
    static const std::map<std::string, Draw> pictures = {
        {"methods", methods}, {"levels", levels},       {"clusters", clusters},
        {"error", error},     {"variation", variation}, {"particles", particles}};
    return pictures;
}

int run(const PictureOptions& options) {
    PointCloud cloud = options.model.empty() ? synthetic_scan({.points = 400'000, .noise = 0.02})
                                             : read_cloud(options.model);
    clean(cloud);
    const Studio studio(std::move(cloud), 330);
    for (const auto& [name, draw] : all_pictures()) {
        if (name.find(options.filter) == std::string::npos) continue;
        const auto file = options.out / (name + '.' + options.format);
        save(*draw(studio, options), file);
        std::cout << file.string() << std::endl;
    }
    return 0;
}

}  // namespace

}  // namespace stipple::bench

int main(int argc, char** argv) {
    using namespace stipple::bench;
    PictureOptions options;
    CLI::App app("The pictures of the README files.", "stipple-pictures");
    app.add_option("--model", options.model, "a cloud, y up; else the synthetic scan")
        ->type_name("FILE");
    app.add_option("--points", options.points, "of what is simplified")
        ->check(at_least(1))
        ->capture_default_str();
    app.add_option("--filter", options.filter,
                   "only pictures whose name holds TEXT: clusters, error, levels, methods, "
                   "particles, variation")
        ->type_name("TEXT");
    app.add_option("--format", options.format, "of the files")
        ->check(CLI::IsMember({"webp", "png"}))
        ->capture_default_str();
    app.add_option("--out", options.out, "folder for them")
        ->type_name("DIR")
        ->capture_default_str();
    return run_program(app, argc, argv, [&] { return run(options); });
}
