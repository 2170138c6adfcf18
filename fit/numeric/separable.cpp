// SPDX-License-Identifier: MIT
#include "fit/numeric/separable.hpp"

#include <nlopt.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>

#include "fit/numeric/dense.hpp"

namespace fit {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double infinity = std::numeric_limits<double>::infinity();

/// One evaluation of the projected problem: c is exact, and with it the residuals and their Jacobian.
class Projection {
 public:
  Projection(const SeparableModel& model, const WeightedPoints& points)
      : model_(model),
        points_(points),
        root_weight_(points.weight.cwiseSqrt()),
        target_(points.y.cwiseProduct(root_weight_)),
        phi_(points.x.size(), model.linear),
        qr_(points.x.size(), model.linear) {
    dphi_.assign(static_cast<std::size_t>(model.nonlinear), MatrixXd(points.x.size(), model.linear));
    jacobian_.resize(points.x.size(), model.nonlinear);
  }

  /// The cost, or infinity where the curve is not allowed or not finite.
  double evaluate(const VectorXd& beta, bool with_jacobian) {
    if (model_.feasible && !model_.feasible(beta)) return infinity;
    model_.basis(points_.x, beta, phi_, with_jacobian ? &dphi_ : nullptr);
    phi_.array().colwise() *= root_weight_.array();
    scale_ = phi_.colwise().norm().transpose();
    if (!scale_.allFinite()) return infinity;
    for (Index j = 0; j < scale_.size(); ++j)
      if (scale_[j] <= 0) scale_[j] = 1;
    qr_.compute(phi_ * scale_.cwiseInverse().asDiagonal());
    const Index m = model_.linear;
    rotated_ = target_;
    rotated_.applyOnTheLeft(qr_.householderQ().adjoint());
    scaled_c_ = VectorXd::Zero(m);
    const auto r = qr_.matrixQR().topLeftCorner(m, m).template triangularView<Eigen::Upper>();
    // A column that the others make up adds nothing; giving it no share keeps the cost right.
    if (qr_.matrixQR().diagonal().cwiseAbs().head(m).minCoeff() > 1e-13) {
      scaled_c_ = r.solve(rotated_.head(m));
      residual_ = target_;
      residual_.noalias() -= phi_ * scaled_c_.cwiseQuotient(scale_);
    } else {
      const Eigen::ColPivHouseholderQR<MatrixXd> pivoted(phi_ * scale_.cwiseInverse().asDiagonal());
      scaled_c_ = pivoted.solve(target_);
      residual_ = target_ - phi_ * scaled_c_.cwiseQuotient(scale_);
    }
    const double cost = residual_.squaredNorm();
    if (with_jacobian) fill_jacobian();
    return std::isfinite(cost) ? cost : infinity;
  }

  [[nodiscard]] VectorXd c() const { return scaled_c_.cwiseQuotient(scale_); }
  [[nodiscard]] const VectorXd& residual() const { return residual_; }
  /// Kaufman's: - (1 - phi phi^+) (d phi / d beta) c.
  [[nodiscard]] const MatrixXd& jacobian() const { return jacobian_; }
  /// Of its columns before they were projected.
  [[nodiscard]] const VectorXd& lengths() const { return lengths_; }
  /// The whole weighted Jacobian with respect to (c, beta).
  [[nodiscard]] MatrixXd tangent() const {
    MatrixXd out(phi_.rows(), model_.linear + model_.nonlinear);
    out.leftCols(model_.linear) = phi_;
    const VectorXd at = c();
    for (Index k = 0; k < model_.nonlinear; ++k)
      out.col(model_.linear + k) = (dphi_[static_cast<std::size_t>(k)] * at).cwiseProduct(root_weight_);
    return out;
  }
  [[nodiscard]] VectorXd plain_residual() const { return residual_.cwiseQuotient(root_weight_); }

 private:
  void fill_jacobian() {
    const VectorXd at = c();
    for (Index k = 0; k < model_.nonlinear; ++k)
      jacobian_.col(k) = -(dphi_[static_cast<std::size_t>(k)] * at).cwiseProduct(root_weight_);
    if (model_.nonlinear == 0) return;
    lengths_ = jacobian_.colwise().norm().transpose();
    jacobian_.applyOnTheLeft(qr_.householderQ().adjoint());
    jacobian_.topRows(model_.linear).setZero();
    jacobian_.applyOnTheLeft(qr_.householderQ());
  }

