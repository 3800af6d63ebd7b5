#include "stipple/globe.hpp"

#include "base/refuse.hpp"

#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <string>

// Follows: L. Krueger 1912 in the form of C. Karney, Transverse Mercator with an accuracy of a few
// nanometers, 2011: the series to the fourth order, which is right to a tenth of a millimetre.

namespace stipple {

namespace {

constexpr unsigned kEarthCentred = 4978, kWebMercator = 3857;
constexpr double kAxis = 6'378'137.0, kFlattening = 1 / 298.257223563;  // WGS 84
constexpr double kDegree = std::numbers::pi / 180;

enum class Datum { Wgs84, Etrs89, Nad83 };

/// Of UTM.
struct Zone {
    unsigned number = 0;  ///< 1..60; 0: none
    bool south = false;
    Datum datum = Datum::Wgs84;
};

Zone zone_of(unsigned epsg) noexcept {
    if (epsg > 32'600 && epsg <= 32'660) return {epsg - 32'600, false};
    if (epsg > 32'700 && epsg <= 32'760) return {epsg - 32'700, true};
    if (epsg >= 25'828 && epsg <= 25'838) return {epsg - 25'800, false, Datum::Etrs89};
    if (epsg > 26'900 && epsg <= 26'923) return {epsg - 26'900, false, Datum::Nad83};
    return {};
}

Vec3d earth_centred(double latitude, double longitude, double height) {
    constexpr double e2 = kFlattening * (2 - kFlattening);
    const double s = std::sin(latitude), c = std::cos(latitude);
    const double radius = kAxis / std::sqrt(1 - e2 * s * s);
    return {(radius + height) * c * std::cos(longitude),
            (radius + height) * c * std::sin(longitude), (radius * (1 - e2) + height) * s};
}

/// From easting and northing on the sphere of web maps, and height.
Vec3d earth_centred_of_web(const Vec3d& place) {
    return earth_centred(std::atan(std::sinh(place.y() / kAxis)), place.x() / kAxis, place.z());
}

/// From easting, northing and height.
Vec3d earth_centred(const Zone& zone, const Vec3d& place) {
    constexpr double n = kFlattening / (2 - kFlattening), n2 = n * n, n3 = n * n2, n4 = n2 * n2;
    constexpr double kScale = 0.9996, kEast = 500'000, kSouth = 10'000'000;
    constexpr double kMeridian = kScale * kAxis / (1 + n) * (1 + n2 / 4 + n4 / 64);
    constexpr std::array kBeta = {n / 2 - 2 * n2 / 3 + 37 * n3 / 96 - n4 / 360,
                                  n2 / 48 + n3 / 15 - 437 * n4 / 1440,
                                  17 * n3 / 480 - 37 * n4 / 840, 4397 * n4 / 161280};
    constexpr std::array kDelta = {2 * n - 2 * n2 / 3 - 2 * n3 + 116 * n4 / 45,
                                   7 * n2 / 3 - 8 * n3 / 5 - 227 * n4 / 45,
                                   56 * n3 / 15 - 136 * n4 / 35, 4279 * n4 / 630};
    const double north = place.y() - (zone.south ? kSouth : 0);
    const std::complex<double> map(north / kMeridian, (place.x() - kEast) / kMeridian);
    std::complex<double> sphere = map;
    for (std::size_t j = 0; j < kBeta.size(); ++j)
        sphere -= kBeta[j] * std::sin(2.0 * static_cast<double>(j + 1) * map);
    const double conformal = std::asin(std::sin(sphere.real()) / std::cosh(sphere.imag()));
    double latitude = conformal;
    for (std::size_t j = 0; j < kDelta.size(); ++j)
        latitude += kDelta[j] * std::sin(2.0 * static_cast<double>(j + 1) * conformal);
    const double meridian = (6.0 * zone.number - 183.0) * kDegree;
    const double longitude =
        meridian + std::atan2(std::sinh(sphere.imag()), std::cos(sphere.real()));
    return earth_centred(latitude, longitude, place.z());
}

void check_known(unsigned epsg) {
    if (is_on_globe(epsg)) return;
    refuse("epsg ", epsg,
           ": expected 4978 (earth-centred), 3857 (web maps), 32601..32660, 32701..32760 (UTM on "
           "WGS 84), 25828..25838 (UTM on ETRS89) or 26901..26923 (UTM on NAD83); reproject other "
           "coordinates first");
}

/// `NAME["title",content,AUTHORITY["EPSG","code"]]`
std::string node(const char* name, const std::string& title, const std::string& content,
                 unsigned epsg) {
    return std::string(name) + "[\"" + title + "\"" + (content.empty() ? "" : "," + content) +
           ",AUTHORITY[\"EPSG\",\"" + std::to_string(epsg) + "\"]]";
}

/// Datum and prime meridian.
std::string datum_text(Datum datum) {
    const std::string meridian = node("PRIMEM", "Greenwich", "0", 8901),
                      sphere_80 = node("SPHEROID", "GRS 1980", "6378137,298.257222101", 7019),
                      sphere_84 = node("SPHEROID", "WGS 84", "6378137,298.257223563", 7030);
    const std::string text =
        datum == Datum::Etrs89
            ? node("DATUM", "European_Terrestrial_Reference_System_1989", sphere_80, 6258)
        : datum == Datum::Nad83 ? node("DATUM", "North_American_Datum_1983", sphere_80, 6269)
                                : node("DATUM", "WGS_1984", sphere_84, 6326);
    return text + ',' + meridian + ',';
}

const char* name_of(Datum datum) noexcept {
    return datum == Datum::Etrs89 ? "ETRS89" : datum == Datum::Nad83 ? "NAD83" : "WGS 84";
}

/// In degrees.
std::string geographic_text(Datum datum) {
    const unsigned epsg = datum == Datum::Etrs89 ? 4258 : datum == Datum::Nad83 ? 4269 : 4326;
    const std::string degree = node("UNIT", "degree", "0.0174532925199433", 9122);
    return node("GEOGCS", name_of(datum), datum_text(datum) + degree, epsg);
}

}  // namespace

bool is_on_globe(unsigned epsg) noexcept {
    return epsg == kEarthCentred || epsg == kWebMercator || zone_of(epsg).number != 0;
}

Eigen::Matrix4d globe_frame(unsigned epsg, const Vec3d& place) {
    check_known(epsg);
    if (!place.allFinite()) refuse("epsg ", epsg, ": the cloud lies at no finite place");
    Eigen::Matrix4d frame = Eigen::Matrix4d::Identity();
    if (epsg == kEarthCentred) return frame;
    const bool is_web = epsg == kWebMercator;
    if (!(place.cwiseAbs().maxCoeff() <= (is_web ? 2.1e7 : 1e7))) {
        refuse("epsg ", epsg, ": the cloud lies beyond ", is_web ? "21,000" : "10,000",
               " km: its coordinates belong to another system");
    }
    const auto on_globe = [is_web, zone = zone_of(epsg)](const Vec3d& at) {
        return is_web ? earth_centred_of_web(at) : earth_centred(zone, at);
    };
    constexpr double kStep = 10;  // metres: what is not linear cancels, what is rounded is small
    for (int axis = 0; axis < 3; ++axis) {
        const Vec3d step = kStep * Vec3d::Unit(axis);
        frame.col(axis).head<3>() = (on_globe(place + step) - on_globe(place - step)) / (2 * kStep);
    }
    frame.col(3).head<3>() = on_globe(place) - frame.topLeftCorner<3, 3>() * place;
    return frame;
}

std::string well_known_text(unsigned epsg) {
    check_known(epsg);
    const std::string metre = node("UNIT", "metre", "1", 9001);
    if (epsg == kEarthCentred) {
        return node("GEOCCS", "WGS 84",
                    datum_text(Datum::Wgs84) + metre +
                        ",AXIS[\"Geocentric X\",OTHER],AXIS[\"Geocentric Y\",OTHER],"
                        "AXIS[\"Geocentric Z\",NORTH]",
                    epsg);
    }
    const std::string axes = metre + ",AXIS[\"Easting\",EAST],AXIS[\"Northing\",NORTH]";
    if (epsg == kWebMercator) {  // which WKT 1 has no word for: as GDAL writes it
        return node(
            "PROJCS", "WGS 84 / Pseudo-Mercator",
            geographic_text(Datum::Wgs84) +
                ",PROJECTION[\"Mercator_1SP\"],PARAMETER[\"central_meridian\",0],"
                "PARAMETER[\"scale_factor\",1],PARAMETER[\"false_easting\",0],"
                "PARAMETER[\"false_northing\",0]," +
                axes +
                ",EXTENSION[\"PROJ4\",\"+proj=merc +a=6378137 +b=6378137 +lat_ts=0 +lon_0=0 "
                "+x_0=0 +y_0=0 +k=1 +units=m +nadgrids=@null +wktext +no_defs\"]",
            epsg);
    }
    const Zone zone = zone_of(epsg);
    const int meridian = 6 * static_cast<int>(zone.number) - 183;
    return node("PROJCS",
                std::string(name_of(zone.datum)) + " / UTM zone " + std::to_string(zone.number) +
                    (zone.south ? "S" : "N"),
                geographic_text(zone.datum) +
                    ",PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"latitude_of_origin\",0],"
                    "PARAMETER[\"central_meridian\"," +
                    std::to_string(meridian) +
                    "],PARAMETER[\"scale_factor\",0.9996],PARAMETER[\"false_easting\",500000],"
                    "PARAMETER[\"false_northing\"," +
                    (zone.south ? "10000000" : "0") + "]," + axes,
                epsg);
}

}  // namespace stipple
