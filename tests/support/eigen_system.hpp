#pragma once

#include "stipple/point_cloud.hpp"

// Eigen's solver takes seconds to compile: one source has it for all tests.
namespace stipple::test {

/// Eigenvalues of a symmetric matrix, ascending, and the unit vectors to them, as columns.
struct EigenSystem {
    Vec3d values;
    Eigen::Matrix3d vectors;
};
EigenSystem eigen_system(const Eigen::Matrix3d& symmetric);

}  // namespace stipple::test