  const SeparableModel& model_;
  const WeightedPoints& points_;
  VectorXd root_weight_, target_, rotated_, scaled_c_, residual_, scale_, lengths_;
  MatrixXd phi_, jacobian_;
  std::vector<MatrixXd> dphi_;
  Eigen::HouseholderQR<MatrixXd> qr_;
};

VectorXd within(const SeparableModel& model, VectorXd beta) {
  if (model.lower.size()) beta = beta.cwiseMax(model.lower);
  if (model.upper.size()) beta = beta.cwiseMin(model.upper);
  return beta;
}

/// A parameter on its bound that the gradient would push beyond it stays there.
std::vector<bool> held(const SeparableModel& model, const VectorXd& beta, const VectorXd& gradient) {
  std::vector<bool> out(static_cast<std::size_t>(beta.size()), false);
  for (Index k = 0; k < beta.size(); ++k) {
    const bool low = model.lower.size() && beta[k] <= model.lower[k] && gradient[k] > 0;
    const bool high = model.upper.size() && beta[k] >= model.upper[k] && gradient[k] < 0;
    out[static_cast<std::size_t>(k)] = low || high;
  }
  return out;
}

/// Against the columns before projection: where one lies wholly in the span of the linear part, the cost is
/// flat.
double largest_cosine(const Projection& projection, const std::vector<bool>& hold) {
  const MatrixXd& jacobian = projection.jacobian();
  const VectorXd& residual = projection.residual();
  double largest = 0;
  const double length = residual.norm();
  for (Index k = 0; k < jacobian.cols(); ++k) {
    const double column = projection.lengths()[k];
    if (hold[static_cast<std::size_t>(k)] || column <= 0 || length <= 0) continue;
    largest = std::max(largest, std::abs(jacobian.col(k).dot(residual)) / (column * length));
  }
  return largest;
}

struct Descent {
  VectorXd beta;
  double cost = infinity;
  bool converged = false, at_bound = false;
  double gradient = -1;
  int iterations = 0;
};

/// Whether a descent that stopped stopped at a minimum: inside, or against a bound or a forbidden region.
Descent judged(Projection& projection, const SeparableModel& model, Descent now, bool blocked) {
  projection.evaluate(now.beta, true);
  const auto hold = held(model, now.beta, projection.jacobian().transpose() * projection.residual());
  now.gradient = largest_cosine(projection, hold);
  now.at_bound = blocked || std::ranges::find(hold, true) != hold.end();
  now.converged = blocked || now.gradient < 1e-5;
  return now;
}

Descent descend(Projection& projection, const SeparableModel& model, const WeightedPoints& points,
                const VectorXd& start, int most_iterations) {
  Descent now;
  now.beta = within(model, start);
  now.cost = projection.evaluate(now.beta, true);
  if (!std::isfinite(now.cost)) return now;
  const double nothing = 1e-26 * points.y.cwiseAbs2().dot(points.weight);
  double damping = 1e-3;
  for (now.iterations = 0; now.iterations < most_iterations; ++now.iterations) {
    const MatrixXd& jacobian = projection.jacobian();
    const VectorXd gradient = jacobian.transpose() * projection.residual();
    const std::vector<bool> hold = held(model, now.beta, gradient);
    now.at_bound = std::ranges::find(hold, true) != hold.end();
    now.gradient = largest_cosine(projection, hold);
    if (now.gradient < 1e-11 || now.cost <= nothing) {
      now.converged = true;
      return now;
    }
    MatrixXd normal = jacobian.transpose() * jacobian;
    VectorXd slope = -gradient;
    VectorXd size = normal.diagonal().cwiseMax(1e-300);
    for (Index k = 0; k < size.size(); ++k) {
      if (!hold[static_cast<std::size_t>(k)]) continue;
      normal.row(k).setZero();
      normal.col(k).setZero();
      normal(k, k) = 1;
      slope[k] = 0;
    }
    bool better = false, blocked = false;
    for (int attempt = 0; attempt < 40 && !better; ++attempt) {
      MatrixXd damped = normal;
      damped.diagonal() += damping * size;
      const VectorXd next = within(model, now.beta + dense::solve_symmetric(damped, slope));
      const double cost = projection.evaluate(next, false);
      if (cost < now.cost) {
        const double gain = now.cost - cost;
        const double step = (next - now.beta).norm();
        now.beta = next;
        now.cost = cost;
        damping = std::max(damping / 10, 1e-14);
        better = true;
        if (gain < 1e-15 * now.cost && step < 1e-9 * (1 + now.beta.norm())) {
          ++now.iterations;  // Nothing more to gain in the digits of the cost.
          return judged(projection, model, now, false);
        }
      } else {
        blocked = blocked || !std::isfinite(cost);
        damping *= 10;
        if (damping > 1e12) break;
      }
    }
    if (!better) return judged(projection, model, now, blocked);
    projection.evaluate(now.beta, true);
  }
  return judged(projection, model, now, false);
}

/// NLopt minimises the projected cost within the bounds; failures count as "stay where you are".
class Refinement {
 public:
  Refinement(Projection& projection, const SeparableModel& model) : projection_(projection), model_(model) {}

