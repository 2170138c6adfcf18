// SPDX-License-Identifier: MIT
#include "fit/range/joint_range.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "fit/numeric/dense.hpp"
#include "fit/numeric/separable.hpp"

namespace fit {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// One term of the joint model: a family over a scaled argument, counted from its value at `zero_at`.
struct TermModel {
  const Family* family = nullptr;
  ArgumentScale scale;
  double zero_at = 0;
  SeparableModel model;

  TermModel(const Family& of, const ArgumentScale& s, double zero)
      : family(&of), scale(s), zero_at(zero), model(of.model(s)) {}
  [[nodiscard]] int columns() const { return model.linear - (family->constant_column >= 0 ? 1 : 0); }

  /// Columns for these arguments; `beta` are this term's own.
  void fill(const VectorXd& x, const VectorXd& beta, MatrixXd& phi, std::vector<MatrixXd>* dphi, int column,
            int first_beta) const {
    const Index n = x.size();
    VectorXd t(n + 1);
    for (Index i = 0; i < n; ++i) t[i] = scale.to_scaled(x[i]);
    t[n] = scale.to_scaled(zero_at);
    MatrixXd own(n + 1, model.linear);
    std::vector<MatrixXd> own_d(static_cast<std::size_t>(model.nonlinear), own);
    model.basis(t, beta, own, dphi ? &own_d : nullptr);
    const auto place = [&](const MatrixXd& from, MatrixXd& to) {
      int at = column;
      for (int j = 0; j < model.linear; ++j)
        if (j != family->constant_column) to.col(at++) = from.col(j).head(n).array() - from(n, j);
    };
    place(own, phi);
    if (!dphi) return;
    for (int k = 0; k < model.nonlinear; ++k)
      place(own_d[static_cast<std::size_t>(k)], (*dphi)[static_cast<std::size_t>(first_beta + k)]);
  }

  [[nodiscard]] CorrectionTerm publish(CorrectionTerm::Argument argument, const VectorXd& beta,
                                       const VectorXd& c) const {
    VectorXd all = VectorXd::Zero(model.linear);
    Index at = 0;
    for (int j = 0; j < model.linear; ++j)
      if (j != family->constant_column) all[j] = c[at++];
    CorrectionTerm term;
    term.argument = argument;
    term.family = family->id;
    term.coefficients = family->publish(scale, beta, all);
    term.zero_at = zero_at;
    return term;
  }
};

/// zero + intensity term + distance term.
struct JointModel {
  TermModel intensity, distance;
  VectorXd counts, range_mm;  ///< Arguments of every point.

