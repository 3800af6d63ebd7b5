#pragma once

#include "quadric.hpp"
#include "stipple/point_cloud.hpp"

#include <optional>
#include <span>

namespace stipple {

/// The normal of a sample (§2.1) from the offsets of those around it; an offset may be there more
/// than once. Any unit vector where they do not span a plane.
Vec3d normal_from(std::span<const Vec3d> around) noexcept;

/// Adds the planes of §3.2, spanned by the edges e_i and b_i = e_i x n to the neighbours at the
/// offsets -e_i, of the weight `area` all together; and `kPointTerm` of it for the point itself.
void add_edges(Quadric& q, std::span<const Vec3d> neighbors, const Vec3d& normal, double area);

/// Whether two octants side by side of the tangent plane are empty, as beside a border: a quick
/// test that is true of few others.
bool has_empty_quarter(std::span<const Vec3d> around, const Vec3d& normal) noexcept;

/// Adds a plane through the sample that keeps it from leaving the border of a surface, if it lies
/// on one: if the samples around it leave half of the tangent plane empty, or nearly so.
/// @param around  offsets, at most 64; enough of them that no chance leaves such a gap.
void add_border(Quadric& q, std::span<const Vec3d> around, const Vec3d& normal, double area);

/// Adds (g'y)^2 for the gradient g of each of `channels` features, which is what moving the sample
/// changes it by: least squares over the neighbours in the tangent plane.
/// @param steps  the features of each neighbour less the sample's own.
void add_gradients(Quadric& q, std::span<const Vec3d> neighbors, std::span<const float> steps,
                   unsigned channels, const Vec3d& normal, double area);

}  // namespace stipple
