// SPDX-License-Identifier: MIT
#include "fit/explain/model/shared_errors.hpp"

#include <algorithm>
#include <array>
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
  constexpr Eigen::Index few = 2;  // for which products of matrices do not pay
  if (z_.cols() > few) {
    auto rows = columns.middleRows(first_, z_.rows());
    rows -= z_ * (shrink_ * (z_.transpose() * rows).eval());
    return;
  }
  for (Eigen::Index k = 0; k < columns.cols(); ++k) {
    auto rows = columns.col(k).segment(first_, z_.rows());
    std::array<double, few> along{};
    for (Eigen::Index j = 0; j < z_.cols(); ++j) along[static_cast<std::size_t>(j)] = z_.col(j).dot(rows);
    for (Eigen::Index j = 0; j < z_.cols(); ++j) {
      double by = 0;
      for (Eigen::Index l = 0; l < z_.cols(); ++l) by += shrink_(j, l) * along[static_cast<std::size_t>(l)];
      rows -= by * z_.col(j);
    }
  }
}

}  // namespace fit::explain::model
