// SPDX-License-Identifier: MIT
#include "fit/explain/inference/fit.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "fit/explain/numbers.hpp"
#include "fit/numeric/dense.hpp"

namespace fit::explain::inference {

using Eigen::Index;

namespace {

/// What the likelihood says of a block of coefficients with all others integrated, which have their priors.
/// `all`: the covariance of all coefficients.
Quadratic about(const Optimum& optimum, const Eigen::MatrixXd& all, const Design& design, Index first,
                Index count) {
  const Eigen::MatrixXd covariance = all.block(first, first, count, count);
  // Less the priors' own information, which is one in these units. Where counts bend the likelihood up, they
  // say nothing of a scale.
  const dense::SymmetricEigen own =
      dense::symmetric_eigen(covariance.inverse() - Eigen::MatrixXd::Identity(count, count));
  const Eigen::VectorXd known = own.values.cwiseMax(0.0),
                        at = own.vectors.transpose() * optimum.x.segment(first, count),
                        off = at - own.vectors.transpose() * design.mean.segment(first, count),
                        along = known.cwiseProduct(at) + (known.array() > 0).select(off, 0.0).matrix(),
                        scale = design.sigma.segment(first, count).cwiseInverse();
  Quadratic q;
  q.square =
      scale.asDiagonal() * (own.vectors * known.asDiagonal() * own.vectors.transpose()) * scale.asDiagonal();
  q.along = scale.cwiseProduct(own.vectors * along);
  return q;
}

/// Whether any size of a term acts on counts, variances or widths.
bool is_uneven(const Session& session, const Design& design, const Design::Block& block) {
  for (Index k = block.first; k < block.first_shape(); ++k)
    if (acts_unevenly(session, design, k)) return true;
  return false;
}

/// The prior's factor that suits a term best, and what the integral over it adds to the evidence at the
/// present one. Of counts and variances the likelihood is no quadratic: what it says here holds for priors of
/// about these sizes, and that others would suit better is for a fit with those to say.
struct Rescaled {
  double factor = 1, added = 0;
  bool suits = true;  ///< Or the next one.
};
Rescaled rescaled(const Session& session, const Optimum& optimum, const Eigen::MatrixXd& held,
                  const Design& design, const Design::Block& block, const Term& term) {
  if (block.sizes == 0) return {};
  const Quadratic q = about(optimum, held, design, block.first, block.sizes);
  constexpr double farthest = 32;  // beyond that, what steps leave undone would grow to evidence
  static const double near = std::exp(1.5 * numbers::size_factor_log);
  const OverFactors over = integrate_over_factors(q, *term.kind, {0, farthest * term.factor});
  const double here = integrate(q, prior_of(*term.kind, term.factor)).log_evidence;
  const bool suits = over.factor <= near * term.factor && over.factor >= term.factor / near;
  if (!is_uneven(session, design, block)) return {over.factor, over.log_evidence - here, suits};
  const OverFactors nearby =
      integrate_over_factors(q, *term.kind, {term.factor / near, near * term.factor, here});
  return {over.factor, nearby.log_evidence - here, suits};
}

/// How far a cause differs from its formula differs itself: by as much as its prior says, or by less. What
/// the average over that adds to the log evidence with the former.
double of_nearer_formulas(const Optimum& optimum, const Eigen::MatrixXd& held, const Design& design,
                          const Design::Block& block) {
  if (block.of_formula == 0) return 0;
  const Quadratic q = about(optimum, held, design, block.first_deviation(), block.of_formula);
  const dense::SymmetricEigen own = dense::symmetric_eigen(q.square);
  const Eigen::ArrayXd known = own.values.cwiseMax(0.0),
                       along2 = (own.vectors.transpose() * q.along).array().square();
  std::vector<double> logs;
  for (const double share : numbers::deviation_shares) {
    const Eigen::ArrayXd spread = 1 + share * share * known;
    logs.push_back(0.5 * (share * share * along2 / spread - spread.log()).sum());
  }
  return log_sum(logs) - std::log(static_cast<double>(logs.size())) - logs.front();
}

/// Laplace's approximation at the optimum; of shapes, a uniform prior instead of the normal one. Where a
/// shape hardly matters, its derivative says that it never does: a peak is not wider than the grid of its
/// starts says.
/// `log_fit`: at the optimum, with the priors of the first `base` coefficients, which are nuisances.
double log_evidence_of(const Optimum& optimum, const Eigen::LLT<Eigen::MatrixXd>& held, const Design& design,
                       const Eigen::MatrixXd& covariance, const std::vector<Term>& terms,
                       const std::vector<double>& added, double log_fit, Index base) {
  double sum = optimum.log_posterior - 0.5 * log_determinant(held);
  const double of_uniform = 0.5 * std::log(2 * pi / 12);
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const Design::Block& block = design.blocks[t];
    sum += added[t];
    const Index n = block.shapes, first = block.first_shape();
    const double width = n == 0 ? 0 : 0.5 * std::log(covariance.block(first, first, n, n).determinant());
    sum += std::min(terms[t].by_grid, width + static_cast<double>(n) * of_uniform + terms[t].by_modes);
  }
  // An average over what terms may come to: where the quadratic promises more than the best of it has with
  // all nuisances integrated out, it does not hold.
  const double best = log_fit - held.matrixLLT().diagonal().head(base).array().log().sum();
  return std::min(sum, best);
}

/// The term where its coefficients are; its shapes where a scoring step takes them, as far as the linear
/// model can be trusted.
Term moved(const Term& term, const Optimum& optimum, const Eigen::VectorXd& stepped, const Design& design,
           const Design::Block& block, const Eigen::MatrixXd& covariance) {
  Term there = term;
  const auto in_units = [&](Index first, Index count) {
    const Eigen::VectorXd s = design.sigma.segment(first, count);
    return Eigen::MatrixXd(s.asDiagonal() * covariance.block(first, first, count, count) * s.asDiagonal());
  };
  const Eigen::VectorXd size = design.sigma.segment(block.first, block.sizes)
                                   .cwiseProduct(optimum.x.segment(block.first, block.sizes));
  model::set_coefficients(there, size, in_units(block.first, block.sizes));
  const std::vector<std::size_t> shapes = model::refined_shapes_of(*term.kind);
  there.sigma.resize(there.values.size(), 0.0);
  for (Index j = 0; j < block.shapes; ++j) {
    const std::size_t k = shapes[static_cast<std::size_t>(j)];
    const Parameter& p = term.kind->mechanism->parameters[k];
    const Index at = block.first_shape() + j;
    const double span = p.logarithmic ? std::log(p.upper / p.lower) : p.upper - p.lower;
    const double unit = span / std::sqrt(12.0), by = std::clamp(stepped[at] * unit, -0.1 * span, 0.1 * span),
                 u = std::sqrt(covariance(at, at)) * unit;
    const double value = p.logarithmic ? term.values[k] * std::exp(by) : term.values[k] + by;
    there.values[k] = std::clamp(value, p.lower, p.upper);
    there.sigma[k] = p.logarithmic ? there.values[k] * std::min(2.0, u) : u;
  }
  return there;
}

/// The optimum while shapes stay where they are.
Optimum with_shapes_held(const Session& session, Design& design, const Eigen::VectorXd& start) {
  const Eigen::VectorXd lower = design.lower, upper = design.upper;
  for (const Design::Block& block : design.blocks) {
    design.lower.segment(block.first_shape(), block.shapes).setZero();
    design.upper.segment(block.first_shape(), block.shapes).setZero();
  }
  Optimum optimum = optimum_of(session, design, start);
  design.lower = lower;
  design.upper = upper;
  return optimum;
}

/// A term's sizes in units of their prior.
Eigen::VectorXd sizes_of(const Term& term, const Design& design, const Design::Block& block) {
  return model::coefficients(term).cwiseQuotient(design.sigma.segment(block.first, block.sizes));
}

/// Nuisances, sizes and deviations as they are known from fits before, everything else as its prior expects.
Eigen::VectorXd start_of(const Design& design, const std::vector<Term>& terms, const Fitted& before) {
  const Eigen::VectorXd& base = before.hypothesis.base;
  Eigen::VectorXd x = design.mean;
  if (base.size() <= x.size()) x.head(base.size()) = base.cwiseQuotient(design.sigma.head(base.size()));
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const Design::Block& block = design.blocks[t];
    if (!terms[t].sigma.empty())  // else nobody has asked for its size
      x.segment(block.first, block.sizes) = sizes_of(terms[t], design, block);
    if (before.optimum.x.size() == x.size())
      x.segment(block.first_deviation(), block.deviations) =
          before.optimum.x.segment(block.first_deviation(), block.deviations);
  }
  return x;
}

