#include "stipple/globe.hpp"

#include "support/expect_error.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace stipple {
namespace {

Vec3d on_globe(unsigned epsg, const Vec3d& frame_at, const Vec3d& place) {
    return (globe_frame(epsg, frame_at) * place.homogeneous()).head<3>();
}

TEST(GlobeFrame, PutsPlacesWherePROJPutsThem) {
    struct Known {
        unsigned epsg;
        Vec3d place, on_globe;
    };
    // `cs2cs EPSG:<from> EPSG:4978` of PROJ 9.1.
    const Known all[] = {
        {32617, {500'000, 0, 0}, {997760.4495, -6299611.5496, 0}},
        {32617, {630'084, 4'833'438, 100}, {851435.5069, -4543965.8152, 4379506.5299}},
        {32617, {300'000, 5'500'000, 50}, {449365.2514, -4115774.4537, 4835510.1269}},
        {32733, {300'000, 5'500'000, 50}, {4730326.4165, 1060415.2879, -4131075.7569}}};
    for (const Known& known : all) {
        const Vec3d is = on_globe(known.epsg, known.place, known.place);
        EXPECT_LT((is - known.on_globe).norm(), 0.001) << known.epsg << ": " << is.transpose();
    }
}

TEST(GlobeFrame, PutsPlacesOfWebMapsWhereTheirLatitudesAre) {
    struct Known {
        Vec3d place, on_globe;
    };
    // Latitude 2 atan(exp(y / a)) - 90 degrees, longitude x / a, on the ellipsoid.
    const Known all[] = {
        {{0, 0, 0}, {6378137, 0, 0}},
        {{-13'693'000, 5'683'000, 130}, {-2444206.9745, -3762841.1123, 4517920.7396}},
        {{951'781.6, 6'002'500.5, 400}, {4279774.8630, 643435.3334, 4669934.1281}}};
    for (const Known& known : all) {
        const Vec3d is = on_globe(3857, known.place, known.place);
        EXPECT_LT((is - known.on_globe).norm(), 0.001) << is.transpose();
    }
    const Eigen::Matrix3d axes = globe_frame(3857, all[2].place).topLeftCorner<3, 3>();
    EXPECT_NEAR(axes.col(0).norm(), 0.678, 1e-3) << "a metre there, at 47 degrees north";
    EXPECT_NEAR(axes.col(2).norm(), 1, 1e-9);
    EXPECT_GT(axes.determinant(), 0) << "not mirrored";
}

TEST(GlobeFrame, OfNad83IsThatOfWgs84) {
    const Vec3d place(630'084, 4'833'438, 100);
    EXPECT_EQ(globe_frame(26917, place), globe_frame(32617, place));
}

TEST(GlobeFrame, StandsUprightAndKeepsLengthsButForTheScaleOfTheMap) {
    const Vec3d place(500'000, 5'400'000, 0);
    const Eigen::Matrix3d axes = globe_frame(32633, place).topLeftCorner<3, 3>();
    constexpr double kScale = 1 / 0.9996;  // on the meridian of the zone
    EXPECT_NEAR(axes.col(0).norm(), kScale, 1e-6);
    EXPECT_NEAR(axes.col(1).norm(), kScale, 1e-6);
    EXPECT_NEAR(axes.col(2).norm(), 1, 1e-9);
    EXPECT_NEAR(axes.col(0).dot(axes.col(1)), 0, 1e-6);
    EXPECT_GT(axes.determinant(), 0) << "not mirrored";
    // On the meridian of 15 degrees, east is across it and up is away from the axis of the earth.
    const double lon = 15 * std::numbers::pi / 180;
    EXPECT_LT((axes.col(0).normalized() - Vec3d(-std::sin(lon), std::cos(lon), 0)).norm(), 1e-6);
    EXPECT_GT(axes.col(2).dot(on_globe(32633, place, place).normalized()), 0.99);
}

TEST(GlobeFrame, IsOffByTheCurvatureOfTheEarthFartherAway) {
    const Vec3d place(450'000, 5'400'000, 200), away = place + Vec3d(600, 800, 0);
    const double off = (on_globe(25833, place, away) - on_globe(25833, away, away)).norm();
    EXPECT_LT(off, 0.1);
    EXPECT_GT(off, 0.06);
}

TEST(GlobeFrame, OfEarthCentredCoordinatesLeavesThemAlone) {
    EXPECT_EQ(globe_frame(4978, Vec3d(4e6, 1e6, 5e6)), Eigen::Matrix4d::Identity());
}

TEST(GlobeFrame, RefusesSystemsAndPlacesItDoesNotKnow) {
    EXPECT_TRUE(is_on_globe(32601) && is_on_globe(32760) && is_on_globe(25832) &&
                is_on_globe(26901));
    for (const unsigned epsg :
         {0U, 4326U, 32600U, 32661U, 32700U, 32761U, 25827U, 25839U, 26900U, 26924U}) {
        EXPECT_FALSE(is_on_globe(epsg));
        test::expect_refused(": expected 4978 (earth-centred)",
                             [&] { globe_frame(epsg, Vec3d::Zero()); });
    }
    test::expect_refused("the cloud lies beyond 10,000 km",
                         [&] { globe_frame(32633, Vec3d(2e7, 0, 0)); });
    for (const unsigned epsg : {32633U, 3857U, 4978U})
        for (int axis = 0; axis < 3; ++axis)
            test::expect_refused("the cloud lies at no finite place",
                                 [&] { globe_frame(epsg, std::nan("") * Vec3d::Unit(axis)); });
    test::expect_refused("the cloud lies beyond 21,000 km",
                         [&] { globe_frame(3857, Vec3d(0, 2.2e7, 0)); });
}

TEST(WellKnownText, NamesTheSystemAndItsParameters) {
    const std::string south = well_known_text(32733);
    EXPECT_TRUE(south.starts_with("PROJCS[\"WGS 84 / UTM zone 33S\",GEOGCS[\"WGS 84\","));
    EXPECT_NE(south.find("PARAMETER[\"central_meridian\",15]"), std::string::npos);
    EXPECT_NE(south.find("PARAMETER[\"false_northing\",10000000]"), std::string::npos);
    EXPECT_TRUE(south.ends_with("AUTHORITY[\"EPSG\",\"32733\"]]"));
    EXPECT_TRUE(well_known_text(25828).starts_with("PROJCS[\"ETRS89 / UTM zone 28N\","));
    EXPECT_NE(well_known_text(32601).find("\"central_meridian\",-177]"), std::string::npos);
    EXPECT_TRUE(well_known_text(4978).starts_with("GEOCCS[\"WGS 84\","));
    EXPECT_TRUE(well_known_text(26910).starts_with(
        "PROJCS[\"NAD83 / UTM zone 10N\",GEOGCS[\"NAD83\",DATUM[\"North_American_Datum_1983\","));
    EXPECT_TRUE(
        well_known_text(3857).ends_with("+wktext +no_defs\"],AUTHORITY[\"EPSG\",\"3857\"]]"));
    test::expect_refused("epsg 4326: expected 4978 (earth-centred)",
                         [&] { well_known_text(4326); });
}

}  // namespace
}  // namespace stipple
