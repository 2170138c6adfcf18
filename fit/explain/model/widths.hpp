// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "fit/explain/model/channel.hpp"

namespace fit::explain::model {

/// Log-likelihood of an angular width, tabulated over the logarithm of its variance.
class WidthLikelihood {
 public:
  /// No width at all, deg^2: what is beside an edge changes from one beam to the next.
  static constexpr double hard_deg2 = 0.002 * 0.002;

  explicit WidthLikelihood(const std::function<double(double width_deg)>& log_likelihood);

  /// And its derivative by the variance.
  [[nodiscard]] double log_likelihood(double variance_deg2) const;
  [[nodiscard]] double score(double variance_deg2) const;
  /// Of the variance: the likelihood's curvature, or that of the parabola of its slope and height.
  [[nodiscard]] double information(double variance_deg2) const;
  /// The least variance among the most likely ones.
  [[nodiscard]] double best_deg2() const;

 private:
  std::vector<double> likelihood_, slope_;
};

/// The same of captures in turn, each given those before: takes the log-likelihoods of all at a width.
[[nodiscard]] std::vector<WidthLikelihood> in_turn(
    std::size_t captures, const std::function<std::vector<double>(double width_deg)>& log_likelihoods);

/// What one edge says of a width while stage and targets stand.
struct WidthRow {
  Circumstances at;
  int capture = 0;
  WidthLikelihood width;
};

/// The variance that explains most of all of them, deg^2; `hard_deg2` where none has a width.
[[nodiscard]] double pooled_deg2(const std::vector<WidthRow>& rows);
/// The largest that explains them nearly as well: two standard uncertainties up.
[[nodiscard]] double widest_deg2(const std::vector<WidthRow>& rows);

/// A channel of such rows. Its predictor is a variance, deg^2.
class WidthRows : public IndependentRows {
 public:
  [[nodiscard]] double offset(Eigen::Index) const override { return WidthLikelihood::hard_deg2; }
  [[nodiscard]] Eigen::VectorXd expansion_for_new_terms(const Eigen::VectorXd& eta) const override {
    return eta.cwiseMax(raised_);
  }
  [[nodiscard]] Eigen::VectorXd feasible(Eigen::VectorXd eta) const override {
    return eta.cwiseMax(WidthLikelihood::hard_deg2);
  }

 protected:
  explicit WidthRows(std::vector<WidthRow> rows);

  [[nodiscard]] double log_likelihood(Eigen::Index row, double eta) const override {
    return width(row).log_likelihood(eta);
  }
  [[nodiscard]] double score(Eigen::Index row, double eta) const override { return width(row).score(eta); }
  [[nodiscard]] double information(Eigen::Index row, double eta) const override {
    return width(row).information(eta);
  }

 private:
  [[nodiscard]] const WidthLikelihood& width(Eigen::Index row) const {
    return widths_[static_cast<std::size_t>(row)].width;
  }
  [[nodiscard]] double fair_place() const;

  std::vector<WidthRow> widths_;
  double raised_;
};

}  // namespace fit::explain::model
