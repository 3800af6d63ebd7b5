#include "contraction/contraction_quadrics.hpp"

#include "contraction/contraction.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numbers>

// Follows: Pauly, Gross, Kobbelt 2002, §3.2 (planes of edges); Garland and Heckbert 1997 (planes
// that hold a border); Trettner and Kobbelt 2020 (the isotropic term, which grows with how little
// is known of the planes); Hoppe 1999 (gradients of attributes: ours take a feature as constant
// over a survivor's samples, as a splat shows it, and so need no room of their own).

namespace stipple {

bool may_be_on_border(std::span<const Vec3d> neighbors, const Vec3d& normal) noexcept {
    constexpr double kTangent = 0.41421356237309503;  // of a sixteenth of a turn
    const Vec3d u = normal.unitOrthogonal(), v = normal.cross(u);
    std::uint16_t empty = 0xFFFFU;  // sixteenths of the turn, in the order of the angle
    for (const Vec3d& e : neighbors) {
        const double x = u.dot(e), y = v.dot(e), ax = std::abs(x), ay = std::abs(y);
        // Without branches: there is no telling where the next neighbour is.
        const unsigned in_quarter =
            unsigned{ay > kTangent * ax} + unsigned{ay > ax} + unsigned{kTangent * ay >= ax};
        const unsigned mirrored = unsigned{(x < 0) != (y < 0)};
        const unsigned sixteenth = 8 * unsigned{y < 0} + (in_quarter ^ (7 * mirrored));
        empty &= static_cast<std::uint16_t>(~(1U << sixteenth));
    }
    // The gap of a border covers six of them wholly, wherever it begins.
    const auto two = static_cast<std::uint16_t>(empty & std::rotl(empty, 1));
    const auto four = static_cast<std::uint16_t>(two & std::rotl(two, 2));
    return (four & std::rotl(two, 4)) != 0;
}

Tangent with_border(const Vec3d& normal, std::span<const Vec3d> neighbors) {
    constexpr double kBorder = 0.92 * std::numbers::pi, kFilled = std::numbers::pi / 2;
    const Vec3d u = normal.unitOrthogonal(), v = normal.cross(u);
    std::array<double, 65> angles;
    std::size_t count = 0;
    for (const Vec3d& e : neighbors) angles[count++] = std::atan2(v.dot(e), u.dot(e));
    std::sort(angles.begin(), angles.begin() + static_cast<std::ptrdiff_t>(count));
    angles[count] = angles[0] + 2 * std::numbers::pi;
    double widest = 0, second = 0;
    Tangent tangent{normal};
    for (std::size_t i = 0; i < count; ++i) {
        const double gap = angles[i + 1] - angles[i];
        second = std::max(second, std::min(gap, widest));
        if (gap > widest) {
            widest = gap;
            tangent.border_angle = angles[i] + gap / 2;
        }
    }
    tangent.border = widest > kBorder && second < kFilled;
    return tangent;
}

namespace {

constexpr std::uint32_t kSideBits = (1U << 13U) - 1U;
constexpr double kSteps = kSideBits - 1.0;  // even: an axis is itself again

}  // namespace

// The normal lies on an octahedron, unfolded into a square (Meyer et al. 2010), 13 bits a side; the
// angle has 5 bits, and there is one for whether there is a border.
std::uint32_t packed(const Tangent& tangent) noexcept {
    Vec3d n = tangent.normal / tangent.normal.cwiseAbs().sum();
    double x = n.x(), y = n.y();
    if (n.z() < 0) {
        x = std::copysign(1 - std::abs(n.y()), n.x());
        y = std::copysign(1 - std::abs(n.x()), n.y());
    }
    const auto side = [](double value) {
        return static_cast<std::uint32_t>(std::lround((value + 1) / 2 * kSteps));
    };
    const double turns = tangent.border_angle / (2 * std::numbers::pi);
    const auto angle =
        static_cast<std::uint32_t>(std::lround((turns - std::floor(turns)) * 32)) % 32;
    return side(x) | side(y) << 13U | angle << 26U | (tangent.border ? 1U << 31U : 0U);
}

Tangent unpacked(std::uint32_t bits) noexcept {
    const auto side = [](std::uint32_t value) { return value / kSteps * 2 - 1; };
    double x = side(bits & kSideBits), y = side(bits >> 13U & kSideBits);
    const double z = 1 - std::abs(x) - std::abs(y);
    if (z < 0) {
        const double folded = x;
        x = std::copysign(1 - std::abs(y), x);
        y = std::copysign(1 - std::abs(folded), y);
    }
    return {.normal = Vec3d(x, y, z).normalized(),
            .border_angle = (bits >> 26U & 31U) * std::numbers::pi / 16,
            .border = (bits >> 31U) != 0};
}

void add_edges(Quadric& q, std::span<const Vec3d> neighbors, const Tangent& tangent, double area) {
    const double each = area / static_cast<double>(neighbors.size());
    const Vec3d& n = tangent.normal;
    double roughness = 0;
    for (const Vec3d& e : neighbors) {
        const double height = n.dot(e), length_sq = e.squaredNorm();
        const Vec3d across = n * length_sq - e * height;  // b x e
        const double across_sq = across.squaredNorm();
        if (across_sq > 0) add_plane(q, across, Vec3d::Zero(), each / across_sq);
        if (length_sq > 0) roughness += each * height * height / length_sq;
    }
    add_point(q, Vec3d::Zero(), kPointTerm * area + kRoughnessTerm * roughness);
    if (tangent.border) {
        constexpr double kBorderWeight = 0.1;
        const Vec3d u = n.unitOrthogonal(), v = n.cross(u);
        const Vec3d out = std::cos(tangent.border_angle) * u + std::sin(tangent.border_angle) * v;
        add_plane(q, out, Vec3d::Zero(), kBorderWeight * area);
    }
}

void add_gradients(Quadric& q, std::span<const Vec3d> neighbors, std::span<const float> steps,
                   unsigned channels, const Vec3d& normal, double area) {
    const Vec3d u = normal.unitOrthogonal(), v = normal.cross(u);
    double uu = 0, uv = 0, vv = 0;
    for (const Vec3d& e : neighbors) {
        const double x = u.dot(e), y = v.dot(e);
        uu += x * x;
        uv += x * y;
        vv += y * y;
    }
    const double determinant = uu * vv - uv * uv;
    constexpr double kSingular = 1e-6;
    if (!(determinant > kSingular * uu * vv)) return;
    for (unsigned channel = 0; channel < channels; ++channel) {
        double su = 0, sv = 0;
        for (std::size_t i = 0; i < neighbors.size(); ++i) {
            const auto step = static_cast<double>(steps[i * channels + channel]);
            su += step * u.dot(neighbors[i]);
            sv += step * v.dot(neighbors[i]);
        }
        const Vec3d gradient = ((su * vv - sv * uv) * u + (sv * uu - su * uv) * v) / determinant;
        add_plane(q, gradient, Vec3d::Zero(), area);
    }
}

}  // namespace stipple
