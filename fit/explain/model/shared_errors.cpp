// SPDX-License-Identifier: MIT
#include "fit/explain/model/shared_errors.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace fit::explain::model {

/// (I + z z')^(-1/2) = I - z (V f(L) V') z', where z' z = V L V' and f(l) = (1 - (1 + l)^(-1/2)) / l.
SharedErrors::SharedErrors(Eigen::Index first, Eigen::MatrixXd z) : first_(first), z_(std::move(z)) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(z_.transpose() * z_);
  const Eigen::VectorXd f = eigen.eigenvalues().unaryExpr([](double l) {
    const double lambda = std::max(0.0, l);
    return lambda > 1e-12 ? (1 - 1 / std::sqrt(1 + lambda)) / lambda : 0;
  });
  shrink_ = eigen.eigenvectors() * f.asDiagonal() * eigen.eigenvectors().transpose();
}

void SharedErrors::whiten(Eigen::MatrixXd& columns) const {
  auto rows = columns.middleRows(first_, z_.rows());
  rows -= z_ * (shrink_ * (z_.transpose() * rows).eval());
}

}  // namespace fit::explain::model