  [[nodiscard]] SeparableModel separable() const {
    SeparableModel m;
    const int bi = intensity.model.nonlinear, bd = distance.model.nonlinear;
    m.linear = 1 + intensity.columns() + distance.columns();
    m.nonlinear = bi + bd;
    m.basis = [this, bi, bd](const VectorXd&, const VectorXd& beta, MatrixXd& phi,
                             std::vector<MatrixXd>* dphi) {
      if (dphi)
        for (MatrixXd& d : *dphi) d.setZero();
      phi.col(0).setOnes();
      intensity.fill(counts, beta.head(bi), phi, dphi, 1, 0);
      distance.fill(range_mm, beta.tail(bd), phi, dphi, 1 + intensity.columns(), bi);
    };
    m.lower.resize(m.nonlinear), m.upper.resize(m.nonlinear);
    if (bi) m.lower.head(bi) = intensity.model.lower, m.upper.head(bi) = intensity.model.upper;
    if (bd) m.lower.tail(bd) = distance.model.lower, m.upper.tail(bd) = distance.model.upper;
    m.feasible = [this, bi, bd](const VectorXd& beta) {
      return (!intensity.model.feasible || intensity.model.feasible(beta.head(bi))) &&
             (!distance.model.feasible || distance.model.feasible(beta.tail(bd)));
    };
    return m;
  }
};

MatrixXd joint_jacobian(const Correction& c, const JointModel& model, const VectorXd& weight) {
  const auto parameters = c.parameter_names();
  MatrixXd out(model.counts.size(), static_cast<Index>(parameters.size()));
  for (Index i = 0; i < out.rows(); ++i) {
    Index at = 0;
    out(i, at++) = 1;
    for (const double g : c.intensity->gradient(model.counts[i])) out(i, at++) = g;
    for (const double g : c.range->gradient(model.range_mm[i])) out(i, at++) = g;
    out.row(i) *= std::sqrt(weight[i]);
  }
  return out;
}

/// Columns that the model holds at 0 (a term's constant) get no uncertainty.
CovarianceFactor factor_of(const MatrixXd& jacobian) {
  std::vector<Index> free;
  for (Index j = 0; j < jacobian.cols(); ++j)
    if (jacobian.col(j).norm() > 0) free.push_back(j);
  MatrixXd some(jacobian.rows(), static_cast<Index>(free.size()));
  for (std::size_t j = 0; j < free.size(); ++j) some.col(static_cast<Index>(j)) = jacobian.col(free[j]);
  CovarianceFactor out = covariance_factor(some);
  MatrixXd whole = MatrixXd::Zero(jacobian.cols(), out.factor.cols());
  for (std::size_t j = 0; j < free.size(); ++j) whole.row(free[j]) = out.factor.row(static_cast<Index>(j));
  out.factor = whole;
  return out;
}

/// Largest cosine between a curve over intensity and a curve over distance, at these points.
double canonical_correlation(const MatrixXd& tangent, const std::vector<Index>& of_intensity,
                             const std::vector<Index>& of_distance) {
  const auto orthonormal = [&](const std::vector<Index>& columns) {
    if (columns.empty()) return MatrixXd(tangent.rows(), 0);  // A constant curve has nothing of its own.
    MatrixXd part(tangent.rows(), static_cast<Index>(columns.size()));
    for (std::size_t j = 0; j < columns.size(); ++j) {
      VectorXd column = tangent.col(columns[j]);
      // The constant belongs to neither.
      const VectorXd one = tangent.col(0);
      column -= one * (one.dot(column) / one.squaredNorm());
      part.col(static_cast<Index>(j)) = column / std::max(1e-300, column.norm());
    }
    return dense::orthonormal_basis(part);
  };
  const MatrixXd a = orthonormal(of_intensity), b = orthonormal(of_distance);
  if (a.cols() == 0 || b.cols() == 0) return 0;
  return std::min(1.0, dense::right_singular(a.transpose() * b).values[0]);
}

ArgumentScale scale_over(const VectorXd& x) {
  ArgumentScale s{(x.minCoeff() + x.maxCoeff()) / 2, (x.maxCoeff() - x.minCoeff()) / 2};
  if (s.half <= 0) s.half = 1;
  return s;
}

double predict_held_out(const JointModel& model, const WeightedPoints& points, const VectorXd& beta) {
  const SeparableModel whole = model.separable();
  const Index n = points.x.size();
  double square = 0;
  long count = 0;
  for (Index block = 0; block < 10; ++block) {
    std::vector<Index> in, out;
    for (Index i = 0; i < n; ++i) (i % 10 == block ? out : in).push_back(i);
    if (out.empty() || static_cast<int>(in.size()) <= whole.linear + whole.nonlinear) continue;
    JointModel part = model;
    const auto few = static_cast<Index>(in.size());
    part.counts.resize(few), part.range_mm.resize(few);
    WeightedPoints rest{VectorXd::Zero(few), VectorXd(few), VectorXd(few)};
    for (Index j = 0; j < few; ++j) {
      const Index i = in[static_cast<std::size_t>(j)];
      part.counts[j] = model.counts[i], part.range_mm[j] = model.range_mm[i];
      rest.y[j] = points.y[i], rest.weight[j] = points.weight[i];
    }
    const SeparableFit fit = solve_separable(part.separable(), rest, beta);
    if (!std::isfinite(fit.chi2)) continue;
    MatrixXd phi(n, whole.linear);
    whole.basis(points.x, fit.beta, phi, nullptr);
    for (const Index i : out) square += std::pow(points.y[i] - phi.row(i).dot(fit.c), 2), ++count;
  }
  return count ? std::sqrt(square / static_cast<double>(count)) : std::nan("");
}

/// The best of each alone is where to begin; a term's scale may differ, so its starts are looked at again.
std::vector<VectorXd> starts_of(const JointModel& model, const FamilyFit& intensity,
                                const FamilyFit& distance) {
  std::vector<VectorXd> starts;
  const auto alone = [](const TermModel& term, const FamilyFit& fit) {
    std::vector<VectorXd> out;
    if (term.family->starts) out = term.family->starts(term.scale);
    if (out.empty()) out.emplace_back(VectorXd(0));
    if (fit.beta.size()) out.push_back(fit.beta);
    return out;
  };
  for (const VectorXd& a : alone(model.intensity, intensity))
    for (const VectorXd& b : alone(model.distance, distance)) {
      VectorXd both(a.size() + b.size());
      both << a, b;
      starts.push_back(both);
    }
  return starts;
}

}  // namespace

