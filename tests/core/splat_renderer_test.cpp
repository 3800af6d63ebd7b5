#include "stipple/splat_renderer.hpp"

#include "stipple/error.hpp"
#include "support/expect_error.hpp"
#include "support/support.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace stipple {
namespace {

// Looks along -z at the square [-1, 1]^2.
Camera orthographic() {
    Camera camera;
    camera.eye = {0, 0, 10};
    camera.perspective = false;
    return camera;
}

Camera perspective() {
    Camera camera;
    camera.eye = {0, 0, 10};
    camera.half_height = 0.1;
    return camera;
}

SplatRenderOptions small(unsigned size = 100) {
    SplatRenderOptions options;
    options.width = options.height = size;
    options.background.a = 0;
    return options;
}

Splats discs(std::size_t n, float radius, const Vec3f& normal = Vec3f::UnitZ()) {
    return {.radii = std::vector<float>(n, radius),
            .normals = std::vector<Vec3f>(n, normal),
            .major = {},
            .minor = {}};
}

/// How much of the picture is covered, of 1.
double coverage(const Image& image) {
    double sum = 0;
    for (const Rgba8& p : image.pixels) sum += p.a / 255.0;
    return sum / static_cast<double>(image.pixels.size());
}

double brightness(const Rgba8& p) {
    return p.r + p.g + p.b;
}

std::vector<Rgba8> rendered_sphere(unsigned threads, SplatStyle style) {
    const PointCloud cloud = test::sphere(3000);
    Splats splats = discs(cloud.size(), 0.06F);
    splats.normals = cloud.positions;  // the unit sphere's own
    SplatRenderOptions options = small(150);
    options.style = style;
    RunContext context;
    context.threads = threads;
    const Camera camera = fit_camera(cloud.positions, {}, 1.0);
    return render_splats(cloud.positions, splats, {}, camera, options, context).pixels;
}

TEST(RenderSplats, DrawsADiscWithItsArea) {
    const std::vector<Vec3f> point = {{0.1F, 0.2F, 0}};
    for (const Camera& camera : {orthographic(), perspective()}) {
        const Image image = render_splats(point, discs(1, 0.5F), {}, camera, small());
        EXPECT_NEAR(coverage(image), std::numbers::pi * 0.25 / 4, 0.002);
        // In the middle of the square [-1, 1]^2 the pixel is 50, 50; y goes down.
        EXPECT_EQ(image.at(55, 40).a, 255);
        EXPECT_EQ(image.at(55, 68).a, 0);
    }
}

TEST(RenderSplats, ForeshortensATurnedDiscByTheCosine) {
    const std::vector<Vec3f> point = {Vec3f::Zero()};
    const Vec3f turned(std::sin(1.0F), 0, std::cos(1.0F));
    const Image image = render_splats(point, discs(1, 0.5F, turned), {}, orthographic(), small());
    EXPECT_NEAR(coverage(image), std::cos(1.0) * std::numbers::pi * 0.25 / 4, 0.002);
}

TEST(RenderSplats, DrawsAnEllipseByItsHalfAxes) {
    const std::vector<Vec3f> point = {Vec3f::Zero()};
    const Splats ellipse{.radii = {},
                         .normals = {Vec3f::UnitZ()},
                         .major = {Vec3f(0.8F, 0, 0)},
                         .minor = {Vec3f(0, 0.2F, 0)}};
    const Image image = render_splats(point, ellipse, {}, orthographic(), small());
    EXPECT_NEAR(coverage(image), std::numbers::pi * 0.16 / 4, 0.002);
    EXPECT_EQ(image.at(85, 50).a, 255);
    EXPECT_EQ(image.at(50, 65).a, 0);
}

TEST(RenderSplats, DrawsADiscWhereRaysMeetIt) {
    const std::vector<Vec3f> point = {{2.3F, -1.1F, 4}};
    const Vec3d normal = Vec3d(0.7, 0.3, 0.5).normalized();
    constexpr double kRadius = 2;
    Camera camera = perspective();
    for (const bool is_perspective : {false, true}) {
        camera.perspective = is_perspective;
        camera.half_height = is_perspective ? 0.9 : 6;
        SplatRenderOptions options = small(90);
        options.samples = 1;
        const Image image =
            render_splats(point, discs(1, kRadius, normal.cast<float>()), {}, camera, options);
        const Vec3d center = point[0].cast<double>();
        unsigned wrong = 0, covered = 0;
        for (unsigned y = 0; y < 90; ++y) {
            for (unsigned x = 0; x < 90; ++x) {
                const Vec3d at =
                    camera.half_height * Vec3d((x + 0.5) / 45 - 1, 1 - (y + 0.5) / 45, 0);
                const Vec3d from = is_perspective ? camera.eye : Vec3d(camera.eye + at);
                const Vec3d way =
                    is_perspective ? Vec3d(at - Vec3d::UnitZ()) : Vec3d(-Vec3d::UnitZ());
                const double far = normal.dot(center - from) / normal.dot(way);
                const double distance = (from + far * way - center).norm();
                covered += distance < kRadius;
                if (std::abs(distance - kRadius) < 1e-4) continue;  // either
                wrong += (distance < kRadius) != (image.at(x, y).a == 255);
            }
        }
        EXPECT_EQ(wrong, 0U);
        EXPECT_GT(covered, 150U);
    }
}

TEST(RenderSplats, ShowsTheNearerOfTwoSurfaces) {
    const std::vector<Rgba8> colors = {{255, 0, 0, 255}, {0, 0, 255, 255}};
    for (const bool red_is_nearer : {false, true}) {
        const float z = red_is_nearer ? 1.0F : -1.0F;
        const std::vector<Vec3f> points = {{0, 0, z}, {0, 0, -z}};
        const Image image = render_splats(points, discs(2, 0.5F), colors, orthographic(), small());
        const Rgba8 middle = image.at(50, 50);
        EXPECT_EQ(middle.r > middle.b, red_is_nearer);
    }
}

TEST(RenderSplats, BlendsWhatLiesWithinADisc) {
    const std::vector<Rgba8> colors = {{255, 0, 0, 255}, {0, 0, 255, 255}};
    const std::vector<Vec3f> points = {{-0.2F, 0, 0.01F}, {0.2F, 0, 0}};
    const Image image = render_splats(points, discs(2, 0.5F), colors, orthographic(), small());
    const Rgba8 between = image.at(50, 50);
    EXPECT_GT(between.r, 100);
    EXPECT_GT(between.b, 100);
}

TEST(RenderSplats, LightsWhatFacesTheLight) {
    const std::vector<Vec3f> point = {Vec3f::Zero()};
    const auto middle = [&](const Vec3f& normal) {
        const Splats splats = discs(1, 0.5F, normal.normalized());
        return brightness(render_splats(point, splats, {}, orthographic(), small()).at(50, 50));
    };
    EXPECT_GT(middle({-0.5F, 0.6F, 0.6F}), middle({0, 0, 1}));
    EXPECT_GT(middle({0, 0, 1}), middle({0.5F, -0.6F, 0.6F}));
    EXPECT_EQ(middle({-0.5F, 0.6F, 0.6F}), middle({0.5F, -0.6F, -0.6F}));  // both sides are lit
}

TEST(RenderSplats, LightsASilhouetteAsWhatIsBesideIt) {
    // The light comes from the left and above: the rim below on the right lies in shadow, though
    // some of its discs face away and, turned about, would face the light.
    const PointCloud cloud = test::sphere(3000);
    Splats splats = discs(cloud.size(), 0.06F);
    splats.normals = cloud.positions;
    const SplatRenderOptions options = small(300);
    const Camera camera = fit_camera(cloud.positions, {.toward_eye = {0, 0, 1}}, 1.0);
    const Image image = render_splats(cloud.positions, splats, {}, camera, options);
    const double beside = brightness(image.at(238, 238));
    int rim = 0;
    for (unsigned at = 239; at < 300 && image.at(at, at).a == 255; ++at, ++rim)
        EXPECT_LE(brightness(image.at(at, at)), 1.1 * beside) << at;
    EXPECT_GT(rim, 2);

    // And all the same whatever signs the normals have.
    for (std::size_t i = 0; i < splats.normals.size(); i += 2) splats.normals[i] *= -1;
    EXPECT_EQ(render_splats(cloud.positions, splats, {}, camera, options).pixels, image.pixels);
}

TEST(RenderSplats, ShowsColorsAsTheyAreWithoutRelief) {
    const std::vector<Vec3f> point = {Vec3f::Zero()};
    const std::vector<Rgba8> color = {{12, 200, 99, 255}};
    SplatRenderOptions options = small();
    options.relief = 0;
    const Splats turned = discs(1, 0.5F, Vec3f(1, -1, 1).normalized());
    const Image image = render_splats(point, turned, color, orthographic(), options);
    EXPECT_EQ(image.at(50, 50), color.front());
}

TEST(RenderSplats, LeavesOutBackFacesWhenAsked) {
    const std::vector<Vec3f> point = {Vec3f::Zero()};
    SplatRenderOptions options = small();
    options.cull_back_faces = true;
    const auto seen = [&](const Vec3f& normal) {
        return coverage(render_splats(point, discs(1, 0.5F, normal), {}, perspective(), options));
    };
    EXPECT_GT(seen(Vec3f::UnitZ()), 0);
    EXPECT_EQ(seen(-Vec3f::UnitZ()), 0);
}

TEST(RenderSplats, DarkensAHollow) {
    // A plate with a groove along its middle.
    std::vector<Vec3f> points;
    Splats splats;
    const auto add = [&](const Vec3f& p, const Vec3f& n) {
        points.push_back(p);
        splats.normals.push_back(n);
        splats.radii.push_back(0.02F);
    };
    for (float x = -0.9F; x <= 0.9F; x += 0.02F)
        for (float y = -0.9F; y <= 0.9F; y += 0.02F)
            add({x, y, std::min(0.0F, std::abs(x) - 0.3F)}, Vec3f::UnitZ());
    SplatRenderOptions options = small();
    const auto ratio = [&] {
        const Image image = render_splats(points, splats, {}, orthographic(), options);
        return brightness(image.at(50, 50)) / brightness(image.at(80, 50));
    };
    const double darkened = ratio();
    options.occlusion = 0;
    EXPECT_LT(darkened, 0.9 * ratio());
}

TEST(RenderSplats, LeavesNoHoleWhereSplatsAreSmallerThanSamples) {
    std::vector<Vec3f> points;
    for (int x = -300; x <= 300; ++x)
        for (int y = -300; y <= 300; ++y)
            points.emplace_back(static_cast<float>(x) / 300, static_cast<float>(y) / 300, 0.0F);
    const Image image =
        render_splats(points, discs(points.size(), 1e-5F), {}, orthographic(), small());
    EXPECT_EQ(coverage(image), 1);
}

TEST(RenderSplats, MixesTheRimWithTheBackground) {
    const std::vector<Vec3f> point = {Vec3f::Zero()};
    const Image image = render_splats(point, discs(1, 0.5F), {}, orthographic(), small());
    EXPECT_TRUE(
        std::ranges::any_of(image.pixels, [](const Rgba8& p) { return p.a > 20 && p.a < 235; }));
}

TEST(RenderSplats, GivesTheSameBytesOnAnyNumberOfThreads) {
    for (const SplatStyle style : {SplatStyle::Smooth, SplatStyle::Discs})
        EXPECT_EQ(rendered_sphere(1, style), rendered_sphere(7, style));
}

TEST(RenderSplats, DrawsNothingForWhatIsBehindTheEyeOrHasNoArea) {
    const std::vector<Vec3f> points = {{0, 0, 20}, {0, 0, 10}, {0, 0, 0}};
    Splats splats = discs(3, 0.5F);
    splats.radii[2] = 0;
    EXPECT_EQ(coverage(render_splats(points, splats, {}, perspective(), small())), 0);
}

TEST(RenderSplats, DrawsAnEmptyPictureOfNoSplats) {
    const Image image = render_splats({}, {}, {}, perspective(), small(3));
    EXPECT_EQ(image.pixels, std::vector<Rgba8>(9, Rgba8{0, 0, 0, 0}));
}

TEST(RenderSplats, SaysWhatIsOutOfRange) {
    const std::vector<Vec3f> point = {Vec3f::Zero()};
    const auto attempt = [&](auto change) {
        SplatRenderOptions options = small();
        Splats splats = discs(1, 0.5F);
        change(options, splats);
        render_splats(point, splats, {}, perspective(), options);
    };
    test::expect_refused("width 0: expected 1..16384",
                         [&] { attempt([](auto& o, auto&) { o.width = 0; }); });
    test::expect_refused("height 20000: expected 1..16384",
                         [&] { attempt([](auto& o, auto&) { o.height = 20000; }); });
    test::expect_refused("samples 9: expected 1..8",
                         [&] { attempt([](auto& o, auto&) { o.samples = 9; }); });
    test::expect_refused("radius_scale 0: expected more than 0",
                         [&] { attempt([](auto& o, auto&) { o.radius_scale = 0; }); });
    test::expect_refused("occlusion nan: expected 0..1",
                         [&] { attempt([](auto& o, auto&) { o.occlusion = NAN; }); });
    test::expect_refused("relief 1.5: expected 0..1",
                         [&] { attempt([](auto& o, auto&) { o.relief = 1.5; }); });
    test::expect_refused("normals: 0 for 1 points",
                         [&] { attempt([](auto&, auto& s) { s.normals.clear(); }); });
    test::expect_refused("radii: 0 for 1 points",
                         [&] { attempt([](auto&, auto& s) { s.radii.clear(); }); });
    test::expect_refused("minor: 0 for 1 points",
                         [&] { attempt([](auto&, auto& s) { s.major = {Vec3f::UnitX()}; }); });
    EXPECT_NO_THROW(attempt([](auto&, auto&) {}));
}

TEST(RenderSplats, StopsWhenAsked) {
    std::stop_source source;
    source.request_stop();
    const std::vector<Vec3f> point = {Vec3f::Zero()};
    EXPECT_THROW(
        render_splats(point, discs(1, 1), {}, perspective(), small(), {.stop = source.get_token()}),
        Cancelled);
}

TEST(FitCamera, ShowsAllPointsAndFillsTheFrame) {
    PointCloud cloud = test::cube(500);
    for (Vec3f& p : cloud.positions) p = p.cwiseProduct(Vec3f(3, 1, 0.5F)) + Vec3f(100, 7, -30);
    for (const double field_of_view : {0.0, 0.4, 1.2})
        for (const double aspect : {0.5, 1.0, 2.0}) {
            const ViewOptions view{
                .toward_eye = {1, 0.5, 2}, .field_of_view_rad = field_of_view, .margin = 0.1};
            const Camera camera = fit_camera(cloud.positions, view, aspect);
            double widest = 0;
            for (const Vec3f& p : cloud.positions) {
                const Vec3d d = p.cast<double>() - camera.eye;
                const double unit =
                    camera.half_height * (camera.perspective ? d.dot(camera.forward) : 1);
                widest = std::max({widest, std::abs(d.dot(camera.right)) / (unit * aspect),
                                   std::abs(d.dot(camera.up)) / unit});
            }
            EXPECT_NEAR(widest, 0.8, 0.01) << field_of_view << ' ' << aspect;
        }
}

TEST(FitCamera, PutsUpAtTheTop) {
    const std::vector<Vec3f> points = {{0, 0, 1}, {0, 0, 0}};
    const Camera camera =
        fit_camera(points, {.toward_eye = {1, 0, 0.3}, .up = Vec3d::UnitZ()}, 1.0);
    const Image image =
        render_splats(points, discs(2, 0.2F, Vec3f::UnitX()),
                      std::vector<Rgba8>{{255, 0, 0, 255}, {0, 0, 255, 255}}, camera, small());
    const auto first =
        std::ranges::find_if(image.pixels, [](const Rgba8& p) { return p.a == 255; });
    ASSERT_NE(first, image.pixels.end());
    EXPECT_GT(first->r, first->b);
}

TEST(FitCamera, LooksAtASinglePoint) {
    const std::vector<Vec3f> point = {{3, 4, 5}};
    for (const double field_of_view : {0.0, 0.5}) {
        const Camera camera = fit_camera(point, {.field_of_view_rad = field_of_view}, 1.0);
        EXPECT_TRUE(camera.eye.allFinite());
        EXPECT_GT(camera.half_height, 0);
    }
}

TEST(FitCamera, SaysWhatIsNotAView) {
    const std::vector<Vec3f> point = {Vec3f::Zero()};
    test::expect_refused("points: none to look at", [&] { fit_camera({}, {}, 1.0); });
    test::expect_refused("aspect 0: expected more than 0", [&] { fit_camera(point, {}, 0.0); });
    test::expect_refused("up: expected a direction other than toward_eye",
                         [&] { fit_camera(point, {.toward_eye = Vec3d::Zero()}, 1.0); });
    test::expect_refused("up: expected a direction other than toward_eye",
                         [&] { fit_camera(point, {.toward_eye = Vec3d::UnitY()}, 1.0); });
    test::expect_refused("field_of_view_rad 3: expected 0..2.5",
                         [&] { fit_camera(point, {.field_of_view_rad = 3}, 1.0); });
    test::expect_refused("margin 0.5: expected 0..0.45",
                         [&] { fit_camera(point, {.margin = 0.5}, 1.0); });
}

TEST(Viridis, RunsFromPurpleToYellowAndGrowsLighterAllTheWay) {
    const auto distance = [](const Rgba8& a, const Rgba8& b) {
        return std::abs(a.r - b.r) + std::abs(a.g - b.g) + std::abs(a.b - b.b);
    };
    EXPECT_LE(distance(viridis(0), {68, 1, 84, 255}), 3);
    EXPECT_LE(distance(viridis(0.5), {33, 145, 140, 255}), 3);
    EXPECT_LE(distance(viridis(1), {253, 231, 37, 255}), 3);
    EXPECT_EQ(viridis(-5), viridis(0));
    EXPECT_EQ(viridis(NAN), viridis(0));
    EXPECT_EQ(viridis(7), viridis(1));
    const auto luma = [](const Rgba8& c) { return 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b; };
    for (int i = 8; i < 256; i += 8)
        EXPECT_GT(luma(viridis(i / 255.0)), luma(viridis((i - 8) / 255.0)));
}

}  // namespace
}  // namespace stipple
