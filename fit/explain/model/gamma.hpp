// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "fit/explain/model/channel.hpp"

namespace fit::explain::model {

/// Mean squares: a gamma distribution of shape n/2 around the predictor, a variance to which independent
/// causes add to what is expected.
class GammaRows : public IndependentRows {
 public:
  [[nodiscard]] double offset(Eigen::Index row) const override { return of(row).expected; }
  [[nodiscard]] Eigen::VectorXd expansion_for_new_terms(const Eigen::VectorXd& eta) const override {
    double ratio = 0, all = 0;
    for (Eigen::Index i = 0; i < rows(); ++i) {
      ratio += of(i).n * of(i).y / possible_one(eta[i]);
      all += of(i).n;
    }
    return eta * std::max(1.0, ratio / all);
  }

 protected:
  /// No variance is less than that one.
  GammaRows(std::vector<Row> rows, double least) : IndependentRows(std::move(rows)), least_(least) {}

  [[nodiscard]] double log_likelihood(Eigen::Index row, double eta) const override {
    const double v = possible_one(eta);
    return -of(row).n / 2 * (std::log(v) + of(row).y / v);
  }
  [[nodiscard]] double score(Eigen::Index row, double eta) const override {
    const double v = possible_one(eta);
    return of(row).n / 2 * (of(row).y - v) / (v * v);
  }
  [[nodiscard]] double information(Eigen::Index row, double eta) const override {
    const double v = possible_one(eta);
    return of(row).n / (2 * v * v);
  }

 private:
  [[nodiscard]] double possible_one(double variance) const { return std::max(least_, variance); }
  double least_;
};

}  // namespace fit::explain::model