JointFit fit_joint(const std::vector<RangePoint>& points, const FamilyFit& intensity,
                   const FamilyFit& distance, const JointOptions& options) {
  const auto n = static_cast<Index>(points.size());
  VectorXd counts(n), range(n);
  WeightedPoints data{VectorXd::Zero(n), VectorXd(n), VectorXd(n)};
  for (Index i = 0; i < n; ++i) {
    const RangePoint& p = points[static_cast<std::size_t>(i)];
    counts[i] = p.intensity, range[i] = p.true_mm;
    data.y[i] = p.error_mm();
    data.weight[i] =
        1 / (p.u_mm * p.u_mm +
             std::pow(p.for_distance ? options.scatter_distance_mm : options.scatter_intensity_mm, 2));
  }
  JointModel model{TermModel(*find_family(intensity.family), scale_over(counts), options.reference_counts),
                   TermModel(*find_family(distance.family), scale_over(range), options.reference_mm), counts,
                   range};
  JointFit out;
  if (n <= model.separable().linear + model.separable().nonlinear) return out;
  SeparableFit best;
  for (int round = 0; round < 4; ++round) {
    const SeparableModel whole = model.separable();
    if (round == 0) {
      SearchResult found = search_separable(whole, data, starts_of(model, intensity, distance));
      if (found.minima.empty()) return out;
      best = found.best();
    } else {
      best = solve_separable(whole, data, best.beta);
    }
    if (!std::isfinite(best.chi2)) return out;
    const int bi = model.intensity.model.nonlinear, bd = model.distance.model.nonlinear;
    out.correction.zero_mm.value = best.c[0];
    out.correction.intensity =
        model.intensity.publish(CorrectionTerm::Argument::intensity, best.beta.head(bi),
                                best.c.segment(1, model.intensity.columns()));
    out.correction.range = model.distance.publish(CorrectionTerm::Argument::range, best.beta.tail(bd),
                                                  best.c.tail(model.distance.columns()));
    // The range term's argument is the measured range less the error known so far.
    for (Index i = 0; i < n; ++i)
      model.range_mm[i] = points[static_cast<std::size_t>(i)].measured_mm - best.c[0] -
                          out.correction.intensity->value(model.counts[i]);
  }
  const double freedom = static_cast<double>(n - best.tangent.cols());
  const double widening = std::sqrt(std::max(1.0, best.chi2 / freedom));
  CovarianceFactor factor = factor_of(joint_jacobian(out.correction, model, data.weight));
  out.correction.factor = factor.factor * widening;
  out.correction.zero_mm.u = out.correction.factor.row(0).norm();
  out.condition = covariance_factor(best.tangent).condition;
  std::vector<Index> of_i, of_d;
  const int li = model.intensity.columns(), ld = model.distance.columns(),
            bi = model.intensity.model.nonlinear;
  for (int j = 0; j < li; ++j) of_i.push_back(1 + j);
  for (int j = 0; j < ld; ++j) of_d.push_back(1 + li + j);
  for (int j = 0; j < best.beta.size(); ++j) (j < bi ? of_i : of_d).push_back(1 + li + ld + j);
  out.correlation = canonical_correlation(best.tangent, of_i, of_d);
  out.held_out = predict_held_out(model, data, best.beta);
  out.ok = true;
  return out;
}

}  // namespace fit
