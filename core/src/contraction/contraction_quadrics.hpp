#pragma once

#include "contraction/quadric.hpp"
#include "stipple/point_cloud.hpp"

#include <cstdint>
#include <span>

namespace stipple {

/// What is known of the surface at a sample before its quadric is made.
struct Tangent {
    Vec3d normal;             ///< unit
    double border_angle = 0;  ///< in the tangent plane, where the surface ends, if it does
    bool border = false;      ///< whether it does
};

/// Whether the neighbours leave so wide an angle of the tangent plane empty that it has to be
/// looked at closely: a quick test that is true of every sample on a border, and of few others.
bool may_be_on_border(std::span<const Vec3d> neighbors, const Vec3d& normal) noexcept;

/// Looks for the border of a surface: neighbours that leave half of the tangent plane empty, or
/// nearly so, and fill the other half, as those on a line do not.
/// @param neighbors  at most 64; enough of them that no chance leaves such a gap.
Tangent with_border(const Vec3d& normal, std::span<const Vec3d> neighbors);

/// A tangent in 32 bits: the normal to 0.0005, and exact along an axis; the angle to 6 degrees.
std::uint32_t packed(const Tangent& tangent) noexcept;
Tangent unpacked(std::uint32_t bits) noexcept;

/// Adds the planes of §3.2, spanned by the edges e_i and b_i = e_i x n to the neighbours at the
/// offsets -e_i, of the weight `area` all together; `kPointTerm` of it, and `kRoughnessTerm` of it
/// times the mean squared sine of the edges' slopes to the tangent plane, for the point itself; and
/// where there is a border, a plane that keeps the sample from leaving it.
void add_edges(Quadric& q, std::span<const Vec3d> neighbors, const Tangent& tangent, double area);

/// Adds (g'y)^2 for the gradient g of each of `channels` features, which is what moving the sample
/// changes it by: least squares over the neighbours in the tangent plane.
/// @param steps  the features of each neighbour less the sample's own.
void add_gradients(Quadric& q, std::span<const Vec3d> neighbors, std::span<const float> steps,
                   unsigned channels, const Vec3d& normal, double area);

}  // namespace stipple
