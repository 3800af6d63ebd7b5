#include "support/eigen_system.hpp"

#include <Eigen/Eigenvalues>

namespace stipple::test {

EigenSystem eigen_system(const Eigen::Matrix3d& symmetric) {
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(symmetric);
    return {solver.eigenvalues(), solver.eigenvectors()};
}

}  // namespace stipple::test
