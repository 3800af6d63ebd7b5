#include "stipple/surface_attributes.hpp"

#include "base/first_touch.hpp"
#include "base/parallel_for.hpp"
#include "base/refuse.hpp"
#include "cloud/attribute_name.hpp"
#include "cloud/cloud_copy.hpp"
#include "stipple/local_analysis.hpp"
#include "stipple/normal_orientation.hpp"
#include "stipple/splats.hpp"

#include <algorithm>
#include <span>
#include <utility>
#include <vector>

namespace stipple {

namespace {

/// An attribute that has one of their names in PLY files, as `nx` alone may, gets another.
void set_normals(PointCloud& cloud, std::vector<Vec3f> normals) {
    cloud.normals = std::move(normals);
    settle_names(cloud);
}

void add_scalars(PointCloud& cloud, const char* name, std::vector<float> values) {
    set_attribute(cloud, {name, std::move(values), 1, Reduction::Mean});
}

void add_vectors(PointCloud& cloud, const char* name, std::span<const Vec3f> vectors,
                 const RunContext& context) {
    auto values = made_in_blocks<std::vector<float>>(3 * vectors.size(), context);
    for_blocks_in_order(vectors.size(), context, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) std::copy_n(vectors[i].data(), 3, &values[3 * i]);
    });
    set_attribute(cloud, {name, std::move(values), 3, Reduction::Nearest});
}

/// Writes the weights into the cloud, and gives the points of the lines.
PointCloud add_feature_lines(PointCloud& cloud, const FeatureLineOptions& options,
                             const RunContext& context) {
    FeatureLines features = find_feature_lines(cloud.positions, options, context);
    add_scalars(cloud, "feature_weight", std::move(features.weights));
    PointCloud lines = subset(cloud, features.points, context);
    std::vector<std::uint32_t> numbers;
    for (std::size_t l = 0; l < features.size(); ++l) {
        numbers.insert(numbers.end(), features.line(l).size(), static_cast<std::uint32_t>(l));
    }
    set_attribute(lines, {"line", std::move(numbers), 1, Reduction::Nearest});
    return lines;
}

}  // namespace

void validate(const SurfaceAttributeOptions& options) {
    require(options.k == 0 || (options.k >= 3 && options.k <= 64), "k", options.k,
            "3..64, or 0 to choose");
    const bool turns = options.signs == NormalSigns::Viewpoint;
    if (turns && !options.viewpoint)
        refuse("viewpoint: missing: expected x, y and z, which normals should point towards");
    if (!turns && options.viewpoint)
        refuse("viewpoint: expected only if normals should point towards it");
    if (options.viewpoint && !options.viewpoint->array().isFinite().all())
        refuse("viewpoint: expected finite coordinates");
    if (!options.feature_lines) return;
    const FeatureLineOptions& lines = *options.feature_lines;
    require(lines.variation > 0 && lines.variation < 1.0 / 3.0, "feature_lines.variation",
            lines.variation, "above 0, below 1/3");
    if (!(lines.low > 0 && lines.low <= lines.high && lines.high <= 1))
        refuse("feature_lines: expected 0 < low <= high <= 1");
    require(lines.min_links >= 2 && lines.min_links <= 1000, "feature_lines.min_links",
            lines.min_links, "2..1000");
}

PointCloud add_surface_attributes(PointCloud& cloud, const SurfaceAttributeOptions& options,
                                  const RunContext& context) {
    validate(options);
    if (cloud.empty()) {
        refuse("the cloud has no points: expected at least 1");
    }
    LocalAnalysis analysis =
        analyze_locally(cloud.positions, {.k = options.k, .density = true, .anisotropy = true},
                        context.part(0, 0.3));
    if (options.signs != NormalSigns::Any) {
        orient_normals(cloud.positions, analysis.normals, {.viewpoint = options.viewpoint},
                       context.part(0.3, 0.6));
    }
    set_normals(cloud, std::move(analysis.normals));
    add_scalars(cloud, "variation", std::move(analysis.variation));
    add_scalars(cloud, "density", std::move(analysis.density));
    add_scalars(cloud, "anisotropy", std::move(analysis.anisotropy));
    PointCloud lines;
    if (options.feature_lines) {
        lines = add_feature_lines(cloud, *options.feature_lines, context.part(0.6, 1));
    }
    context.checkpoint(1);
    return lines;
}

void add_splats(PointCloud& cloud, SplatAttributes attributes, const RunContext& context) {
    if (attributes == SplatAttributes::None) return;
    const bool normals = attributes != SplatAttributes::Radius && cloud.normals.empty();
    const bool ellipses = attributes == SplatAttributes::Ellipse;
    Splats splats = measure_splats(cloud.positions, {normals, ellipses}, context.part(0, 0.7));
    if (normals) {
        set_normals(cloud, std::move(splats.normals));
        orient_normals(cloud.positions, cloud.normals, {}, context.part(0.7, 1));
    }
    add_scalars(cloud, "radius", std::move(splats.radii));
    if (!ellipses) return;
    add_vectors(cloud, "major", splats.major, context);
    add_vectors(cloud, "minor", splats.minor, context);
}

}  // namespace stipple
