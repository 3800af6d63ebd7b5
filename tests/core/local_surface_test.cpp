#include "error/local_surface.hpp"

#include "error/error_samples.hpp"

#include "support/support.hpp"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

// A surface in places (core/src/error/local_surface.hpp) against the whole of it.

namespace stipple {
namespace {

class LocalSurfaceTest : public testing::Test {
protected:
    /// The feet of places on the surface of the cloud, the places in its own coordinates.
    std::vector<Foot> local_feet(const PointCloud& cloud, std::span<const Vec3f> places,
                                 unsigned threads = 1) {
        RunContext context;
        context.threads = threads;
        const BoxedCloud boxed(cloud, "cloud");
        const ErrorFrame frame(boxed);
        const LocalSurface surface(boxed, frame, places.size(), {}, context);
        EXPECT_FALSE(surface.is_whole());
        std::vector<Vec3f> framed;
        for (const Vec3f& p : places) framed.push_back(in_frame(p, frame));
        std::vector<Foot> feet(places.size());
        const std::vector<Ball> views = surface.views(framed, LocalSurface::kForFeet, context);
        surface.find(
            *surface.gather(views, context), views,
            [&](std::size_t i, const Foot& foot) { feet[i] = foot; }, context);
        return feet;
    }

    std::vector<Foot> whole_feet(const PointCloud& cloud, std::span<const Vec3f> places) {
        const BoxedCloud boxed(cloud, "cloud");
        const ErrorFrame frame(boxed);
        const LocalSurface::Part all(frame.into(cloud, {}), PointTree::Leaves::Compact, {}, {});
        std::vector<Vec3f> framed;
        for (const Vec3f& p : places) framed.push_back(in_frame(p, frame));
        std::vector<Foot> feet(places.size());
        all.finder.find(framed, [&](std::size_t i, const Foot& foot) { feet[i] = foot; }, {});
        return feet;
    }

