#include "stipple/picture/visual_error.hpp"

#include "stipple/error.hpp"
#include "stipple/picture/sheet.hpp"
#include "stipple/splats.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace stipple {

namespace {

constexpr double kGap = 16, kLabel = 15, kNote = 12, kLine = 17, kLegendHeight = 72;  // pixels
constexpr double kAbove = 0.24, kAside = 0.3;  // from where views look, radians

/// The axes of a model: where its top, its front and its right side are.
struct Axes {
    Vec3d up, front, right;

    explicit Axes(char name) {
        up = name == 'x' ? Vec3d::UnitX() : name == 'y' ? Vec3d::UnitY() : Vec3d::UnitZ();
        front = name == 'z' ? Vec3d(-Vec3d::UnitY()) : Vec3d::UnitZ();
        right = up.cross(front);
    }
};

ViewOptions view_of(const std::string& name, char up) {
    const Axes axes(up);
    ViewOptions view{.margin = 0.01};
    view.up = axes.up;
    if (name == "top" || name == "bottom") {
        view.toward_eye = name == "top" ? axes.up : Vec3d(-axes.up);
        view.up = name == "top" ? Vec3d(-axes.front) : axes.front;
        return view;
    }
    constexpr std::array kAround = {"front", "right", "back", "left"};
    const auto* const found = std::ranges::find(kAround, name);
    if (found == kAround.end())
        throw Error(ErrorCode::InvalidArgument,
                    "view " + name + ": expected front, right, back, left, top or bottom");
    const double angle =
        0.5 * std::numbers::pi * static_cast<double>(found - kAround.begin()) + kAside;
    const Vec3d level = std::cos(angle) * axes.front + std::sin(angle) * axes.right;
    view.toward_eye = std::cos(kAbove) * level + std::sin(kAbove) * axes.up;
    return view;
}

/// Width over height of what is seen, so that pictures have no idle margins.
double aspect_of(std::span<const Vec3f> points, const ViewOptions& view,
                 const RunContext& context) {
    const Camera camera = fit_camera(points, view, 1.0, context);
    const Eigen::Vector2d size = picture_bounds(points, camera, context).sizes();
    return size.y() > 0 ? size.x() / size.y() : 1.0;
}

/// Where things are on the sheet.
struct Layout {
    unsigned columns = 1, rows = 1;
    double tile_width = 0, tile_height = 0;
    double head = 0;  ///< above the pictures
    bool is_compared = false;

    double width() const { return columns * (tile_width + kGap) + kGap; }
    double row_height() const { return tile_height + kLine + kGap; }
    double height() const { return kGap + head + rows * row_height() + kLegendHeight; }
    double left(std::size_t column) const {
        return kGap + static_cast<double>(column) * (tile_width + kGap);
    }
    double top(std::size_t row) const {
        return kGap + head + static_cast<double>(row) * row_height();
    }
};

Layout lay_out(std::span<const VisualError> candidates, const VisualErrorOptions& options,
               double aspect) {
    constexpr std::size_t kMostColumns = 4;
    const std::size_t views = options.views.size();
    Layout layout;
    layout.is_compared = candidates.size() > 1;
    const std::size_t columns = layout.is_compared      ? candidates.size()
                                : views <= kMostColumns ? views
                                                        : (views + 1) / 2;
    layout.columns = static_cast<unsigned>(columns);
    layout.rows =
        static_cast<unsigned>(layout.is_compared ? views : (views + columns - 1) / columns);
    layout.tile_height = options.height;
    layout.tile_width = std::round(std::clamp(aspect, 0.6, 1.8) * options.height);
    std::size_t notes = 0;
    for (const VisualError& candidate : candidates) notes = std::max(notes, candidate.notes.size());
    layout.head = kLine * static_cast<double>(1 + notes) + 8;
    return layout;
}

void write_head(Sheet& sheet, const VisualError& candidate, double x, double y, double width) {
    double baseline = y + kLabel;
    sheet.text(candidate.label, x, baseline, kLabel, Align::Center, true, width);
    for (const std::string& note : candidate.notes)
        sheet.text(note, x, baseline += kLine, kNote, Align::Center, false, width);
}

}  // namespace

