#pragma once

#include "stipple/point_cloud.hpp"

namespace stipple {

/// CIE L*a*b* (illuminant D65, 2 degrees) of linear sRGB components in [0, 1].
Vec3d lab_from_linear(const Vec3d& rgb) noexcept;

/// CIEDE2000 colour difference of two L*a*b* colours (CIE 142-2001; Sharma, Wu, Dalal 2005). About
/// 1 is just noticeable, black and white are 100 apart.
double ciede2000(const Vec3d& lab_a, const Vec3d& lab_b) noexcept;

}  // namespace stipple
