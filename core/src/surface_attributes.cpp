#include "stipple/surface_attributes.hpp"

#include "stipple/error.hpp"
#include "stipple/local_analysis.hpp"
#include "stipple/normal_orientation.hpp"
#include "stipple/splats.hpp"

#include <string>
#include <utility>

namespace stipple {

namespace {

void add_scalars(PointCloud& cloud, const char* name, std::vector<float> values) {
    set_attribute(cloud, {name, std::move(values), 1, Reduction::Mean});
}

void add_vectors(PointCloud& cloud, const char* name, const std::vector<Vec3f>& vectors) {
    std::vector<float> values;
    values.reserve(3 * vectors.size());
    for (const Vec3f& v : vectors) values.insert(values.end(), v.begin(), v.end());
    set_attribute(cloud, {name, std::move(values), 3, Reduction::Nearest});
}

}  // namespace

void validate(const SurfaceAttributeOptions& options) {
    const auto refuse = [](const std::string& message) {
        throw Error(ErrorCode::InvalidArgument, message);
    };
    if (options.k != 0 && (options.k < 3 || options.k > 64)) {
        refuse("k " + std::to_string(options.k) + ": expected 3..64, or 0 to choose");
    }
    if ((options.signs == NormalSigns::Viewpoint) != options.viewpoint.has_value()) {
        refuse("viewpoint: expected where normals turn towards one, and only there");
    }
    if (options.viewpoint && !options.viewpoint->array().isFinite().all()) {
        refuse("viewpoint: expected finite coordinates");
    }
}

void add_surface_attributes(PointCloud& cloud, const SurfaceAttributeOptions& options,
                            const RunContext& context) {
    validate(options);
    if (cloud.empty()) {
        throw Error(ErrorCode::InvalidArgument, "the cloud has no points: expected at least 1");
    }
    LocalAnalysis analysis =
        analyze_locally(cloud.positions, {.k = options.k, .density = true, .anisotropy = true},
                        context.part(0, 0.6));
    if (options.signs != NormalSigns::Any) {
        orient_normals(cloud.positions, analysis.normals, {.viewpoint = options.viewpoint},
                       context.part(0.6, 1));
    }
    cloud.normals = std::move(analysis.normals);
    add_scalars(cloud, "variation", std::move(analysis.variation));
    add_scalars(cloud, "density", std::move(analysis.density));
    add_scalars(cloud, "anisotropy", std::move(analysis.anisotropy));
    context.checkpoint(1);
}

void add_splats(PointCloud& cloud, SplatAttributes attributes, const RunContext& context) {
    if (attributes == SplatAttributes::None) return;
    const bool normals = attributes != SplatAttributes::Radius && cloud.normals.empty();
    const bool ellipses = attributes == SplatAttributes::Ellipse;
    Splats splats = measure_splats(cloud.positions, {normals, ellipses}, context);
    if (normals) cloud.normals = std::move(splats.normals);
    add_scalars(cloud, "radius", std::move(splats.radii));
    if (!ellipses) return;
    add_vectors(cloud, "major", splats.major);
    add_vectors(cloud, "minor", splats.minor);
}

}  // namespace stipple
