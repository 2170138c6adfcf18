// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Dense>

namespace fit::explain::model {

/// Neighbouring rows of unit noise that also share errors drawn once for all of them: covariance I + z z'.
class SharedErrors {
 public:
  /// z: a row for each row, a column (its standard deviation there) for each error.
  SharedErrors(Eigen::Index first, Eigen::MatrixXd z);
  /// Divides their part of the columns by the square root of the covariance.
  void whiten(Eigen::MatrixXd& columns) const;

 private:
  Eigen::Index first_;
  Eigen::MatrixXd z_, shrink_;
};

}  // namespace fit::explain::model
