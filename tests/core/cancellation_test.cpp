// Long operations end when asked to, at whichever of their reports that is. The methods of simplify
// are asked in simplify_test.cpp.

#include "stipple/cleaning.hpp"
#include "stipple/codec.hpp"
#include "stipple/error.hpp"
#include "stipple/error_bounded.hpp"
#include "stipple/lod_pyramid.hpp"
#include "stipple/outliers.hpp"
#include "stipple/simplify.hpp"
#include "stipple/splat_renderer.hpp"
#include "stipple/surface_attributes.hpp"
#include "stipple/surface_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <functional>
#include <stop_token>
#include <string>

namespace stipple {
namespace {

struct Operation {
    const char* name;
    std::function<void(const RunContext&)> run;
};

PointCloud scan() {
    return test::with_attributes(test::sphere(2'000, 0.01));
}

LodPyramidOptions pyramid_of(Method method) {
    return {.sizes = {50, 500}, .simplification = {.method = method}};
}

const Operation kOperations[] = {
    {"Upsample",
     [](const RunContext& c) { upsample(test::sphere(300, 0.01), {.points = 500}, c); }},
    {"AdaptiveParticles",
     [](const RunContext& c) {
         SimplifyOptions options;
         options.method = Method::Particles;
         options.points = 100;
         options.particles.adaptivity = 1;
         simplify(scan(), options, c);
     }},
    {"AddSurfaceAttributes",
     [](const RunContext& c) {
         PointCloud cloud = scan();
         add_surface_attributes(cloud, {}, c);
     }},
    {"AddSplats",
     [](const RunContext& c) {
         PointCloud cloud = scan();
         add_splats(cloud, SplatAttributes::Ellipse, c);
     }},
    {"FitCameraAndRenderSplats",
     [](const RunContext& c) {
         const PointCloud cloud = scan();
         const Splats splats = measure_splats(cloud.positions, {.normals = true}, c.part(0, 0.3));
         const Camera camera = fit_camera(cloud.positions, {}, 1.0, c.part(0.3, 0.4));
         const SplatRenderOptions small{.width = 40, .height = 40};
         render_splats(cloud.positions, splats, {}, camera, small, c.part(0.4, 1));
     }},
    {"Clean",
     [](const RunContext& c) {
         PointCloud cloud = scan();
         clean(cloud, c);
     }},
    {"RemoveOutliers",
     [](const RunContext& c) {
         PointCloud cloud = scan();
         remove_outliers(cloud, {}, c);
     }},
    {"MeasureErrorAtPoints",
     [](const RunContext& c) { measure_error(scan(), test::sphere(200), {.samples = 500}, c); }},
    {"MeasureErrorOnTheSurface",
     [](const RunContext& c) {
         measure_error(scan(), test::sphere(200),
                       {.sampling = ErrorSampling::Surface, .samples = 500}, c);
     }},
    {"ErrorCurve",
     [](const RunContext& c) {
         error_curve(
             scan(), {.points = {50, 100, 200}}, [](const CurvePoint&) {}, {.samples = 500}, c);
     }},
    {"PyramidOfCuts",
     [](const RunContext& c) {
         build_lod_pyramid(
             scan(), pyramid_of(Method::Hierarchical), [](LodLevel&&) {}, c);
     }},
    {"PyramidOfSnapshots",
     [](const RunContext& c) {
         build_lod_pyramid(
             scan(), pyramid_of(Method::Multiphase), [](LodLevel&&) {}, c);
     }},
    {"EncodeAndDecodePly",
     [](const RunContext& c) {
         decode_cloud(
             encode_ply(scan(), {.encoding = PlyEncoding::Ascii, .comments = {}}, c.part(0, 0.5)),
             {}, c.part(0.5, 1));
     }},
    {"EncodeAndDecodeDraco",
     [](const RunContext& c) {
         decode_cloud(encode_draco(scan(), {}, c.part(0, 0.5)), {}, c.part(0.5, 1));
     }},
};

class EveryOperation : public testing::TestWithParam<Operation> {};

TEST_P(EveryOperation, StopsWhenAskedToAtAnyReport) {
    std::size_t reports = 0;
    GetParam().run({.progress = [&](double) { ++reports; }});
    ASSERT_GT(reports, 0U);
    for (std::size_t stop_at = 0; stop_at < reports; stop_at += reports / 6 + 1) {
        std::stop_source source;
        if (stop_at == 0) source.request_stop();
        std::size_t seen = 0;
        const RunContext context = {.stop = source.get_token(), .progress = [&](double) {
                                        if (++seen == stop_at) source.request_stop();
                                    }};
        EXPECT_THROW(GetParam().run(context), Cancelled) << "at report " << stop_at;
        EXPECT_EQ(seen, stop_at) << "it went on after it was asked to stop";
    }
}

INSTANTIATE_TEST_SUITE_P(Operations, EveryOperation, testing::ValuesIn(kOperations),
                         [](const auto& instance) { return std::string(instance.param.name); });

}  // namespace
}  // namespace stipple