    /// One half has a hundred times as many points as the other.
    static PointCloud uneven_sphere() {
        PointCloud cloud;
        std::mt19937 random(1);
        for (const Vec3f& p : test::sphere(240'000).positions)
            if (p.x() < 0 || random() % 100 == 0) cloud.positions.push_back(p);
        return cloud;
    }

    static Vec3f in_frame(const Vec3f& p, const ErrorFrame& frame) {
        return (frame.scale * (p.cast<double>() - frame.center)).cast<float>();
    }

    /// Places around the points of a cloud, most of them near, some far.
    static std::vector<Vec3f> places_beside(const PointCloud& cloud, std::size_t n, float near) {
        std::mt19937 random(1);
        std::normal_distribution<float> normal;
        std::vector<Vec3f> places;
        for (std::size_t i = 0; i < n; ++i) {
            const float away = i % 10 == 0 ? 20 * near : near;
            const Vec3f move(normal(random), normal(random), normal(random));
            places.push_back(cloud.positions[random() % cloud.size()] + away * move);
        }
        return places;
    }

    static void expect_same(std::span<const Foot> a, std::span<const Foot> b) {
        for (std::size_t i = 0; i < a.size(); ++i) {
            EXPECT_NEAR(a[i].distance, b[i].distance, 1e-5) << i;
            EXPECT_EQ(a[i].converged, b[i].converged) << i;
        }
    }
};

TEST_F(LocalSurfaceTest, HasTheFeetOfTheWholeSurface) {
    const PointCloud cloud = test::sphere(120'000);
    const std::vector<Vec3f> places = places_beside(cloud, 100, 0.01F);
    expect_same(local_feet(cloud, places), whole_feet(cloud, places));
}

TEST_F(LocalSurfaceTest, HasThemWhereDensityIsUneven) {
    const PointCloud cloud = uneven_sphere();
    const std::vector<Vec3f> places = places_beside(test::sphere(5'000), 100, 0.01F);
    expect_same(local_feet(cloud, places), whole_feet(cloud, places));
}

TEST_F(LocalSurfaceTest, HasThoseOfPlacesFarAway) {
    const PointCloud cloud = test::sphere(120'000);
    const std::vector<Vec3f> places = {{0, 0, 30}, {0, -3, 0}, {4e5F, 0, 0}};
    const std::vector<Foot> feet = local_feet(cloud, places), whole = whole_feet(cloud, places);
    for (std::size_t i = 0; i < places.size(); ++i)
        EXPECT_NEAR(feet[i].distance, whole[i].distance, 1e-3 * whole[i].distance) << i;
}

TEST_F(LocalSurfaceTest, HasThoseWhereFloatsOfTheFrameAreTooCoarse) {
    // Points around 0, exact there, far from the middle of the box.
    PointCloud cloud;
    for (const Vec3f& p : test::sphere(60'000).positions) cloud.positions.push_back(1e-6F * p);
    for (const Vec3f& p : test::sphere(60'000).positions)
        cloud.positions.push_back(Vec3f(200, 90, 30) + p);
    std::vector<Vec3f> places;
    for (std::size_t i = 0; i < 200; ++i) places.push_back(cloud.positions[593 * i]);
    for (const Foot& foot : local_feet(cloud, places)) EXPECT_LT(foot.distance, 1e-4);
}

TEST_F(LocalSurfaceTest, HasTheAreasOfTheWholeSurface) {
    const PointCloud cloud = uneven_sphere();
    const BoxedCloud boxed(cloud, "cloud");
    const ErrorFrame frame(boxed);
    const LocalSurface surface(boxed, frame, 300, {}, {});
    ASSERT_FALSE(surface.is_whole());
    const LocalSurface::Part all(frame.into(cloud, {}), PointTree::Leaves::Compact, {}, {});
    const LonePoints some(surface.some().points, surface.some().tree);
    const std::vector<Vec3f> bases = draw_points_by_area(some, 300, 1, {}).positions;
    const auto part = surface.gather(surface.views(bases, LocalSurface::kForAreas, {}), {});
    const double every =
        static_cast<double>(surface.size()) / static_cast<double>(surface.some().points.size());
    const LonePoints of_part(part->points, part->tree, some, every), of_all(all.points, all.tree);
    const std::vector<float> local = areas_around(of_part, bases, {}).areas,
                             whole = areas_around(of_all, bases, {}).areas;
    std::size_t same = 0;
    for (std::size_t i = 0; i < bases.size(); ++i) same += local[i] == whole[i] ? 1 : 0;
    EXPECT_GE(same, bases.size() * 99 / 100);
}

TEST_F(LocalSurfaceTest, IsTheSameForAnyNumberOfThreads) {
    const PointCloud cloud = test::sphere(200'000);
    const std::vector<Vec3f> places = places_beside(cloud, 500, 0.002F);
    const std::vector<Foot> one = local_feet(cloud, places, 1),
                            eight = local_feet(cloud, places, 8);
    for (std::size_t i = 0; i < places.size(); ++i) EXPECT_EQ(one[i].distance, eight[i].distance);
}

TEST_F(LocalSurfaceTest, HasPlacesBesideItsPoints) {
    for (const std::size_t n : {500U, 120'000U}) {
        const PointCloud cloud = test::sphere(n);
        const BoxedCloud boxed(cloud, "cloud");
        const ErrorFrame frame(boxed);
        const LocalSurface surface(boxed, frame, 100, {}, {});
        EXPECT_EQ(surface.is_whole(), n == 500);
        const std::span<const Vec3f> bases = std::span(surface.some().points).first(100);
        const auto part = surface.gather(surface.views(bases, LocalSurface::kForFeet, {}), {});
        const std::vector<Vec3f> places = stipple::places_beside(
            LonePoints(part->points, part->tree), part->finder, bases, 1, {});
        ASSERT_EQ(places.size(), bases.size());
        const double spacing = std::sqrt(4 * std::numbers::pi / static_cast<double>(n));
        double moved = 0;
        for (std::size_t i = 0; i < places.size(); ++i) {
            const Vec3d place = places[i].cast<double>() / frame.scale + frame.center;
            EXPECT_NEAR(place.norm(), 1, 0.1 * spacing);
            const double way = (places[i] - bases[i]).cast<double>().norm() / frame.scale;
            EXPECT_LT(way, 1.5 * spacing);
            moved += way / static_cast<double>(places.size());
        }
        EXPECT_NEAR(moved, 0.4 * spacing, 0.2 * spacing);
    }
}

}  // namespace
}  // namespace stipple
