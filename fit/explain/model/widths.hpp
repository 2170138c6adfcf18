// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <vector>

#include "fit/explain/model/channel.hpp"

namespace fit::explain::model {

/// Log-likelihood of an angular width, tabulated over the logarithm of its variance.
class WidthLikelihood {
 public:
  /// No width at all, deg^2: what is beside an edge changes from one beam to the next.
  static constexpr double hard_deg2 = 0.004 * 0.004;

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
class WidthRows : public ChannelRows {
 public:
  [[nodiscard]] Eigen::Index rows() const override { return static_cast<Eigen::Index>(list_.size()); }
  [[nodiscard]] const Circumstances& at(Eigen::Index row) const override { return of(row).at; }
  [[nodiscard]] int capture(Eigen::Index row) const override { return of(row).capture; }
  [[nodiscard]] const Columns& base() const override { return base_; }
  [[nodiscard]] double offset(Eigen::Index) const override { return WidthLikelihood::hard_deg2; }
  [[nodiscard]] double statistic(Eigen::Index row) const override { return of(row).width.best_deg2(); }
  [[nodiscard]] double log_likelihood(const Eigen::VectorXd& eta) const override {
    return log_likelihoods(eta).sum();
  }
  [[nodiscard]] Eigen::VectorXd log_likelihoods(const Eigen::VectorXd& eta) const override;
  [[nodiscard]] Eigen::VectorXd raised(const Eigen::VectorXd& eta) const override {
    return eta.cwiseMax(raised_);
  }
  [[nodiscard]] Eigen::VectorXd possible(Eigen::VectorXd eta) const override {
    return eta.cwiseMax(WidthLikelihood::hard_deg2);
  }
  [[nodiscard]] Eigen::MatrixXd whitened(Eigen::MatrixXd columns, const Eigen::VectorXd& eta) const override;
  [[nodiscard]] Eigen::VectorXd white_residual(const Eigen::VectorXd& eta) const override;

 protected:
  explicit WidthRows(std::vector<WidthRow> rows);

 private:
  [[nodiscard]] const WidthRow& of(Eigen::Index row) const { return list_[static_cast<std::size_t>(row)]; }
  [[nodiscard]] Eigen::VectorXd each(const Eigen::VectorXd& eta,
                                     double (WidthLikelihood::*of_one)(double) const) const;
  [[nodiscard]] double fair_place() const;

  std::vector<WidthRow> list_;
  double raised_;
  Columns base_;
};

}  // namespace fit::explain::model