  VectorXd from(const VectorXd& start) {
    const VectorXd begin = within(model_, start);
    best_ = begin;
    best_cost_ = projection_.evaluate(begin, false);
    if (!std::isfinite(best_cost_)) return begin;
    scale_ = best_cost_ > 0 ? best_cost_ : 1;
    const std::unique_ptr<nlopt_opt_s, void (*)(nlopt_opt)> opt(
        nlopt_create(NLOPT_LD_SLSQP, static_cast<unsigned>(begin.size())), nlopt_destroy);
    if (model_.lower.size()) nlopt_set_lower_bounds(opt.get(), model_.lower.data());
    if (model_.upper.size()) nlopt_set_upper_bounds(opt.get(), model_.upper.data());
    nlopt_set_min_objective(opt.get(), &Refinement::cost_of, this);
    nlopt_set_ftol_rel(opt.get(), 1e-6);
    nlopt_set_xtol_rel(opt.get(), 1e-5);
    nlopt_set_maxeval(opt.get(), 60);
    VectorXd at = begin;
    double cost = 0;
    // Its success codes are not success, and its failures may still have come far: the best point seen
    // counts.
    nlopt_optimize(opt.get(), at.data(), &cost);
    return best_;
  }

 private:
  static double cost_of(unsigned n, const double* x, double* gradient, void* self) {
    return static_cast<Refinement*>(self)->cost(Eigen::Map<const VectorXd>(x, n), gradient);
  }
  double cost(const VectorXd& beta, double* gradient) {
    const double value = projection_.evaluate(beta, gradient != nullptr);
    if (!std::isfinite(value)) {
      if (gradient) std::fill_n(gradient, beta.size(), 0.0);
      return 1e6;
    }
    if (value < best_cost_) best_cost_ = value, best_ = beta;
    if (gradient)
      Eigen::Map<VectorXd>(gradient, beta.size()) =
          2 / scale_ * projection_.jacobian().transpose() * projection_.residual();
    return value / scale_;
  }

  Projection& projection_;
  const SeparableModel& model_;
  VectorXd best_;
  double best_cost_ = infinity, scale_ = 1;
};

bool same_minimum(const SeparableFit& a, const SeparableFit& b) {
  return std::abs(a.chi2 - b.chi2) <= 1e-7 * (a.chi2 + b.chi2) &&
         (a.beta - b.beta).norm() <= 1e-3 * (1e-6 + a.beta.norm() + b.beta.norm());
}

}  // namespace

WeightedPoints thinned(const WeightedPoints& points, long groups) {
  const Index n = points.x.size();
  std::vector<Index> order(static_cast<std::size_t>(n));
  std::iota(order.begin(), order.end(), Index{0});
  if (!std::is_sorted(points.x.begin(), points.x.end()))
    std::ranges::sort(order, {}, [&](Index i) { return points.x[i]; });
  WeightedPoints out{VectorXd(groups), VectorXd(groups), VectorXd(groups)};
  for (long g = 0; g < groups; ++g) {
    double w = 0, x = 0, y = 0;
    for (long j = g * n / groups; j < (g + 1) * n / groups; ++j) {
      const Index i = order[static_cast<std::size_t>(j)];
      w += points.weight[i], x += points.weight[i] * points.x[i], y += points.weight[i] * points.y[i];
    }
    out.weight[g] = w, out.x[g] = x / w, out.y[g] = y / w;
  }
  return out;
}