/// Whether a term's size is, within its standard uncertainty, what its deviations were taken for shares of.
bool suits_size(const Optimum& optimum, const Design& design, const Design::Block& block,
                const Eigen::MatrixXd& covariance, const Term& term) {
  if (block.deviations == 0) return true;
  const Eigen::VectorXd u = covariance.diagonal().segment(block.first, block.sizes).cwiseSqrt();
  return ((optimum.x.segment(block.first, block.sizes) - sizes_of(term, design, block)).array().abs() <=
          u.array())
      .all();
}

/// One round of a fit: everything linear at its best, and a step of the shapes, whose effect the likelihood
/// does not count yet.
Fitted solved(const Session& session, const std::vector<Term>& terms, const Fitted& before) {
  Fitted result;
  result.design = design_of(session, terms);
  result.optimum = with_shapes_held(session, result.design, start_of(result.design, terms, before));
  const Eigen::VectorXd stepped = curvature_at(session, result.design, result.optimum);
  Hypothesis& h = result.hypothesis;
  for (const Term& term : terms) h.log_prior += term.kind->log_prior;
  const Index base = session.count_base();
  const Eigen::VectorXd strain = result.optimum.x.head(base) - result.design.mean.head(base);
  h.log_fit = result.optimum.log_likelihood - 0.5 * strain.squaredNorm();
  h.base = result.design.sigma.head(base).cwiseProduct(result.optimum.x.head(base));
  const Index k = result.design.mean.size();
  const Eigen::MatrixXd covariance = result.optimum.factor.solve(Eigen::MatrixXd::Identity(k, k));
  Eigen::MatrixXd known = result.optimum.factor.reconstructedMatrix();
  hold_shapes(result.design, 1, known);
  const Eigen::LLT<Eigen::MatrixXd> held(known);
  const Eigen::MatrixXd covariance_held = held.solve(Eigen::MatrixXd::Identity(k, k));
  std::vector<Rescaled> factors;
  std::vector<double> added;  // by other sizes of priors
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const Design::Block& block = result.design.blocks[t];
    factors.push_back(rescaled(session, result.optimum, covariance_held, result.design, block, terms[t]));
    added.push_back(factors.back().added +
                    of_nearer_formulas(result.optimum, covariance_held, result.design, block));
  }
  h.log_evidence =
      log_evidence_of(result.optimum, held, result.design, covariance, terms, added, h.log_fit, base);
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const Design::Block& block = result.design.blocks[t];
    h.terms.push_back(moved(terms[t], result.optimum, stepped, result.design, block, covariance));
    Term& there = h.terms.back();
    there.factor = factors[t].factor;
    result.suits_sizes &=
        factors[t].suits && suits_size(result.optimum, result.design, block, covariance, terms[t]);
  }
  return result;
}

