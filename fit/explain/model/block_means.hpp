// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <vector>

#include "fit/explain/model/autoregression.hpp"

namespace fit::explain::model {

/// Rows that are independent but for the mean of every block, which is profiled out: another channel has it.
/// Noise of the rows of a block, one after the other, may be remembered.
struct BlockMeans {
  Eigen::VectorXd weight;  ///< Of every row: one over its standard deviation.
  std::vector<std::vector<Eigen::Index>> blocks;

  std::vector<RememberedNoise> noise = {};  ///< Of every block; empty: of all it is white.

  /// Columns (rows x any) divided by their noise, less what their blocks' means explain.
  void whiten(Eigen::MatrixXd& columns) const {
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      const std::vector<Eigen::Index>& block = blocks[b];
      Eigen::VectorXd mean = weight(block), values(mean.size());
      make_white(b, mean);
      mean.normalize();
      for (Eigen::Index k = 0; k < columns.cols(); ++k) {
        for (std::size_t i = 0; i < block.size(); ++i)
          values[static_cast<Eigen::Index>(i)] = weight[block[i]] * columns(block[i], k);
        make_white(b, values);
        values -= mean * mean.dot(values);
        for (std::size_t i = 0; i < block.size(); ++i)
          columns(block[i], k) = values[static_cast<Eigen::Index>(i)];
      }
    }
  }

 private:
  void make_white(std::size_t block, Eigen::VectorXd& values) const {
    if (!noise.empty()) noise[block].whiten(values);
  }
};

}  // namespace fit::explain::model