SeparableFit solve_separable(const SeparableModel& model, const WeightedPoints& points, const VectorXd& start,
                             int most_iterations) {
  Projection projection(model, points);
  SeparableFit out;
  const Descent found = descend(projection, model, points, start, most_iterations);
  out.beta = found.beta;
  out.iterations = found.iterations;
  out.gradient = found.gradient;
  if (!std::isfinite(found.cost)) {
    out.end = SeparableFit::End::not_converged;
    out.chi2 = infinity;
    return out;
  }
  out.chi2 = projection.evaluate(found.beta, true);
  out.c = projection.c();
  out.tangent = projection.tangent();
  out.residual = projection.plain_residual();
  out.end = !found.converged ? SeparableFit::End::not_converged
            : found.at_bound ? SeparableFit::End::at_bound
                             : SeparableFit::End::converged;
  return out;
}

SearchResult search_separable(const SeparableModel& model, const WeightedPoints& points,
                              const std::vector<VectorXd>& starts, const SearchOptions& options) {
  SearchResult result;
  result.starts = static_cast<int>(starts.size());
  if (model.nonlinear == 0) {
    result.minima.push_back(solve_separable(model, points, VectorXd(0)));
    return result;
  }
  const bool thin = points.x.size() > options.thin_above;
  const WeightedPoints few = thin ? thinned(points, options.thin_to) : points;
  Projection projection(model, few);
  std::vector<std::pair<double, std::size_t>> ranked;
  for (std::size_t i = 0; i < starts.size(); ++i) {
    const double cost = projection.evaluate(within(model, starts[i]), false);
    if (std::isfinite(cost)) ranked.emplace_back(cost, i);
  }
  std::ranges::sort(ranked);
  Refinement refinement(projection, model);
  std::vector<SeparableFit> rough;
  for (std::size_t i = 0; i < std::min<std::size_t>(ranked.size(), static_cast<std::size_t>(options.refined));
       ++i) {
    const VectorXd refined = refinement.from(starts[ranked[i].second]);
    SeparableFit fit = solve_separable(model, few, refined);
    if (std::isfinite(fit.chi2) &&
        std::ranges::none_of(rough, [&](const SeparableFit& other) { return same_minimum(fit, other); }))
      rough.push_back(std::move(fit));
  }
  std::ranges::sort(rough, {}, &SeparableFit::chi2);
  if (!thin) {
    result.minima = std::move(rough);
    return result;
  }
  for (std::size_t i = 0; i < std::min<std::size_t>(rough.size(), static_cast<std::size_t>(options.polished));
       ++i)
    result.minima.push_back(solve_separable(model, points, rough[i].beta));
  std::ranges::sort(result.minima, {}, &SeparableFit::chi2);
  return result;
}

CovarianceFactor covariance_factor(const MatrixXd& weighted_jacobian) {
  const Index p = weighted_jacobian.cols();
  VectorXd scale = weighted_jacobian.colwise().norm().transpose();
  for (Index j = 0; j < p; ++j)
    if (scale[j] <= 0) scale[j] = 1;
  const MatrixXd scaled = weighted_jacobian * scale.cwiseInverse().asDiagonal();
  const Eigen::HouseholderQR<MatrixXd> qr(scaled);
  const MatrixXd r = qr.matrixQR().topRows(p).template triangularView<Eigen::Upper>();
  const dense::RightSingular svd = dense::right_singular(r);
  const VectorXd& s = svd.values;
  CovarianceFactor out;
  out.condition = p > 0 && s[p - 1] > 0 ? s[0] / s[p - 1] : infinity;
  MatrixXd inverse = MatrixXd::Identity(p, p);
  if (out.condition < 1e13) {
    r.template triangularView<Eigen::Upper>().solveInPlace(inverse);
  } else {
    // Directions that the points do not determine at all are left out: they do not change the curve either.
    VectorXd reciprocal = VectorXd::Zero(p);
    for (Index j = 0; j < p; ++j)
      if (s[j] > 1e-13 * s[0]) reciprocal[j] = 1 / s[j];
    inverse = svd.vectors * reciprocal.asDiagonal();
  }
  out.factor = scale.cwiseInverse().asDiagonal() * inverse;
  return out;
}

}  // namespace fit
