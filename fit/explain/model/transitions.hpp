// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

#include "fit/explain/reduce.hpp"
#include "fit/explain/seen_edges.hpp"
#include "fit/explain/spread.hpp"

namespace fit::explain::model {

/// The beams beside one edge while stage and targets stood as they were, and what they say of the angle over
/// which the farther surface takes over. The edge's place is a nuisance of each such stand, integrated over:
/// whatever moves it (mount, target, stage, placement) shows as beams that see one surface or the other,
/// never as a beam that sees both.
class Transition {
 public:
  /// Beams without width, deg^2: shares change from one beam to the next.
  static constexpr double hard_deg2 = 0.004 * 0.004;

  Transition(int capture, const Circumstances& at, std::vector<Beside> beams);

  [[nodiscard]] int capture() const { return capture_; }
  [[nodiscard]] const Circumstances& at() const { return at_; }
  [[nodiscard]] const std::vector<Beside>& beams() const { return beams_; }
  /// Log-likelihood of beams whose angles scatter by that variance, and its derivative.
  [[nodiscard]] double log_likelihood(double variance_deg2) const;
  [[nodiscard]] double score(double variance_deg2) const;
  /// Of the variance: the likelihood's curvature, or that of the parabola of its slope and height.
  [[nodiscard]] double information(double variance_deg2) const;
  /// The least variance among the most likely ones.
  [[nodiscard]] double best_deg2() const;
  /// Samples between the two surfaces, of beams that may meet both; none beside a surface that stands
  /// elsewhere than predicted.
  [[nodiscard]] double between() const;
  /// Where beams that wide have the edge, from where the bench has it.
  [[nodiscard]] double place_deg(double variance_deg2) const;

 private:
  int capture_;
  Circumstances at_;
  std::vector<Beside> beams_;
  std::vector<double> likelihood_, slope_;  ///< Over the logarithm of the variance.
};

/// All edges of a session with beams on both sides.
[[nodiscard]] std::vector<Transition> transitions(const Reduced& reduced);

/// The variance that explains most of all of them, deg^2; `hard_deg2` where none has a width.
[[nodiscard]] double pooled_deg2(const std::vector<Transition>& all);

/// Shares of the farther surface along the angle from every edge: as recorded, and as beams of those widths
/// have them.
[[nodiscard]] SpreadCurve shares_along(const std::vector<Transition>& all, const Eigen::VectorXd& before_deg2,
                                       const Eigen::VectorXd& after_deg2);

}  // namespace fit::explain::model
