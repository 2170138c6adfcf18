// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace fit {

/// A curve that is linear in some of its parameters: y(x) = sum_j c_j phi_j(x; beta).
struct SeparableModel {
  int linear = 0;     ///< Number of functions phi.
  int nonlinear = 0;  ///< Number of parameters beta.
  /// Fills phi (points x linear) and, if wanted, d phi / d beta_k for each k. Both come sized.
  std::function<void(const Eigen::VectorXd& x, const Eigen::VectorXd& beta, Eigen::MatrixXd& phi,
                     std::vector<Eigen::MatrixXd>* dphi)>
      basis;
  /// Bounds of beta; empty: none.
  Eigen::VectorXd lower, upper;
  /// False where the curve is not allowed (a pole among the points). Absent: allowed everywhere.
  std::function<bool(const Eigen::VectorXd& beta)> feasible;
};

/// Points with weights 1 / u^2.
struct WeightedPoints {
  Eigen::VectorXd x, y, weight;
};

struct SeparableFit {
  enum class End {
    not_run,
    converged,
    at_bound,      ///< Converged with a parameter on its bound.
    not_converged  ///< Stopped by its limit of iterations, or the gradient is not small.
  };
  End end = End::not_run;
  Eigen::VectorXd beta, c;
  double chi2 = -1;      ///< Weighted sum of squared residuals; -1: not run.
  double gradient = -1;  ///< Largest cosine between the residuals and a column of the Jacobian.
  Eigen::MatrixXd
      tangent;  ///< Weighted Jacobian with respect to (c, beta) at the answer, points x parameters.
  Eigen::VectorXd residual;  ///< y - curve, not weighted.
  int iterations = 0;
  [[nodiscard]] bool usable() const { return end == End::converged || end == End::at_bound; }
};

/// Minimises the weighted squares by Levenberg and Marquardt's method over beta alone, with c exact at every
/// step (variable projection; Golub and Pereyra 1973 with Kaufman's 1975 Jacobian). NLopt is not used: from a
/// point this near, its answers are less exact.
[[nodiscard]] SeparableFit solve_separable(const SeparableModel& model, const WeightedPoints& points,
                                           const Eigen::VectorXd& start, int most_iterations = 200);

struct SearchOptions {
  int refined = 3;        ///< Starts, the best after a first look at all, that NLopt refines.
  int polished = 2;       ///< Of these, separate minima that are polished on all points.
  long thin_above = 400;  ///< More points than this are joined in groups while searching.
  long thin_to = 200;     ///< Groups.
};

/// What a search from many starts found; `minima` are separate, best first, polished.
struct SearchResult {
  std::vector<SeparableFit> minima;
  int starts = 0;
  [[nodiscard]] const SeparableFit& best() const { return minima.front(); }
};

/// Looks at the cost of every start (c exact), refines the best by NLopt's SLSQP within the bounds, and
/// polishes them with solve_separable(). Empty `minima` when no start is feasible.
[[nodiscard]] SearchResult search_separable(const SeparableModel& model, const WeightedPoints& points,
                                            const std::vector<Eigen::VectorXd>& starts,
                                            const SearchOptions& options = {});

/// Neighbouring points joined to so many groups: enough to find where minima are, not to say how deep.
[[nodiscard]] WeightedPoints thinned(const WeightedPoints& points, long groups);

/// Inverse of J^T J as a factor: covariance = F F^T, from J's QR with columns scaled to unit length, which
/// keeps twice the digits of the covariance itself. `condition`: ratio of J's largest to its smallest
/// singular value after scaling.
struct CovarianceFactor {
  Eigen::MatrixXd factor;  ///< Parameters x parameters.
  double condition = 0;
};
[[nodiscard]] CovarianceFactor covariance_factor(const Eigen::MatrixXd& weighted_jacobian);

}  // namespace fit