/// Sizes as found; shapes that share of the way from where they were to where the linear model has them.
std::vector<Term> part_of_way(const std::vector<Term>& from, const std::vector<Term>& to, double share) {
  std::vector<Term> list = to;
  for (std::size_t t = 0; t < list.size(); ++t)
    for (const std::size_t k : model::refined_shapes_of(*list[t].kind)) {
      const double a = from[t].values[k], b = to[t].values[k];
      list[t].values[k] = list[t].kind->mechanism->parameters[k].logarithmic ? a * std::pow(b / a, share)
                                                                             : a + share * (b - a);
    }
  return list;
}

/// From wide priors: narrow ones would hold sizes where they are.
Fitted fit_widely(const Session& session, const Hypothesis& hypothesis) {
  constexpr int most_rounds = 12;
  constexpr double settled = 0.1, shortest = 0.1;
  std::vector<Term> at = hypothesis.terms;
  for (Term& term : at) term.factor = std::max(1.0, term.factor);
  Fitted best;
  best.hypothesis.base = hypothesis.base;
  best = solved(session, at, best);
  if (at.empty()) return best;
  if (!best.suits_sizes) {
    at = part_of_way(at, best.hypothesis.terms, 0);
    best = solved(session, at, best);
  }
  std::optional<Fitted> suitable;  // the last one before others that are not
  for (int round = 1; round < most_rounds; ++round) {
    double share = 1;
    std::vector<Term> there = part_of_way(at, best.hypothesis.terms, share);
    Fitted next = solved(session, there, best);
    // Evidence of priors and deviations of other sizes is no measure of what follows.
    while (best.suits_sizes && next.hypothesis.log_evidence < best.hypothesis.log_evidence - settled &&
           share > shortest) {
      share /= 3;
      there = part_of_way(at, best.hypothesis.terms, share);
      next = solved(session, there, best);
    }
    const double gain = next.hypothesis.log_evidence - best.hypothesis.log_evidence;
    const bool counts = best.suits_sizes;
    if (counts && gain < -settled) {  // No step from here: they stay.
      best.hypothesis.terms = part_of_way(at, best.hypothesis.terms, 0);
      break;
    }
    if (counts && !next.suits_sizes) suitable = std::move(best);
    best = std::move(next);
    at = std::move(there);
    if (counts && best.suits_sizes && gain < settled) break;
  }
  if (!best.suits_sizes && suitable) return *std::move(suitable);
  return best;
}

}  // namespace

Fitted fit(const Session& session, const Hypothesis& hypothesis) {
  constexpr int most_rounds = 3;
  Fitted best = fit_widely(session, hypothesis);
  for (int round = 0; round < most_rounds && !best.suits_sizes; ++round) {
    // The evidence is an integral over priors: of two parts of it, the larger one counts.
    Fitted next = solved(session, best.hypothesis.terms, best);
    if (next.hypothesis.log_evidence < best.hypothesis.log_evidence) break;
    best = std::move(next);
  }
  return best;
}

}  // namespace fit::explain::inference
