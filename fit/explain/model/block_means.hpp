// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <vector>

namespace fit::explain::model {

/// Rows that are independent but for the mean of every block, which is profiled out: another channel has it.
struct BlockMeans {
  Eigen::VectorXd weight;  ///< Of every row: one over its standard deviation.
  std::vector<std::vector<Eigen::Index>> blocks;

  /// Columns (rows x any) less their blocks' weighted means, times the weights.
  void whiten(Eigen::MatrixXd& columns) const {
    for (Eigen::Index k = 0; k < columns.cols(); ++k)
      for (const std::vector<Eigen::Index>& block : blocks) {
        double sum = 0, all = 0;
        for (const Eigen::Index i : block) {
          sum += weight[i] * weight[i] * columns(i, k);
          all += weight[i] * weight[i];
        }
        for (const Eigen::Index i : block) columns(i, k) = weight[i] * (columns(i, k) - sum / all);
      }
  }
};

}  // namespace fit::explain::model
