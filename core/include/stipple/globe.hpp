#pragma once

#include "stipple/point_cloud.hpp"

#include <string>

namespace stipple {

/// Whether `globe_frame` knows the coordinate reference system with this EPSG number: 4978
/// (earth-centred), 3857 (web maps), 32601..32660 and 32701..32760 (UTM on WGS 84, north and
/// south), 25828..25838 (UTM on ETRS89), 26901..26923 (UTM on NAD83). All are in metres, with
/// heights above the ellipsoid.
bool is_on_globe(unsigned epsg) noexcept;

/// The affine map from coordinates of a system to earth-centred ones (EPSG:4978, metres) that is
/// exact at `place` and has the right directions and scales there: it places a cloud on the globe,
/// upright and facing the north of its map. D metres from the place it is off by about D^2 / 13,000
/// km, the curvature of the earth: 8 cm at 1 km; of web maps by more towards the poles.
///
/// ETRS89 and NAD83 are treated as WGS 84, from which the first drifts by 2.5 cm a year, and the
/// second differs by one to two metres.
/// @throws Error(InvalidArgument) for an unknown system, or a place that is not finite or farther
/// than 10,000 km (web maps: 21,000 km) from the origin of a map.
Eigen::Matrix4d globe_frame(unsigned epsg, const Vec3d& place);

/// A system as written in files: Well-Known Text 1 (OGC 01-009).
/// @throws Error(InvalidArgument) for an unknown system.
std::string well_known_text(unsigned epsg);

}  // namespace stipple
