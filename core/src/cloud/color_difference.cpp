#include "cloud/color_difference.hpp"

#include <cmath>
#include <numbers>

namespace stipple {

namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

/// Hue angle in degrees, [0, 360); 0 for grey.
double hue(double a, double b) noexcept {
    if (a == 0 && b == 0) return 0;
    const double angle = std::atan2(b, a) / kDegree;
    return angle < 0 ? angle + 360.0 : angle;
}

double pow7(double v) noexcept {
    const double v2 = v * v;
    return v2 * v2 * v2 * v;
}

}  // namespace

Vec3d lab_from_linear(const Vec3d& rgb) noexcept {
    // IEC 61966-2-1, rows divided by the white point.
    const double x = (0.4124 * rgb.x() + 0.3576 * rgb.y() + 0.1805 * rgb.z()) / 0.9505;
    const double y = 0.2126 * rgb.x() + 0.7152 * rgb.y() + 0.0722 * rgb.z();
    const double z = (0.0193 * rgb.x() + 0.1192 * rgb.y() + 0.9505 * rgb.z()) / 1.0890;
    const auto f = [](double t) {
        constexpr double kDelta = 6.0 / 29.0;
        return t > kDelta * kDelta * kDelta ? std::cbrt(t)
                                            : t / (3.0 * kDelta * kDelta) + 4.0 / 29.0;
    };
    return {116.0 * f(y) - 16.0, 500.0 * (f(x) - f(y)), 200.0 * (f(y) - f(z))};
}

// The names and steps are those of Sharma et al., with k_L = k_C = k_H = 1.
double ciede2000(const Vec3d& lab_a, const Vec3d& lab_b) noexcept {
    const double L1 = lab_a.x(), L2 = lab_b.x();
    const double C_mean =
        (std::hypot(lab_a.y(), lab_a.z()) + std::hypot(lab_b.y(), lab_b.z())) / 2.0;
    const double k25_7 = pow7(25.0);
    const double G = 0.5 * (1.0 - std::sqrt(pow7(C_mean) / (pow7(C_mean) + k25_7)));
    const double a1 = (1.0 + G) * lab_a.y(), a2 = (1.0 + G) * lab_b.y();
    const double C1 = std::hypot(a1, lab_a.z()), C2 = std::hypot(a2, lab_b.z());
    const double h1 = hue(a1, lab_a.z()), h2 = hue(a2, lab_b.z());

    const bool grey = C1 * C2 == 0;
    double dh = grey ? 0.0 : h2 - h1;
    if (dh > 180.0) dh -= 360.0;
    if (dh < -180.0) dh += 360.0;
    const double dL = L2 - L1, dC = C2 - C1;
    const double dH = 2.0 * std::sqrt(C1 * C2) * std::sin(dh / 2.0 * kDegree);

    const double L = (L1 + L2) / 2.0, C = (C1 + C2) / 2.0;
    double h = h1 + h2;
    if (!grey) {
        if (std::abs(h1 - h2) > 180.0) h += h < 360.0 ? 360.0 : -360.0;
        h /= 2.0;
    }
    const double T =
        1.0 - 0.17 * std::cos((h - 30.0) * kDegree) + 0.24 * std::cos(2.0 * h * kDegree) +
        0.32 * std::cos((3.0 * h + 6.0) * kDegree) - 0.20 * std::cos((4.0 * h - 63.0) * kDegree);
    const double turn = 30.0 * std::exp(-((h - 275.0) / 25.0) * ((h - 275.0) / 25.0));
    const double R_C = 2.0 * std::sqrt(pow7(C) / (pow7(C) + k25_7));
    const double from_50 = (L - 50.0) * (L - 50.0);
    const double S_L = 1.0 + 0.015 * from_50 / std::sqrt(20.0 + from_50);
    const double S_C = 1.0 + 0.045 * C, S_H = 1.0 + 0.015 * C * T;
    const double R_T = -std::sin(2.0 * turn * kDegree) * R_C;
    const double l = dL / S_L, c = dC / S_C, hh = dH / S_H;
    return std::sqrt(l * l + c * c + hh * hh + R_T * c * hh);
}

}  // namespace stipple
