// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "fit/numeric/curve_point.hpp"

namespace fit {

/// Natural cubic smoothing spline; its penalty by generalised cross-validation. Used by the family of that
/// name.
class SmoothingSpline {
 public:
  SmoothingSpline(std::span<const CurvePoint> points, int most_knots = 24);
  [[nodiscard]] double value(double x) const;
  [[nodiscard]] double u(double x) const;  ///< For unit weights scale; see FamilyFit::widening.
  [[nodiscard]] double effective_parameters() const { return effective_; }
  [[nodiscard]] const std::vector<double>& knots() const { return knots_; }
  [[nodiscard]] const Eigen::VectorXd& values() const { return values_; }
  [[nodiscard]] const Eigen::MatrixXd& factor() const { return factor_; }

 private:
  [[nodiscard]] Eigen::RowVectorXd weights_at(double x) const;
  std::vector<double> knots_;
  Eigen::MatrixXd second_;  ///< Second derivatives at the knots = second_ * values.
  Eigen::VectorXd values_;
  Eigen::MatrixXd factor_;
  double effective_ = 0;
};

}  // namespace fit
