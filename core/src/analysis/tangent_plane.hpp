#pragma once

#include "base/symmetric_eigen.hpp"
#include "stipple/point_cloud.hpp"

#include <span>

namespace stipple {

/// The sum of d d^T over a sample and its neighbours, with d their ways from the mean of all, by
/// the offsets of the neighbours.
Symmetric3 scatter_of(std::span<const Vec3d> neighbors) noexcept;

/// The tangent plane (§2.1) of a sample by the offsets of its neighbours; any where they do not
/// span one.
Vec3d normal_from(std::span<const Vec3d> neighbors) noexcept;

}  // namespace stipple