double round_up(double value) noexcept {
    if (!(value > 0) || !std::isfinite(value)) return 1;
    const double unit = std::pow(10.0, std::floor(std::log10(value)));
    constexpr double kRounding = 1e-9;
    for (const double step : {1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0})
        if (step * unit >= value * (1 - kRounding)) return step * unit;
    return 10 * unit;
}

PointCloud colored_by_distance(const DirectedError& error, const Vec3d& origin, double range) {
    PointCloud cloud;
    cloud.origin = origin;
    cloud.positions = error.positions;
    cloud.colors.reserve(error.distances.size());
    for (const float d : error.distances)
        cloud.colors.push_back(viridis(static_cast<double>(d) / range));
    cloud.attributes.push_back({"distance", error.distances, 1, Reduction::Mean});
    return cloud;
}

Picture draw_visual_error(std::span<const VisualError> candidates,
                          const VisualErrorOptions& options, const RunContext& context) {
    if (candidates.empty() || options.views.empty())
        throw Error(ErrorCode::InvalidArgument, "picture: expected a candidate and a view");
    const RunContext quiet{context.stop, {}, context.threads};
    const std::span<const Vec3f> first = candidates.front().samples->positions;
    double aspect = 0;
    for (const std::string& name : options.views)
        aspect = std::max(aspect, aspect_of(first, view_of(name, options.up), quiet));
    const Layout layout = lay_out(candidates, options, aspect);
    std::vector<Camera> cameras;  // of all candidates the same, so that pictures can be compared
    for (const std::string& name : options.views)
        cameras.push_back(fit_camera(first, view_of(name, options.up),
                                     layout.tile_width / layout.tile_height, quiet));
    const SplatRenderOptions rendering{.width = static_cast<unsigned>(layout.tile_width),
                                       .height = static_cast<unsigned>(layout.tile_height),
                                       .style = SplatStyle::Smooth,
                                       .radius_scale = 1.5,
                                       .relief = 0.5};
    Sheet sheet(static_cast<unsigned>(layout.width()), static_cast<unsigned>(layout.height()));
    const double all = static_cast<double>(candidates.size() * cameras.size());
    double done = 0;
    Splats splats;
    for (std::size_t c = 0; c < candidates.size(); ++c) {
        const PointCloud& samples = *candidates[c].samples;
        const bool has_moved = c == 0 || samples.positions != candidates[c - 1].samples->positions;
        if (has_moved) splats = measure_splats(samples.positions, {.normals = true}, quiet);
        for (std::size_t v = 0; v < cameras.size(); ++v) {
            const std::size_t column = layout.is_compared ? c : v % layout.columns;
            const std::size_t row = layout.is_compared ? v : v / layout.columns;
            sheet.put(render_splats(samples.positions, splats, samples.colors, cameras[v],
                                    rendering, context.part(done / all, (done + 1) / all)),
                      layout.left(column), layout.top(row));
            sheet.text(options.views[v], layout.left(column) + 0.5 * layout.tile_width,
                       layout.top(row) + layout.tile_height + kNote + 2, kNote, Align::Center);
            ++done;
        }
        const double middle =
            layout.is_compared ? layout.left(c) + 0.5 * layout.tile_width : 0.5 * layout.width();
        write_head(sheet, candidates[c], middle, kGap,
                   layout.is_compared ? layout.tile_width : layout.width() - 2 * kGap);
    }
    const double bar = std::min(440.0, 0.7 * layout.width());
    sheet.legend({options.legend, 0, options.range}, 0.5 * (layout.width() - bar),
                 layout.height() - kLegendHeight, bar);
    return {static_cast<unsigned>(layout.width()), static_cast<unsigned>(layout.height()),
            sheet.png()};
}

}  // namespace stipple
