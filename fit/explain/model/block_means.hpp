// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <vector>

namespace fit::explain::model {

/// Rows that are independent but for the mean of every block, which is profiled out: another channel has it.
struct BlockMeans {
  Eigen::VectorXd weight;  ///< Of every row: one over its standard deviation.
  std::vector<std::vector<Eigen::Index>> blocks;

  /// Columns (rows x any) divided by their noise, less what their blocks' means explain.
  void whiten(Eigen::MatrixXd& columns) const {
    for (const std::vector<Eigen::Index>& block : blocks) {
      Eigen::VectorXd mean = weight(block), values(mean.size());
      mean.normalize();
      for (Eigen::Index k = 0; k < columns.cols(); ++k) {
        for (std::size_t i = 0; i < block.size(); ++i)
          values[static_cast<Eigen::Index>(i)] = weight[block[i]] * columns(block[i], k);
        values -= mean * mean.dot(values);
        for (std::size_t i = 0; i < block.size(); ++i)
          columns(block[i], k) = values[static_cast<Eigen::Index>(i)];
      }
    }
  }
};

}  // namespace fit::explain::model
